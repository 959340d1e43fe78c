"""A PX4 multirotor without a velocity estimate: attitude, thrust and yaw rate, the height by the barometer.

Truly GPS-denied flight (no GPS, no optical flow, no visual odometry): PX4 then takes attitude setpoints only. The speed
is not measured, it is believed: a fixed pitch flies some airspeed, found by a flight at that pitch, and the wind
carries the vehicle as it carries a plane. What nobody measures, nobody corrects.

Measured on PX4 (SET_ATTITUDE_TARGET, mask 3): with the present yaw in q, body_yaw_rate is a feed-forward that turns the
heading at 95 % of it, 63 % after 0.43 s.
"""

from __future__ import annotations

from math import atan, cos, isnan, nan

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.setpoints import (
    ATTITUDE_YAW_RATE_AND_THRUST,
    G_M_S2,
    Encoded,
    attitude,
    checked,
    within,
    yaw_rate_rad_s,
)
from circumnav_mav.mavlink.streams import WANTED_HZ
from circumnav_mav.mavlink.vehicles.learned import Learned
from circumnav_mav.mavlink.vehicles.plug import ATTITUDE, IN_WIND, NO_ATTITUDE, Options, TakeOff, VehicleClass
from circumnav_mav.mavlink.vehicles.velocity import COPTERS
from circumnav_mav.types import TurnRateSetpoint

HEIGHT_GAIN_PER_S = 0.5
CLIMB_GAIN_PER_S = 1.5
CLIMB_INTEGRAL_PER_S2 = 0.3
MOST_LIFT_M_S2 = 3.0
"""Vertical acceleration that the height loop asks for at most, either way."""
LEVEL_CLIMB_M_S = 0.5
HOVER_THRUST = (0.1, 0.9)
"""What a hover can take; on the ground it is less."""


class Attitude:
    """Roll for the turn, a fixed pitch for the believed speed, thrust for the height."""

    def __init__(self, options: Options) -> None:
        self._limits = options.limits
        self._speed_m_s = options.speed_m_s
        self._bank_rad = options.bank_rad
        self._pitch_rad = options.pitch_rad
        self._hover = Learned(options.thrust, *HOVER_THRUST)
        self._integral_m_s2 = 0.0
        self._last_s = nan
        self.misses = ""

    @property
    def lacks(self) -> str:
        """The hover thrust."""
        return "" if self._hover.known else "hover in place, so that the thrust which carries the vehicle is learned"

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return SET_ATTITUDE_TARGET, mask 3; None without an attitude to put into it."""
        sp = checked(setpoint, self._limits)
        self.misses = NO_ATTITUDE if isnan(state.roll_rad + state.pitch_rad + state.yaw_rad) else ""
        if self.misses:
            return None
        dt = 0.0 if isnan(self._last_s) else within(now_s - self._last_s, 0.0, 0.2)
        self._last_s = now_s
        flying = sp.speed_m_s > 0.0
        yaw_rate = yaw_rate_rad_s(sp.turn_rate_rad_s)
        speed = self._speed_m_s if isnan(state.airspeed_m_s) else min(self._speed_m_s, state.airspeed_m_s)
        roll = within(atan(speed * yaw_rate / G_M_S2), -self._bank_rad, self._bank_rad) if flying else 0.0
        pitch = self._pitch_rad if flying else 0.0
        if not flying and state.in_air and abs(state.climb_m_s) < LEVEL_CLIMB_M_S:
            self._hover.learn(state.throttle * cos(state.roll_rad) * cos(state.pitch_rad), dt)
        if not self._hover.known:
            self.misses = self.lacks
            return None
        lift = self._lift(sp.height_m, state, dt if flying else 0.0)
        thrust = self._hover.value * (1.0 + lift / G_M_S2) / (cos(roll) * cos(pitch))
        return attitude(
            sp.t_s,
            ATTITUDE_YAW_RATE_AND_THRUST,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=state.yaw_rad,
            yaw_rate_rad_s=yaw_rate,
            thrust=within(thrust, 0.3 * self._hover.value, 1.0),
        )

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Nothing but setpoints."""
        self._integral_m_s2 = 0.0
        return []

    def _lift(self, wanted_m: float, state: VehicleState, dt: float) -> float:
        """Return the vertical acceleration [m/s^2] for the height; what was learned where no climb rate is heard."""
        if isnan(state.climb_m_s):
            return self._integral_m_s2
        climb = 0.0
        if not isnan(wanted_m - state.height_m):
            most = self._limits.climb_m_s
            climb = within(HEIGHT_GAIN_PER_S * (wanted_m - state.height_m), -most, most)
        error = climb - state.climb_m_s
        integral = self._integral_m_s2 + CLIMB_INTEGRAL_PER_S2 * error * dt
        self._integral_m_s2 = within(integral, -MOST_LIFT_M_S2, MOST_LIFT_M_S2)
        return within(CLIMB_GAIN_PER_S * error + self._integral_m_s2, -MOST_LIFT_M_S2, MOST_LIFT_M_S2)


PX4_MULTIROTOR_ATTITUDE = VehicleClass(
    name="px4_multirotor_attitude",
    airframe="multirotor",
    words=px4_modes.WORDS,
    autopilot=enums.MAV_AUTOPILOT_PX4,
    types=COPTERS,
    messages_hz=WANTED_HZ | {"VFR_HUD": 20.0},
    needs=(ATTITUDE, ("VFR_HUD",)),
    estimates=frozenset(),
    speed="believed",
    turn_lag_s=0.45,
    encoder=Attitude,
    defaults={
        **IN_WIND,
        "limits": {"turn_rate_rad_s": 0.6, "turn_accel_rad_s2": 1.0, "bank_deg": 20.0},
        "on_range_lost": "stop",
        "safety": dict.fromkeys(
            ("on_used_up", "on_battery_low", "on_height_lost", "on_blind", "on_band_broken"), "stop"
        ),
    },
    take_off=TakeOff(None, "amsl", frozenset({px4_modes.TAKEOFF}), px4_modes.HOLD, level_s=3.0),
    banks=True,
    attitude=True,
    wants_pitch=True,
    hands_over=False,
)
