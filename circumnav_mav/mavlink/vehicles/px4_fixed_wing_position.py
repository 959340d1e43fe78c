"""A PX4 fixed wing by curved paths: PX4 itself holds height and airspeed and coordinates the turn.

Each setpoint is a path through the vehicle's own place: direction chi, curvature from the centripetal acceleration
(measured: chi integrated at 0.2 rad/s gave a course rate of 0.203, height within 3 m). PX4 ignores the size of the
velocity, the airspeed stays FW_AIRSPD_TRIM. Needs a position estimate.
"""

from __future__ import annotations

from math import atan2, cos, isnan, nan, sin, tan

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.setpoints import (
    CURVED_PATH,
    G_M_S2,
    Encoded,
    checked,
    position_target,
    within,
    yaw_rate_rad_s,
)
from circumnav_mav.mavlink.vehicles.plug import (
    AIRSPEED,
    ATTITUDE,
    ESTIMATOR,
    NO_PLACE,
    SMALL_PLANE,
    VELOCITY,
    Options,
    VehicleClass,
)
from circumnav_mav.mavlink.vehicles.px4_fixed_wing import MESSAGES_HZ, PLANES, TAKE_OFF
from circumnav_mav.types import TurnRateSetpoint

LEASH_RAD = 0.15
"""The direction asked for is never further than this from the course flown: what a gust did is not caught up with."""
SLOWEST_M_S = 3.0


class CurvedPath:
    """Direction integrated at the turn rate that is asked for, kept on a leash to the course that is flown."""

    lacks = ""
    """Nothing to learn."""
    misses = ""

    def __init__(self, options: Options) -> None:
        self._limits = options.limits
        self._lateral_m_s2 = G_M_S2 * tan(options.bank_rad)
        self._chi_rad = self._last_s = nan

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return SET_POSITION_TARGET_LOCAL_NED, frame LOCAL_NED, mask 3072; None without a place and a course."""
        sp = checked(setpoint, self._limits)
        if isnan(state.north_m + state.east_m + state.down_m + state.course_rad + state.speed_m_s):
            self.misses = NO_PLACE
            return None
        self.misses = ""
        v = max(SLOWEST_M_S, state.speed_m_s)
        most = self._lateral_m_s2 / v  # over the ground: downwind the same turn rate takes a steeper bank
        rate = within(yaw_rate_rad_s(sp.turn_rate_rad_s), -most, most)
        dt = 0.0 if isnan(self._last_s) else within(now_s - self._last_s, 0.0, 0.2)
        self._last_s = now_s
        if sp.speed_m_s > 0.0 and not isnan(self._chi_rad):
            ahead = wrapped(self._chi_rad + rate * dt - state.course_rad)
            self._chi_rad = state.course_rad + within(ahead, -LEASH_RAD, LEASH_RAD)
        else:
            self._chi_rad = state.course_rad
        north, east = cos(self._chi_rad), sin(self._chi_rad)
        above = sp.height_m - state.height_m
        return position_target(
            sp.t_s,
            enums.MAV_FRAME_LOCAL_NED,
            CURVED_PATH,
            x=state.north_m,
            y=state.east_m,
            z=state.down_m - (0.0 if isnan(above) else above),
            vx=v * north,
            vy=v * east,
            afx=-v * rate * east,
            afy=v * rate * north,
        )

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Nothing but setpoints."""
        return []


def wrapped(angle_rad: float) -> float:
    """Return the angle within -pi..pi."""
    return atan2(sin(angle_rad), cos(angle_rad))


PX4_FIXED_WING_POSITION = VehicleClass(
    name="px4_fixed_wing_position",
    airframe="fixed_wing",
    words=px4_modes.WORDS,
    autopilot=enums.MAV_AUTOPILOT_PX4,
    types=PLANES,
    messages_hz=MESSAGES_HZ,
    needs=(ATTITUDE, VELOCITY, AIRSPEED, ESTIMATOR),
    estimates=frozenset({"velocity", "position"}),
    speed="air",
    turn_lag_s=0.6,
    encoder=CurvedPath,
    defaults=SMALL_PLANE,
    take_off=TAKE_OFF,
    banks=True,
)
