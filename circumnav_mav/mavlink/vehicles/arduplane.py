"""ArduPlane in GUIDED: roll by SET_ATTITUDE_TARGET, height and airspeed by ArduPlane's own TECS.

The mask is 254 and nothing else (measured on 4.6.3): the masks that look right force the pitch too, and height and
airspeed are lost. Roll comes from q although its bit says ignored. How much turn a bank gives is the airframe's affair
(ArduPilot's simulated plane: 0.745 of a coordinated turn), so it is estimated from the turn rate that is measured.

Without setpoints for 3 s GUIDED turns back to where it was entered, in a steep bank. So two commands go out once, as
control begins: the present heading (43002), which it falls back to instead, and the height (43001).
"""

from __future__ import annotations

from math import atan, degrees, isnan, nan, tan

from circumnav_mav.mavlink.ardupilot_modes import PLANE, PLANE_TAKEOFF
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.setpoints import G_M_S2, ROLL_ALONE, Encoded, attitude, checked, within, yaw_rate_rad_s
from circumnav_mav.mavlink.streams import ARDUPILOT_HZ
from circumnav_mav.mavlink.vehicles.plug import AIRSPEED, ATTITUDE, HEIGHT, HIGH, Options, TakeOff, VehicleClass
from circumnav_mav.mavlink.vehicles.px4_fixed_wing import PLANES
from circumnav_mav.types import TurnRateSetpoint

FALL_BACK_ACCEL_M_S2 = 5.0
"""Lateral acceleration of the fall-back to the heading: 27 degrees of bank."""
EFFECT_LOW, EFFECT_HIGH = 0.6, 1.2
EFFECT_TIME_S = 5.0
EFFECT_FROM_RAD = 0.09
"""Banks below this say too little of what a bank does."""


class RollAlone:
    """roll = atan(V yaw_rate / (g effect)): V the true airspeed, effect = turn rate / coordinated turn rate."""

    lacks = misses = ""
    """Nothing to learn, and nothing that it cannot do without."""

    def __init__(self, options: Options) -> None:
        self._options = options
        self.effect = 1.0
        self._last_s = nan

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return SET_ATTITUDE_TARGET, mask 254."""
        o = self._options
        sp = checked(setpoint, o.limits)
        speed = o.speed_m_s if isnan(state.airspeed_m_s) else state.airspeed_m_s
        dt = 0.0 if isnan(self._last_s) else within(now_s - self._last_s, 0.0, 0.2)
        self._last_s = now_s
        if sp.speed_m_s > 0.0:
            self._watch(state, speed, dt)
        roll = atan(speed * yaw_rate_rad_s(sp.turn_rate_rad_s) / (G_M_S2 * self.effect))
        return attitude(
            sp.t_s,
            ROLL_ALONE,
            roll_rad=within(roll, -o.bank_rad, o.bank_rad),
            pitch_rad=0.0,
            yaw_rad=0.0,
            thrust=0.5,  # ignored
        )

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Return the fall-back heading and the height to hold."""
        frame = enums.MAV_FRAME_GLOBAL_RELATIVE_ALT
        commands = []
        if not isnan(state.yaw_rad):
            params = (1.0, degrees(state.yaw_rad) % 360.0, FALL_BACK_ACCEL_M_S2, 0.0, 0.0, 0.0, 0.0)
            commands.append(Command(enums.MAV_CMD_GUIDED_CHANGE_HEADING, params, "fall-back heading", frame))
        if height_m > 0.0:  # the rate (param3) must be 0: with one it climbs at 3 % of it
            params = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
            commands.append(Command(enums.MAV_CMD_GUIDED_CHANGE_ALTITUDE, params, "height to hold", frame))
        return commands

    def _watch(self, state: VehicleState, speed: float, dt: float) -> None:
        """Estimate the effect, slowly: the yaw rate, not the course rate, which the wind changes."""
        if not abs(state.roll_rad) > EFFECT_FROM_RAD or isnan(state.yaw_rate_rad_s):
            return
        seen = state.yaw_rate_rad_s * speed / (G_M_S2 * tan(state.roll_rad))
        seen = within(seen, EFFECT_LOW, EFFECT_HIGH)
        self.effect += (seen - self.effect) * dt / EFFECT_TIME_S


ARDUPLANE = VehicleClass(
    name="arduplane",
    airframe="fixed_wing",
    words=PLANE,
    autopilot=enums.MAV_AUTOPILOT_ARDUPILOTMEGA,
    types=PLANES,
    messages_hz=ARDUPILOT_HZ | {"VFR_HUD": 10.0},
    needs=(ATTITUDE, AIRSPEED, HEIGHT),
    estimates=frozenset(),
    speed="air",
    turn_lag_s=0.45,
    encoder=RollAlone,
    defaults={
        **HIGH,
        "orbit": {"radius_m": 150.0, "speed_m_s": 22.0},
        "limits": {"turn_rate_rad_s": 0.6, "turn_accel_rad_s2": 0.3, "bank_deg": 45.0},
    },
    take_off=TakeOff(
        PLANE_TAKEOFF,
        "none",
        frozenset({PLANE_TAKEOFF}),
        PLANE_TAKEOFF,
        level_s=3.0,
        height_parameter="TKOFF_ALT",
        arm_patience_s=60.0,
    ),
    banks=True,
    turn_share=0.7,
)
