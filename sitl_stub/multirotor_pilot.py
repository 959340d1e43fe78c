"""What PX4 does with a multirotor in each mode: from modes and setpoints to velocities, tilts and falls."""

from __future__ import annotations

import math
import random

from sitl_stub.commander import Commander
from sitl_stub.kinematics import YAW_RATE_GAIN, Multirotor, body_rates
from sitl_stub.modes import Mode
from sitl_stub.multirotor_auto import AutoModes, limited
from sitl_stub.offboard import AttitudeTarget, RatesTarget, Setpoint, Trajectory
from sitl_stub.params import Parameters

# Without sticks: sink rate [m/s] and time constant of the drift [s] (PX4.md, 3.4).
STICKLESS = {Mode.POSCTL: (0.63, 10.0), Mode.ALTCTL: (0.75, 10.0), Mode.STABILIZED: (0.4, 10.0)}
STICK_SPEED_M_S, STICK_CLIMB_M_S, STICK_YAW_RAD_S = 10.0, 3.0, 1.0
DRIFT_TAU_S = 20.0


class MultirotorPilot:
    """Steps a Multirotor through PX4's modes."""

    def __init__(
        self, vehicle: Multirotor, commander: Commander, params: Parameters, seed: int, drift_m_s: float
    ) -> None:
        self.vehicle, self.commander, self.params = vehicle, commander, params
        self.setpoint: Setpoint | None = None
        self._valid = False
        self.sticks = (0.0, 0.0, 0.0, 0.0)  # forward, right, up, clockwise; -1..1
        self.local_n, self.local_e, self.local_h = vehicle.n, vehicle.e, 0.0  # the local frame's origin
        self.yaw_error_rad = 0.0  # the autopilot's yaw minus the true one: it turns to what its compass says
        self.auto = AutoModes(vehicle, commander, params)
        self._mode = commander.mode
        self._rates = (0.0, 0.0, 0.0)  # the last valid rate setpoint: PX4 flies it on through NaN
        self._random = random.Random(f"{seed}:drift")
        self._drift = 0.0
        self._drift_keep = math.exp(-0.1 / DRIFT_TAU_S)
        self._drift_kick = drift_m_s * math.sqrt(1.0 - self._drift_keep**2)
        self._next_drift_s = 0.0

    @property
    def pushing(self) -> bool:
        """Whether it takes off and stands only because the thrust is still rising."""
        return self.auto.pushing

    @property
    def landing(self) -> bool:
        """Whether it comes down to land, in Land or at the end of Return."""
        return self.auto.landing

    def begin_in_hold(self) -> None:
        """Hold from where it starts in the air."""
        self.auto.enter(self._mode, 0.0)

    def go_to(self, north_m: float, east_m: float, height_m: float) -> None:
        """Hold somewhere else; NaN: as it is. It holds from the next step on if the mode is Hold by then."""
        self.auto.wanted = (north_m, east_m, height_m)

    def take_off_to(self, height_m: float) -> None:
        """Take off to this height when the mode is Takeoff next; NaN: MIS_TAKEOFF_ALT above here."""
        self.auto.takeoff_height_m = height_m

    def set_home(self, north_m: float, east_m: float) -> None:
        """Let Return lead here."""
        self.auto.home_n, self.auto.home_e = north_m, east_m

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Fly this whenever the mode is OFFBOARD."""
        self.setpoint = setpoint
        self._valid = isinstance(setpoint, Trajectory) and setpoint.valid_for_multirotor()

    def step(self, now_s: float, wind_n: float, wind_e: float) -> None:
        """Fly one step in the commander's mode."""
        commander, v = self.commander, self.vehicle
        mode = commander.mode
        if (tilt_deg := self.params["MPC_TILTMAX_AIR"]) != v.tilt_max_deg:
            v.limit_tilt(float(tilt_deg))
        if mode is not self._mode:
            self._mode = mode
            self.auto.enter(mode, now_s)
        if now_s >= self._next_drift_s:
            self._next_drift_s += 0.1
            self._drift = self._drift * self._drift_keep + self._drift_kick * self._random.gauss(0.0, 1.0)
        if not commander.armed:
            self.auto.armed_s, self.auto.pushing = now_s, False  # spooling up begins with arming
            if v.h <= 0.0:
                v.rest()
            else:
                v.step_attitude(0.0, 0.0, 0.0, 0.0, wind_n, wind_e)
            return
        if mode is Mode.OFFBOARD:
            self._offboard(wind_n, wind_e)
        elif mode in STICKLESS:
            self._by_stick(mode, now_s, wind_n, wind_e)
        elif mode is Mode.TERMINATION:
            v.step_attitude(v.roll, v.pitch, 0.0, 0.0, wind_n, wind_e)
        else:
            vn, ve, vu = self.auto.velocity(mode, now_s)
            v.step_velocity(vn, ve, vu, 0.0, wind_n, wind_e)

    # -- stick modes ---------------------------------------------------------------------------------------------

    def _by_stick(self, mode: Mode, now_s: float, wind_n: float, wind_e: float) -> None:
        v = self.vehicle
        sink, tau_s = STICKLESS[mode]
        if not self.commander.sticks_ok(now_s):
            v.step_drift(sink, tau_s, wind_n, wind_e)
            return
        forward, right, up, clockwise = (0.0 if abs(s) < 0.1 else s for s in self.sticks)
        c, s = math.cos(v.yaw), math.sin(v.yaw)
        climb = STICK_CLIMB_M_S * up
        if v.h <= 0.0 and climb <= 0.0:
            climb = 0.0
        vn, ve = STICK_SPEED_M_S * (forward * c - right * s), STICK_SPEED_M_S * (forward * s + right * c)
        if forward == right == 0.0 and mode is Mode.POSCTL:
            vn, ve = self.auto.stay()
        else:
            self.auto.let_go()
        v.step_velocity(vn, ve, self.auto.climb_limited(climb), STICK_YAW_RAD_S * clockwise, wind_n, wind_e)

    # -- OFFBOARD ------------------------------------------------------------------------------------------------

    def _offboard(self, wind_n: float, wind_e: float) -> None:
        v, setpoint = self.vehicle, self.setpoint
        if isinstance(setpoint, AttitudeTarget):
            self._fly_attitude(setpoint, wind_n, wind_e)
        elif isinstance(setpoint, RatesTarget):
            if math.isfinite(setpoint.roll_rate + setpoint.pitch_rate + setpoint.yaw_rate):
                self._rates = (setpoint.roll_rate, setpoint.pitch_rate, setpoint.yaw_rate)
            v.step_rates(*self._rates, _motors(setpoint.thrust), wind_n, wind_e)
        elif setpoint is None or not self._valid:
            v.step_velocity(0.0, 0.0, 0.0, 0.0, wind_n, wind_e)
        else:
            self._fly_trajectory(setpoint, wind_n, wind_e)

    def _fly_trajectory(self, s: Trajectory, wind_n: float, wind_e: float) -> None:
        v, params = self.vehicle, self.params
        vn, ve = (0.0, 0.0) if math.isnan(s.vn + s.ve) else (s.vn, s.ve)
        vu = 0.0 if s.vd != s.vd else -s.vd
        if not math.isnan(s.pn + s.pe):
            gain = float(params["MPC_XY_P"])
            vn += gain * (s.pn - (v.n - self.local_n))
            ve += gain * (s.pe - (v.e - self.local_e))
        if s.pd == s.pd:
            vu += float(params["MPC_Z_P"]) * (self.local_h - s.pd - v.h)
        else:
            vu += self._drift  # a velocity command only: heights wander (PX4.md, 4)
        if not math.isnan(s.an + s.ae):  # feed-forward shortens the lag; alone it has no velocity to lean on
            vn, ve = (v.vn + s.an, v.ve + s.ae) if math.isnan(s.vn) and math.isnan(s.pn) else (vn, ve)
            lead = 0.35
            vn, ve = vn + lead * s.an, ve + lead * s.ae
        vn, ve = limited(vn, ve, float(params["MPC_XY_VEL_MAX"]))
        if v.h <= 0.0 and vu <= 0.05:
            v.rest()
            return
        v.step_velocity(vn, ve, self.auto.climb_limited(vu), self._yaw_rate(s.yaw, s.yaw_rate), wind_n, wind_e)

    def _yaw_rate(self, yaw: float, yaw_rate: float) -> float:
        if math.isfinite(yaw):
            feed_forward = yaw_rate if math.isfinite(yaw_rate) else 0.0
            return self.vehicle.yaw_rate_to(yaw - self.yaw_error_rad, feed_forward, float(self.params["MC_YAW_P"]))
        return YAW_RATE_GAIN * yaw_rate if math.isfinite(yaw_rate) else 0.0

    def _fly_attitude(self, s: AttitudeTarget, wind_n: float, wind_e: float) -> None:
        v = self.vehicle
        thrust = _motors(s.thrust)
        if not math.isfinite(s.roll):  # q is NaN: the last rate setpoint flies on
            v.step_rates(*self._rates, thrust, wind_n, wind_e)
            return
        if s.level:
            v.step_attitude(0.0, 0.0, 0.0, thrust, wind_n, wind_e)
            return
        feed_forward = s.yaw_rate if math.isfinite(s.yaw_rate) else 0.0
        yaw_rate = v.yaw_rate_to(s.yaw - self.yaw_error_rad, feed_forward, float(self.params["MC_YAW_P"]))
        v.step_attitude(s.roll, s.pitch, yaw_rate, thrust, wind_n, wind_e)
        self._rates = body_rates(v.roll, v.pitch, v.roll_rate, v.pitch_rate, v.yaw_rate)


def _motors(thrust: float) -> float:
    """Return what motors make of a thrust setpoint: 0..1, and they stop for NaN (PX4.md, 3.6)."""
    return min(max(thrust, 0.0), 1.0) if math.isfinite(thrust) else 0.0
