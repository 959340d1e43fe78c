"""A PX4 fixed wing by attitude: bank for the turn, an own loop for height and airspeed.

PX4 takes roll and pitch of q and the thrust as they are, without limits; yaw and yaw rate are ignored, and a turn rate
must become a bank: roll = atan(V yaw_rate / g). The loop is the recipe that held V = 12 m/s within 0.1 m/s and the
height within 2 m over banks of 10 to 40 degrees on PX4's simulated airplane (v1.16, SIH).
"""

from __future__ import annotations

from math import atan, cos, isnan, nan, radians

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.setpoints import (
    ATTITUDE_AND_THRUST,
    G_M_S2,
    Encoded,
    attitude,
    checked,
    within,
    yaw_rate_rad_s,
)
from circumnav_mav.mavlink.streams import WANTED_HZ
from circumnav_mav.mavlink.vehicles.learned import Learned
from circumnav_mav.mavlink.vehicles.plug import (
    AIRSPEED,
    ATTITUDE,
    HEIGHT,
    NO_ATTITUDE,
    SMALL_PLANE,
    Options,
    TakeOff,
    VehicleClass,
)
from circumnav_mav.types import TurnRateSetpoint

PLANES = frozenset((enums.MAV_TYPE_FIXED_WING,))
HEIGHT_GAIN_PER_S = 0.35
MOST_CLIMB_M_S = 2.0
PITCH_PER_CLIMB, PITCH_INTEGRAL, PITCH_IN_TURN = 0.06, 0.02, 0.25
"""rad per m/s; rad/s per m/s; rad per (load - 1)."""
THRUST_PER_SPEED, THRUST_INTEGRAL, THRUST_PER_CLIMB, THRUST_IN_TURN = 0.06, 0.02, 0.04, 0.3
"""per m/s; 1/s per m/s; per m/s; per (load - 1)."""
PITCH_LOW_RAD, PITCH_HIGH_RAD = radians(-15.0), radians(20.0)
LEVEL_CLIMB_M_S = 0.7
SLOW_SHARE, TOO_SLOW_SHARE = 0.92, 0.82
"""Of the speed to fly: below the first, climbing is given up by and by; below the second the nose goes down."""


class HeightAndSpeed:
    """Pitch holds the climb rate, thrust the airspeed, about trims that are configured or learned in level flight."""

    def __init__(self, options: Options) -> None:
        self._speed_m_s = options.speed_m_s
        self._pitch = Learned(options.pitch_rad, PITCH_LOW_RAD, PITCH_HIGH_RAD)
        self._thrust = Learned(options.thrust, 0.1, 1.0)
        self._pitch_integral = self._thrust_integral = 0.0

    @property
    def known(self) -> bool:
        """Whether both trims are known."""
        return self._pitch.known and self._thrust.known

    def learn(self, state: VehicleState, dt: float) -> None:
        """Take the trims from level flight by the autopilot."""
        if state.in_air and abs(state.climb_m_s) < LEVEL_CLIMB_M_S and state.airspeed_m_s > 0.5 * self._speed_m_s:
            load = 1.0 / cos(state.roll_rad) - 1.0
            self._pitch.learn(state.pitch_rad - PITCH_IN_TURN * load, dt)
            self._thrust.learn(within(state.throttle - THRUST_IN_TURN * load, 0.0, 1.0), dt)

    def reset(self) -> None:
        """Begin anew from the trims."""
        self._pitch_integral = self._thrust_integral = 0.0

    def run(self, wanted_m: float, roll_rad: float, state: VehicleState, dt: float) -> tuple[float, float]:
        """Return (pitch [rad], thrust). A height or airspeed that is not heard leaves its trim and what was learned."""
        load = 1.0 / cos(roll_rad) - 1.0
        climb = self._climb(wanted_m, state)
        pitch_error = climb - state.climb_m_s
        speed_error = self._speed_m_s - state.airspeed_m_s
        pitch = self._pitch.value + self._pitch_integral + PITCH_IN_TURN * load
        thrust = self._thrust.value + self._thrust_integral + THRUST_PER_CLIMB * climb + THRUST_IN_TURN * load
        if not isnan(pitch_error):
            pitch += PITCH_PER_CLIMB * pitch_error
            if PITCH_LOW_RAD < pitch < PITCH_HIGH_RAD:  # else the integral would only wind up
                self._pitch_integral += PITCH_INTEGRAL * pitch_error * dt
        if not isnan(speed_error):
            thrust += THRUST_PER_SPEED * speed_error
            if 0.0 < thrust < 1.0:
                self._thrust_integral += THRUST_INTEGRAL * speed_error * dt
        return within(pitch, PITCH_LOW_RAD, PITCH_HIGH_RAD), within(thrust, 0.0, 1.0)

    def _climb(self, wanted_m: float, state: VehicleState) -> float:
        """The climb rate that leads to the height, less where the airspeed does not allow it: speed before height."""
        error = wanted_m - state.height_m
        climb = 0.0 if isnan(error) else within(HEIGHT_GAIN_PER_S * error, -MOST_CLIMB_M_S, MOST_CLIMB_M_S)
        share = (state.airspeed_m_s / self._speed_m_s - TOO_SLOW_SHARE) / (SLOW_SHARE - TOO_SLOW_SHARE)
        if isnan(share):
            return climb
        return min(climb, MOST_CLIMB_M_S * within(share, -1.0, 1.0))


