"""Setpoint messages as PX4 v1.16 takes them (PX4.md, 3.6): what it refuses, in which words, and makes of the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

NAN = math.nan
LOCAL_NED, BODY_NED = 1, 8
GLOBAL_FRAMES = (0, 5, 3, 6, 10, 11)  # GLOBAL, GLOBAL_INT, RELATIVE_ALT(_INT), TERRAIN_ALT(_INT)
FORCE, YAW_IGNORE, YAW_RATE_IGNORE = 0x200, 0x400, 0x800
ATTITUDE_IGNORE, THROTTLE_IGNORE = 0x80, 0x40


class Trajectory(NamedTuple):
    """A position / velocity / acceleration setpoint: local north, east, down [m, m/s, m/s2], NaN = not controlled."""

    pn: float
    pe: float
    pd: float
    vn: float
    ve: float
    vd: float
    an: float
    ae: float
    ad: float
    yaw: float
    yaw_rate: float

    @property
    def has_position(self) -> bool:
        """Whether any position is controlled."""
        return self.pn == self.pn or self.pe == self.pe or self.pd == self.pd

    @property
    def has_velocity(self) -> bool:
        """Whether any velocity is controlled."""
        return self.vn == self.vn or self.ve == self.ve or self.vd == self.vd

    @property
    def has_acceleration(self) -> bool:
        """Whether any acceleration is controlled."""
        return self.an == self.an or self.ae == self.ae or self.ad == self.ad

    def valid_for_multirotor(self) -> bool:
        """Whether PX4's position controller takes it: an axis without setpoint, or half a horizontal one, is refused.

        An invalid setpoint does not end OFFBOARD: the vehicle silently stops.
        """
        p, v, a = _given(self.pn), _given(self.vn), _given(self.an)
        down = _given(self.pd) or _given(self.vd) or _given(self.ad)
        return (p or v or a) and down and p == _given(self.pe) and v == _given(self.ve) and a == _given(self.ae)


@dataclass(frozen=True, slots=True)
class AttitudeTarget:
    """An attitude setpoint as it was sent: NaN where PX4 takes NaN. Angles [rad], rates [rad/s], thrust 0..1."""

    roll: float
    pitch: float
    yaw: float
    yaw_rate: float
    thrust: float
    level: bool = False  # q was all zeros


@dataclass(frozen=True, slots=True)
class RatesTarget:
    """Body rates [rad/s] and thrust."""

    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    thrust: float


Setpoint = Trajectory | AttitudeTarget | RatesTarget


@dataclass(frozen=True, slots=True)
class Refused:
    """A setpoint that does not count as stream, with PX4's STATUSTEXT (severity critical)."""

    text: str


def _given(value: float) -> bool:
    return value == value  # not NaN


def local_ned(m: Any, yaw_rad: float) -> Trajectory | Refused:
    """Return what PX4 makes of a SET_POSITION_TARGET_LOCAL_NED; BODY_NED turns with the yaw at its arrival."""
    mask = m.type_mask
    if m.coordinate_frame == LOCAL_NED:
        pn, pe, pd = _unless(mask, 0x1, m.x), _unless(mask, 0x2, m.y), _unless(mask, 0x4, m.z)
        vn, ve, vd = _unless(mask, 0x8, m.vx), _unless(mask, 0x10, m.vy), _unless(mask, 0x20, m.vz)
        an, ae, ad = _unless(mask, 0x40, m.afx), _unless(mask, 0x80, m.afy), _unless(mask, 0x100, m.afz)
    elif m.coordinate_frame == BODY_NED:
        pn = pe = pd = NAN
        vn, ve, vd = _turned(mask, 0x38, m.vx, m.vy, m.vz, yaw_rad)
        an, ae, ad = _turned(mask, 0x1C0, m.afx, m.afy, m.afz, yaw_rad)
    else:
        return Refused(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {m.coordinate_frame} unsupported\t")
    return _checked(
        "SET_POSITION_TARGET_LOCAL_NED",
        mask,
        Trajectory(
            pn,
            pe,
            pd,
            vn,
            ve,
            vd,
            an,
            ae,
            ad,
            _unless(mask, YAW_IGNORE, m.yaw),
            _unless(mask, YAW_RATE_IGNORE, m.yaw_rate),
        ),
    )


def global_int(m: Any, north_m: float, east_m: float, origin_h_m: float, home_amsl_m: float) -> Trajectory | Refused:
    """Return what PX4 makes of a SET_POSITION_TARGET_GLOBAL_INT whose place is (north_m, east_m) in the local frame.

    origin_h_m: the local frame's origin above the ground, where home is.
    """
    mask = m.type_mask
    if m.coordinate_frame not in GLOBAL_FRAMES:
        return Refused(f"SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {m.coordinate_frame}\t")
    down = origin_h_m - (m.alt - home_amsl_m if m.coordinate_frame in (0, 5) else m.alt)
    return _checked(
        "SET_POSITION_TARGET_GLOBAL_INT",
        mask,
        Trajectory(
            _unless(mask, 0x1, north_m),
            _unless(mask, 0x2, east_m),
            _unless(mask, 0x4, down),
            _unless(mask, 0x8, m.vx),
            _unless(mask, 0x10, m.vy),
            _unless(mask, 0x20, m.vz),
            _unless(mask, 0x40, m.afx),
            _unless(mask, 0x80, m.afy),
            _unless(mask, 0x100, m.afz),
            _unless(mask, YAW_IGNORE, m.yaw),
            _unless(mask, YAW_RATE_IGNORE, m.yaw_rate),
        ),
    )


def attitude_target(m: Any) -> AttitudeTarget | RatesTarget:
    """Return what PX4 makes of a SET_ATTITUDE_TARGET. It checks nothing: NaN comes through."""
    thrust = 0.0 if m.type_mask & THROTTLE_IGNORE else m.thrust
    rates = [0.0 if m.type_mask & (1 << i) else r for i, r in enumerate((m.body_roll_rate, m.body_pitch_rate))]
    yaw_rate = 0.0 if m.type_mask & 0x4 else m.body_yaw_rate
    if m.type_mask & ATTITUDE_IGNORE:
        return RatesTarget(rates[0], rates[1], yaw_rate, thrust)
    w, x, y, z = m.q
    if w == x == y == z == 0.0:
        return AttitudeTarget(0.0, 0.0, NAN, yaw_rate, thrust, level=True)
    roll, pitch, yaw = euler(w, x, y, z)
    return AttitudeTarget(roll, pitch, yaw, yaw_rate, thrust)


def euler(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] of a quaternion of any length; NaN stays NaN."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not length > 0.0:
        return NAN, NAN, NAN
    w, x, y, z = w / length, x / length, y / length, z / length
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def _unless(mask: int, bit: int, value: float) -> float:
    return NAN if mask & bit or not math.isfinite(value) else value


def _turned(mask: int, bits: int, x: float, y: float, z: float, yaw_rad: float) -> tuple[float, float, float]:
    if mask & bits:  # one axis ignored: all three are dropped
        return NAN, NAN, NAN
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * x - s * y, s * x + c * y, z  # a NaN spreads to both horizontal axes, as in PX4


def _checked(name: str, mask: int, setpoint: Trajectory) -> Trajectory | Refused:
    if setpoint.has_acceleration and mask & FORCE:
        return Refused(f"{name} force not supported\t")
    if setpoint.has_position or setpoint.has_velocity or setpoint.has_acceleration:
        return setpoint
    return Refused(f"{name} invalid\t")
