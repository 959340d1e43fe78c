"""TurnRateSetpoint -> MAVLink, one encoder a vehicle class. The one place where the sign of the turn rate is flipped.

A setpoint that is not finite or past its limits is a bug upstream: it raises, the app stops, the autopilot sees
silence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, isfinite, isnan, sin
from typing import Any, Protocol

from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.types import TurnRateSetpoint

VELOCITY_AND_YAW_RATE = 1479
"""type_mask: use vx, vy, vz and yaw_rate, ignore the rest. PX4 takes all three velocities or none."""
VELOCITY_LAG_S = 0.6
"""Lag of the course behind the nose on a PX4 multirotor (measured 0.59 s), taken out by lead_s."""
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class SetpointLimits:
    """What may never be passed on the wire."""

    turn_rate_rad_s: float
    speed_m_s: float
    climb_m_s: float = 1.0
    """Vertical speed of the height loop; inside PX4's MPC_Z_VEL_MAX_DN 1.5 and _UP 3."""


class SetpointError(RuntimeError):
    """A setpoint that must not leave the app."""


def yaw_rate_rad_s(turn_rate_rad_s: float) -> float:
    """Return MAVLink's yaw rate (+ clockwise from above) for a turn rate (+ counter-clockwise)."""
    return -turn_rate_rad_s


def checked(setpoint: TurnRateSetpoint, limits: SetpointLimits) -> TurnRateSetpoint:
    """Return the setpoint as it is. Raises SetpointError where it is not finite or not within the limits."""
    if not (isfinite(setpoint.turn_rate_rad_s) and isfinite(setpoint.speed_m_s)):
        raise SetpointError(f"a setpoint that is not finite must not be sent: {setpoint}")
    if abs(setpoint.turn_rate_rad_s) > limits.turn_rate_rad_s + ROUNDING:
        raise SetpointError(
            f"turn rate {setpoint.turn_rate_rad_s:.3f} rad/s is past {limits.turn_rate_rad_s:.3f} rad/s"
        )
    if not 0.0 <= setpoint.speed_m_s <= limits.speed_m_s + ROUNDING:
        raise SetpointError(f"speed {setpoint.speed_m_s:.2f} m/s is past {limits.speed_m_s:.2f} m/s")
    return setpoint


class Encoder(Protocol):
    """A vehicle class: what it needs of the autopilot, and how a setpoint becomes a message."""

    name: str
    needs: tuple[str, ...]
    """Names of the messages without which this class cannot fly."""

    def encode(self, setpoint: TurnRateSetpoint, height_m: float) -> tuple[str, dict[str, Any]]:
        """Return (message name, its fields without the target ids). height_m: the present height, NaN unknown."""
        ...


class Px4Multirotor:
    """BODY_NED velocity and yaw rate; height held through the vertical speed.

    lead_s: the velocity loop lags the nose by about 0.6 s (measured: sideslip = -0.59 s x yaw rate), so the velocity is
    turned ahead of the nose by lead_s x yaw rate; the course then follows the yaw rate without that lag.
    """

    name: str = "px4_multirotor"
    needs: tuple[str, ...] = ("ATTITUDE", "LOCAL_POSITION_NED")

    HEIGHT_GAIN_PER_S = 0.5

    def __init__(self, limits: SetpointLimits, lead_s: float) -> None:
        self._limits = limits
        self._lead_s = lead_s

    def encode(self, setpoint: TurnRateSetpoint, height_m: float) -> tuple[str, dict[str, Any]]:
        """Return SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED, mask 1479 (PX4 takes frames 1 and 8 only)."""
        sp = checked(setpoint, self._limits)
        yaw_rate = yaw_rate_rad_s(sp.turn_rate_rad_s)
        ahead = self._lead_s * yaw_rate
        return "SET_POSITION_TARGET_LOCAL_NED", {
            "time_boot_ms": int(sp.t_s * 1000) & 0xFFFFFFFF,
            "coordinate_frame": enums.MAV_FRAME_BODY_NED,
            "type_mask": VELOCITY_AND_YAW_RATE,
            "x": 0.0,
            "y": 0.0,
            "z": 0.0,
            "vx": sp.speed_m_s * cos(ahead),
            "vy": sp.speed_m_s * sin(ahead),
            "vz": -self._climb(sp.height_m, height_m),
            "afx": 0.0,
            "afy": 0.0,
            "afz": 0.0,
            "yaw": 0.0,
            "yaw_rate": yaw_rate,
        }

    def _climb(self, wanted_m: float, height_m: float) -> float:
        if isnan(wanted_m) or isnan(height_m):
            return 0.0
        most = self._limits.climb_m_s
        return max(-most, min(most, self.HEIGHT_GAIN_PER_S * (wanted_m - height_m)))


ENCODERS: dict[str, Callable[[SetpointLimits, float], Encoder]] = {Px4Multirotor.name: Px4Multirotor}
"""The vehicle classes by the name that a configuration gives. A new one is a class and a line here."""
