"""What PX4 does with a multirotor in each mode: from modes and setpoints to velocities, tilts and falls."""

from __future__ import annotations

import math
import random

from sitl_stub.commander import INFO_TEXT, Commander
from sitl_stub.kinematics import AIRFRAME_MAX_M_S, YAW_RATE_GAIN, Multirotor
from sitl_stub.modes import Mode
from sitl_stub.offboard import AttitudeTarget, RatesTarget, Setpoint, Trajectory
from sitl_stub.params import Parameters
from sitl_stub.world import HOME_AMSL_M

SPOOL_UP_S = 1.9  # from the take-off command (or arming) to the first centimetre
TAKEOFF_RAMP_S = 1.2
TAKEOFF_ACCEPT_M = 0.3
STOPPED_M_S = 0.3
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
        self.home_n, self.home_e = vehicle.n, vehicle.e
        self.takeoff_height_m = math.nan
        self.yaw_error_rad = 0.0  # the autopilot's yaw minus the true one: it turns to what its compass says
        self._mode = commander.mode
        self._entered_s = 0.0
        self._hold: tuple[float, float] | None = None
        self._hold_h = vehicle.h
        self._leg = ""  # of a return
        self._told_default = True
        self._target_h = 0.0
        self._rates = (0.0, 0.0, 0.0)  # the last valid rate setpoint: PX4 flies it on through NaN
        self._random = random.Random(f"{seed}:drift")
        self._drift = 0.0
        self._drift_keep = math.exp(-0.1 / DRIFT_TAU_S)
        self._drift_kick = drift_m_s * math.sqrt(1.0 - self._drift_keep**2)
        self._next_drift_s = 0.0
        self._air_since_s = 0.0

    def begin_in_hold(self) -> None:
        """Hold from where it starts in the air."""
        self._enter(self._mode, 0.0)

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Fly this whenever the mode is OFFBOARD."""
        self.setpoint = setpoint
        self._valid = isinstance(setpoint, Trajectory) and setpoint.valid_for_multirotor()

    def step(self, now_s: float, wind_n: float, wind_e: float) -> None:
        """Fly one step in the commander's mode."""
        commander, v = self.commander, self.vehicle
        mode = commander.mode
        if mode is not self._mode:
            self._enter(mode, now_s)
        if now_s >= self._next_drift_s:
            self._next_drift_s += 0.1
            self._drift = self._drift * self._drift_keep + self._drift_kick * self._random.gauss(0.0, 1.0)
        if not commander.armed:
            self._entered_s = now_s  # spooling up begins with arming
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
            vn, ve, vu = self._auto(mode, now_s)
            v.step_velocity(vn, ve, vu, 0.0, wind_n, wind_e)

    def _enter(self, mode: Mode, now_s: float) -> None:
        up = self._mode is Mode.TAKEOFF and mode is Mode.HOLD
        self._mode, self._entered_s = mode, now_s
        self._hold, self._hold_h, self._leg = None, self._target_h if up else self.vehicle.h, ""
        if mode is Mode.TAKEOFF:
            asked = self.takeoff_height_m
            default = self.params["MIS_TAKEOFF_ALT"]
            self._target_h = self.vehicle.h + default if math.isnan(asked) else asked
            self._told_default = not math.isnan(asked)
            self.takeoff_height_m = math.nan
        elif mode is Mode.RTL:
            self._target_h = max(self.vehicle.h, float(self.params["RTL_RETURN_ALT"]))

    # -- AUTO modes ----------------------------------------------------------------------------------------------

    def _auto(self, mode: Mode, now_s: float) -> tuple[float, float, float]:
        if mode is Mode.TAKEOFF:
            return self._take_off(now_s)
        if mode is Mode.LAND:
            vn, ve = self._stay()
            return vn, ve, -self._descent()
        if mode is Mode.RTL:
            return self._return()
        vn, ve = self._stay()
        if self.vehicle.h <= 0.0 and self._hold_h <= 0.0:
            return 0.0, 0.0, 0.0
        return vn, ve, self._climb_to(self._hold_h)

    def _take_off(self, now_s: float) -> tuple[float, float, float]:
        if not self._told_default:
            self._told_default = True
            default = self.params["MIS_TAKEOFF_ALT"]
            self.commander.texts.append((INFO_TEXT, f"Using default takeoff altitude: {default:.1f} m\t"))
        if self.vehicle.h <= 0.0 and now_s - self._entered_s < SPOOL_UP_S:
            return 0.0, 0.0, 0.0
        if self.vehicle.h > self._target_h - TAKEOFF_ACCEPT_M:
            self.commander.mode_finished(Mode.HOLD)
        vn, ve = self._stay()
        ramp = 1.0
        if self._hold_h <= 0.1:  # from the ground
            ramp = min(1.0, (now_s - self._entered_s - SPOOL_UP_S) / TAKEOFF_RAMP_S)
        # Measured: 1.2-1.4 m/s over the first metres, 2 m/s above ten.
        high = min(max((self.vehicle.h - 5.0) / 5.0, 0.0), 1.0)
        limit = max(0.2, ramp * (0.85 + 0.45 * high) * float(self.params["MPC_TKO_SPEED"]))
        return vn, ve, min(max(self._climb_to(self._target_h), 0.2), limit)

    def _return(self) -> tuple[float, float, float]:
        v = self.vehicle
        off_n, off_e = self.home_n - v.n, self.home_e - v.e
        distance = math.hypot(off_n, off_e)
        if self._leg == "":
            self._leg = "climb"
            self.commander.texts.append(
                (INFO_TEXT, f"RTL: start return at {v.h + HOME_AMSL_M:.0f} m ({v.h:.0f} m above destination)\t")
            )
        if self._leg == "climb":
            if v.h >= self._target_h - 0.5:
                self._leg = "home"
            return (*self._stay(), self._climb_to(self._target_h))
        if self._leg == "home":
            if distance < 1.0:
                self._leg = "land"
            return (*self._towards(self.home_n, self.home_e), self._climb_to(self._target_h))
        return (*self._towards(self.home_n, self.home_e), -self._descent())

    def _stay(self) -> tuple[float, float]:
        v = self.vehicle
        if self._hold is None:
            if math.hypot(v.vn, v.ve) > STOPPED_M_S:
                return 0.0, 0.0
            self._hold = v.n, v.e
        return self._towards(*self._hold)

    def _towards(self, north_m: float, east_m: float) -> tuple[float, float]:
        gain = float(self.params["MPC_XY_P"])
        vn, ve = gain * (north_m - self.vehicle.n), gain * (east_m - self.vehicle.e)
        return _limited(vn, ve, float(self.params["MPC_XY_CRUISE"]))

    def _climb_to(self, height_m: float) -> float:
        return self._climb_limited(float(self.params["MPC_Z_P"]) * (height_m - self.vehicle.h))

    def _climb_limited(self, climb_m_s: float) -> float:
        down = max(-self.params["MPC_Z_VEL_MAX_DN"], -AIRFRAME_MAX_M_S)
        up = min(self.params["MPC_Z_VEL_MAX_UP"], AIRFRAME_MAX_M_S)
        return down if climb_m_s < down else up if climb_m_s > up else climb_m_s

    def _descent(self) -> float:
        fast = self.vehicle.h > self.params["MPC_LAND_ALT1"]
        speed = float(self.params["MPC_Z_VEL_MAX_DN" if fast else "MPC_LAND_SPEED"])
        return min(max(speed, 0.1), AIRFRAME_MAX_M_S)

    # -- stick modes ---------------------------------------------------------------------------------------------

    def _by_stick(self, mode: Mode, now_s: float, wind_n: float, wind_e: float) -> None:
        v = self.vehicle
        sink, tau_s = STICKLESS[mode]
        if not self.commander.sticks_ok(now_s):
            v.step_drift(sink, tau_s, 0.0 if mode is Mode.POSCTL else wind_n, 0.0 if mode is Mode.POSCTL else wind_e)
            return
        forward, right, up, clockwise = (0.0 if abs(s) < 0.1 else s for s in self.sticks)
        c, s = math.cos(v.yaw), math.sin(v.yaw)
        climb = STICK_CLIMB_M_S * up
        if v.h <= 0.0 and climb <= 0.0:
            climb = 0.0
        vn, ve = STICK_SPEED_M_S * (forward * c - right * s), STICK_SPEED_M_S * (forward * s + right * c)
        if forward == right == 0.0 and mode is Mode.POSCTL:
            vn, ve = self._stay()
        else:
            self._hold = None
        v.step_velocity(vn, ve, self._climb_limited(climb), STICK_YAW_RAD_S * clockwise, wind_n, wind_e)

    # -- OFFBOARD ------------------------------------------------------------------------------------------------

    def _offboard(self, wind_n: float, wind_e: float) -> None:
        v, setpoint = self.vehicle, self.setpoint
        if isinstance(setpoint, AttitudeTarget):
            self._fly_attitude(setpoint, wind_n, wind_e)
        elif isinstance(setpoint, RatesTarget):
            if math.isfinite(setpoint.roll_rate + setpoint.pitch_rate + setpoint.yaw_rate):
                self._rates = (setpoint.roll_rate, setpoint.pitch_rate, setpoint.yaw_rate)
            thrust = setpoint.thrust if math.isfinite(setpoint.thrust) else 0.0
            v.step_rates(*self._rates, thrust, wind_n, wind_e)
        elif setpoint is None or not self._valid:
            v.step_velocity(0.0, 0.0, 0.0, 0.0, wind_n, wind_e)
        else:
            self._fly_trajectory(setpoint, wind_n, wind_e)

    def _fly_trajectory(self, s: Trajectory, wind_n: float, wind_e: float) -> None:
        v, params = self.vehicle, self.params
        vn, ve = (0.0, 0.0) if s.vn != s.vn else (s.vn, s.ve)
        vu = 0.0 if s.vd != s.vd else -s.vd
        if s.pn == s.pn:
            gain = float(params["MPC_XY_P"])
            vn += gain * (s.pn - (v.n - self.local_n))
            ve += gain * (s.pe - (v.e - self.local_e))
        if s.pd == s.pd:
            vu += float(params["MPC_Z_P"]) * (self.local_h - s.pd - v.h)
        else:
            vu += self._drift  # a velocity command only: heights wander (PX4.md, 4)
        if s.an == s.an:  # feed-forward shortens the lag; alone it has no velocity to lean on
            vn, ve = (v.vn + s.an, v.ve + s.ae) if math.isnan(s.vn) and math.isnan(s.pn) else (vn, ve)
            lead = 0.35
            vn, ve = vn + lead * s.an, ve + lead * s.ae
        vn, ve = _limited(vn, ve, float(params["MPC_XY_VEL_MAX"]))
        if v.h <= 0.0 and vu <= 0.05:
            v.rest()
            return
        v.step_velocity(vn, ve, self._climb_limited(vu), self._yaw_rate(s.yaw, s.yaw_rate), wind_n, wind_e)

    def _yaw_rate(self, yaw: float, yaw_rate: float) -> float:
        if math.isfinite(yaw):
            feed_forward = yaw_rate if math.isfinite(yaw_rate) else 0.0
            return self.vehicle.yaw_rate_to(yaw - self.yaw_error_rad, feed_forward, float(self.params["MC_YAW_P"]))
        return YAW_RATE_GAIN * yaw_rate if math.isfinite(yaw_rate) else 0.0

    def _fly_attitude(self, s: AttitudeTarget, wind_n: float, wind_e: float) -> None:
        v = self.vehicle
        thrust = s.thrust if math.isfinite(s.thrust) else 0.0  # NaN: the motors stop (PX4.md, 3.6)
        thrust = min(max(thrust, 0.0), 1.0)
        if not math.isfinite(s.roll):  # q is NaN: the last rate setpoint flies on
            v.step_rates(*self._rates, thrust, wind_n, wind_e)
            return
        if s.level:
            v.step_attitude(0.0, 0.0, 0.0, thrust, wind_n, wind_e)
            return
        feed_forward = s.yaw_rate if math.isfinite(s.yaw_rate) else 0.0
        yaw_rate = v.yaw_rate_to(s.yaw - self.yaw_error_rad, feed_forward, float(self.params["MC_YAW_P"]))
        v.step_attitude(s.roll, s.pitch, yaw_rate, thrust, wind_n, wind_e)
        self._rates = (v.roll_rate, v.pitch_rate, v.yaw_rate)


def _limited(north: float, east: float, limit: float) -> tuple[float, float]:
    size, limit = math.hypot(north, east), min(max(limit, 0.0), AIRFRAME_MAX_M_S)
    return (north, east) if size <= limit else (north * limit / size, east * limit / size)