class Bank:
    """Roll from atan(V yaw_rate / g), V the true airspeed."""

    def __init__(self, options: Options) -> None:
        self._options = options
        self._loop = HeightAndSpeed(options)
        self._last_s = nan
        self.misses = ""

    @property
    def lacks(self) -> str:
        """The trims."""
        return "" if self._loop.known else "fly level in Hold, so that pitch and thrust of level flight are learned"

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return SET_ATTITUDE_TARGET, mask 7; None without an attitude to judge by."""
        o = self._options
        sp = checked(setpoint, o.limits)
        self.misses = NO_ATTITUDE if isnan(state.roll_rad + state.pitch_rad + state.yaw_rad) else ""
        if self.misses:
            return None
        dt = 0.0 if isnan(self._last_s) else within(now_s - self._last_s, 0.0, 0.2)
        self._last_s = now_s
        flying = sp.speed_m_s > 0.0
        if not flying:  # the autopilot flies, or is about to
            self._loop.learn(state, dt)
        if not self._loop.known:
            self.misses = self.lacks
            return None
        speed = o.speed_m_s if isnan(state.airspeed_m_s) else state.airspeed_m_s
        roll = atan(speed * yaw_rate_rad_s(sp.turn_rate_rad_s) / G_M_S2)
        roll = within(roll, -o.bank_rad, o.bank_rad)  # a gust that makes it faster must not make it steeper
        pitch, thrust = self._loop.run(sp.height_m, roll, state, dt if flying else 0.0)
        return attitude(
            sp.t_s, ATTITUDE_AND_THRUST, roll_rad=roll, pitch_rad=pitch, yaw_rad=state.yaw_rad, thrust=thrust
        )

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Nothing but setpoints."""
        self._loop.reset()
        return []


TAKE_OFF = TakeOff(None, "amsl", frozenset({px4_modes.TAKEOFF}), px4_modes.HOLD, level_s=3.0)
MESSAGES_HZ = WANTED_HZ | {"LOCAL_POSITION_NED": 30.0, "VFR_HUD": 20.0}

PX4_FIXED_WING = VehicleClass(
    name="px4_fixed_wing",
    airframe="fixed_wing",
    words=px4_modes.WORDS,
    autopilot=enums.MAV_AUTOPILOT_PX4,
    types=PLANES,
    messages_hz=MESSAGES_HZ,
    needs=(ATTITUDE, AIRSPEED, HEIGHT),
    estimates=frozenset(),
    speed="air",
    turn_lag_s=0.2,
    encoder=Bank,
    defaults=SMALL_PLANE,
    take_off=TAKE_OFF,
    banks=True,
    attitude=True,
)
