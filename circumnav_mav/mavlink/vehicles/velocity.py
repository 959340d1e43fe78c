"""BODY_NED velocity and yaw rate: PX4 and ArduPilot multirotors with a velocity estimate, and PX4's rover.

The velocity loop lags the nose (measured: 0.59 s on PX4, 0.62 s on ArduCopter), so the velocity is turned ahead of the
nose by lead_s x yaw rate; the course then follows the yaw rate without that lag. The autopilot turns a body velocity
into the ground's axes once, as it arrives: send at 20 Hz or more.
"""

from __future__ import annotations

from math import cos, isnan, sin

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.ardupilot_modes import COPTER, COPTER_GUIDED
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.setpoints import Encoded, body_velocity, checked, within, yaw_rate_rad_s
from circumnav_mav.mavlink.streams import ARDUPILOT_HZ, WANTED_HZ
from circumnav_mav.mavlink.vehicles.plug import (
    ATTITUDE,
    ESTIMATOR,
    HEIGHT,
    PAPER,
    VELOCITY,
    Options,
    TakeOff,
    VehicleClass,
)
from circumnav_mav.types import TurnRateSetpoint

HEIGHT_GAIN_PER_S = 0.5
COPTERS = frozenset(
    (
        enums.MAV_TYPE_QUADROTOR,
        enums.MAV_TYPE_HEXAROTOR,
        enums.MAV_TYPE_OCTOROTOR,
        enums.MAV_TYPE_TRICOPTER,
        enums.MAV_TYPE_COAXIAL,
        enums.MAV_TYPE_HELICOPTER,
        enums.MAV_TYPE_DODECAROTOR,
    )
)


class Velocity:
    """Height is held through the vertical speed: no other setpoint holds one with a body velocity."""

    lacks = misses = ""
    """Nothing to learn, and nothing that it cannot do without."""

    def __init__(self, options: Options) -> None:
        self._limits = options.limits
        self._lead_s = options.lead_s

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED, mask 1479."""
        sp = checked(setpoint, self._limits)
        yaw_rate = yaw_rate_rad_s(sp.turn_rate_rad_s)
        ahead = self._lead_s * yaw_rate
        forward, right = sp.speed_m_s * cos(ahead), sp.speed_m_s * sin(ahead)
        down = -self._climb(sp.height_m, state.height_m)
        return body_velocity(sp.t_s, forward, right, down, yaw_rate * self._per_heading(state))

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Nothing but setpoints."""
        return []

    def _per_heading(self, state: VehicleState) -> float:
        """Return the yaw rate to ask for per turn rate of the heading."""
        return 1.0

    def _climb(self, wanted_m: float, height_m: float) -> float:
        if isnan(wanted_m) or isnan(height_m):
            return 0.0
        most = self._limits.climb_m_s
        return within(HEIGHT_GAIN_PER_S * (wanted_m - height_m), -most, most)


class ArduCopterVelocity(Velocity):
    """ArduCopter turns about its tilted thrust axis: the heading turns faster by 1 / (cos roll cos pitch), measured."""

    def _per_heading(self, state: VehicleState) -> float:
        level = cos(state.roll_rad) * cos(state.pitch_rad)
        return 1.0 if isnan(level) else level


class RoverVelocity(Velocity):
    """PX4's rover ignores the yaw rate and steers by the velocity's direction: rate = RO_YAW_P x angle (measured)."""

    def _climb(self, wanted_m: float, height_m: float) -> float:
        return 0.0


PX4_MULTIROTOR = VehicleClass(
    name="px4_multirotor",
    airframe="multirotor",
    words=px4_modes.WORDS,
    autopilot=enums.MAV_AUTOPILOT_PX4,
    types=COPTERS,
    messages_hz=WANTED_HZ,
    needs=(ATTITUDE, VELOCITY, HEIGHT, ESTIMATOR),
    estimates=frozenset({"velocity"}),
    speed="ground",
    turn_lag_s=0.45,
    encoder=Velocity,
    defaults=PAPER,
    take_off=TakeOff(None, "amsl", frozenset({px4_modes.TAKEOFF}), px4_modes.HOLD),
    lead_s=0.6,
)

ARDUCOPTER = VehicleClass(
    name="arducopter",
    airframe="multirotor",
    words=COPTER,
    autopilot=enums.MAV_AUTOPILOT_ARDUPILOTMEGA,
    types=COPTERS,
    messages_hz=ARDUPILOT_HZ | {"ATTITUDE": 50.0},
    needs=(ATTITUDE, VELOCITY, HEIGHT, ESTIMATOR),
    estimates=frozenset({"velocity", "position"}),
    speed="ground",
    turn_lag_s=0.3,
    encoder=ArduCopterVelocity,
    defaults={**PAPER, "limits": {"turn_rate_rad_s": 0.5, "turn_accel_rad_s2": 1.5}},
    take_off=TakeOff(COPTER_GUIDED, "relative", frozenset({COPTER_GUIDED}), COPTER_GUIDED, arm_patience_s=60.0),
    lead_s=0.62,
    lateral_m_s2=2.5,  # WPNAV_ACCEL: what is asked above it is not flown
)

PX4_ROVER = VehicleClass(
    name="px4_rover",
    airframe="rover",
    words=px4_modes.WORDS,
    autopilot=enums.MAV_AUTOPILOT_PX4,
    types=frozenset((enums.MAV_TYPE_GROUND_ROVER,)),
    messages_hz=WANTED_HZ,
    needs=(ATTITUDE, VELOCITY, ESTIMATOR),
    estimates=frozenset({"velocity"}),
    speed="ground",
    turn_lag_s=0.5,
    encoder=RoverVelocity,
    defaults=PAPER,
    lead_s=1.0 / 3.0,  # 1 / RO_YAW_P
)
