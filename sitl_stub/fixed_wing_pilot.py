"""What PX4 does with an airplane in each mode (PX4.md, 5): attitudes, paths with curvature, loiters.

PX4 takes the direction of a velocity setpoint and not its size: the airspeed is FW_AIRSPD_TRIM's, always.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl_stub.commander import CRITICAL_TEXT, INFO_TEXT, Commander
from sitl_stub.fixed_wing import THRUST, FixedWing, level_alpha, level_drag
from sitl_stub.kinematics import G, wrap
from sitl_stub.modes import Mode
from sitl_stub.offboard import AttitudeTarget, RatesTarget, Setpoint, Trajectory
from sitl_stub.params import Parameters
from sitl_stub.world import HOME_AMSL_M, calibrated_per_true

COURSE_GAIN_PER_S = 0.9  # course error [rad] -> turn rate
TRACK_GAIN_PER_M = 0.025  # cross-track error -> intercept angle, through an arc tangent
CLIMB_GAIN_PER_S = 0.35
CLIMB_MAX_M_S, SINK_MAX_M_S = 4.5, 3.0
SPEED_GAIN = 0.08  # thrust per m/s
TAKEOFF_PITCH, ROTATE_M_S, SPOOL_UP_S = math.radians(27.0), 7.0, 1.0
LEAST_RADIUS_M = 20.0
FAILURE_ROLL = math.radians(60.0)  # FD_FAIL_R


class Path(NamedTuple):
    """A line or arc through a place: north, east [m], direction [rad from north], curvature [1/m, + to the right]."""

    n: float
    e: float
    course: float
    curvature: float


class FixedWingPilot:
    """Steps a FixedWing through PX4's modes."""

    pushing = False  # it leaves the ground in the moment that its lift carries it

    def __init__(self, vehicle: FixedWing, commander: Commander, params: Parameters, airspeed_scale: float) -> None:
        self.vehicle, self.commander, self.params = vehicle, commander, params
        self.setpoint: Setpoint | None = None
        self.sticks = (0.0, 0.0, 0.0, 0.0)
        self.local_n, self.local_e, self.local_h = vehicle.n, vehicle.e, 0.0
        self.home_n, self.home_e = vehicle.n, vehicle.e
        self._takeoff_height_m = math.nan
        self._airspeed_scale = airspeed_scale  # what the sensor shows / calibrated airspeed
        self._mode = commander.mode
        self._entered_s = 0.0
        self._wanted: tuple[float, float, float] | None = None  # by DO_REPOSITION
        self._centre = (vehicle.n, vehicle.e)
        self._height = vehicle.h
        self._course = vehicle.yaw
        self._flown = (0.0, vehicle.pitch, vehicle.thrust)  # the last attitude setpoint, frozen when nothing new counts
        self._rates = (0.0, 0.0, 0.0)
        self._overbanked = False

    @property
    def landing(self) -> bool:
        """Whether it comes down to land."""
        return self._mode is Mode.LAND

    def begin_in_hold(self) -> None:
        """Loiter from where it starts in the air."""
        self._enter(self._mode, 0.0)

    def go_to(self, north_m: float, east_m: float, height_m: float) -> None:
        """Loiter somewhere else; NaN: as it is. It does so from the next step on if the mode is Hold by then."""
        self._wanted = (north_m, east_m, height_m)

    def _go_to_wanted(self) -> None:
        assert self._wanted is not None
        north_m, east_m, height_m = self._wanted
        self._wanted = None
        if math.isfinite(north_m + east_m):
            self._centre = (north_m, east_m)
        if math.isfinite(height_m):
            self._height = height_m

    def take_off_to(self, height_m: float) -> None:
        """Take off to this height when the mode is Takeoff next; NaN: MIS_TAKEOFF_ALT above here."""
        self._takeoff_height_m = height_m

    def set_home(self, north_m: float, east_m: float) -> None:
        """Let Return lead here."""
        self.home_n, self.home_e = north_m, east_m

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Fly this whenever the mode is OFFBOARD."""
        self.setpoint = setpoint

    def step(self, now_s: float, wind_n: float, wind_e: float) -> None:
        """Fly one step in the commander's mode."""
        mode, v = self.commander.mode, self.vehicle
        if mode is not self._mode:
            self._enter(mode, now_s)
        if not self.commander.armed or mode is Mode.TERMINATION:
            self._entered_s = now_s
            v.step_attitude(v.roll, v.pitch, 0.0, wind_n, wind_e)
            return
        if mode is Mode.OFFBOARD:
            self._offboard(wind_n, wind_e)
        else:
            v.step_attitude(*self._auto(mode, now_s), wind_n, wind_e)
            self._flown = (v.roll, v.pitch, v.thrust)
        self._watch_bank()

    def _enter(self, mode: Mode, now_s: float) -> None:
        v = self.vehicle
        self._mode, self._entered_s = mode, now_s
        self._height, self._course = v.h, math.atan2(v.ve, v.vn) if v.airspeed > 2.0 else v.yaw
        self._centre = (v.n, v.e)  # around where it is: it flies out first, as PX4 does
        if mode is Mode.TAKEOFF:
            asked = self._takeoff_height_m
            self._height = v.h + float(self.params["MIS_TAKEOFF_ALT"]) if math.isnan(asked) else asked
            self._takeoff_height_m = math.nan
        elif mode is Mode.RTL:
            self._centre = (self.home_n, self.home_e)
            self._height = max(v.h, float(self.params["RTL_RETURN_ALT"]))
            above = f"{v.h + HOME_AMSL_M:.0f} m ({v.h:.0f} m above destination)"
            self.commander.texts.append((INFO_TEXT, f"RTL: start return at {above}\t"))

    def _auto(self, mode: Mode, now_s: float) -> tuple[float, float, float]:
        v = self.vehicle
        if mode is Mode.TAKEOFF:
            return self._take_off(now_s)
        if v.h <= 0.0:
            return 0.0, 0.0, 0.0
        if mode is Mode.STABILIZED:
            return 0.0, 0.0, 0.0  # no stick: level, no throttle
        if mode in (Mode.POSCTL, Mode.ALTCTL):  # no stick: straight away, for ever (PX4.md, 5.3)
            return self._towards(self._course, 0.0, self._height)
        if mode is Mode.LAND:
            self._height = max(-2.0, self._height - 1.5 * v.dt_s)
        if self._wanted is not None and mode is Mode.HOLD:
            self._go_to_wanted()
        return self._circle(*self._centre, self._loiter_radius(), self._height)

    def _take_off(self, now_s: float) -> tuple[float, float, float]:
        v = self.vehicle
        if now_s - self._entered_s < SPOOL_UP_S and v.h <= 0.0:
            return 0.0, 0.0, 0.0
        if v.h > self._height - 2.0:
            self.commander.mode_finished(Mode.HOLD)
        if v.h < self._height - 12.0:
            return 0.0, TAKEOFF_PITCH if v.airspeed > ROTATE_M_S else 0.0, 1.0
        return self._towards(self._course, 0.0, self._height)

    # -- guidance ------------------------------------------------------------------------------------------------

    def _towards(self, course: float, turn_rate: float, height_m: float) -> tuple[float, float, float]:
        """Return roll, pitch, thrust that fly a course [rad] with a turn rate [rad/s] and go to a height."""
        v = self.vehicle
        flown = math.atan2(v.ve, v.vn)
        ground = max(5.0, math.hypot(v.vn, v.ve))
        rate = turn_rate + COURSE_GAIN_PER_S * wrap(course - flown)
        limit = math.radians(float(self.params["FW_R_LIM"]))
        roll = max(-limit, min(limit, math.atan(ground * rate / G)))
        return (roll, *self._energy(roll, height_m))

    def _energy(self, roll: float, height_m: float) -> tuple[float, float]:
        v = self.vehicle
        shown = v.airspeed * self._airspeed_scale * calibrated_per_true(v.h)
        climb = max(-SINK_MAX_M_S, min(CLIMB_MAX_M_S, CLIMB_GAIN_PER_S * (height_m - v.h)))
        if shown < float(self.params["FW_AIRSPD_MIN"]):
            climb = min(climb, 0.0)  # speed before height
        gamma = math.asin(max(-0.5, min(0.5, climb / max(v.airspeed, 5.0))))
        load = math.cos(gamma) / max(0.3, math.cos(roll))
        pitch = gamma + level_alpha(v.airspeed, load)
        low, high = math.radians(float(self.params["FW_P_LIM_MIN"])), math.radians(float(self.params["FW_P_LIM_MAX"]))
        thrust = (level_drag(v.airspeed, load) + G * math.sin(gamma)) / THRUST
        thrust += SPEED_GAIN * (float(self.params["FW_AIRSPD_TRIM"]) - shown)
        return max(low, min(high, pitch)), max(0.0, min(1.0, thrust))

    def _circle(self, n: float, e: float, radius: float, height_m: float) -> tuple[float, float, float]:
        v = self.vehicle
        off_n, off_e = v.n - n, v.e - e
        distance = math.hypot(off_n, off_e)
        if distance < 0.3 * radius:
            return self._towards(self._course, 0.0, height_m)
        if distance > 1.5 * radius:
            self._course = math.atan2(-off_e, -off_n)
            return self._towards(self._course, 0.0, height_m)
        tangent = math.atan2(off_e, off_n) + math.pi / 2  # clockwise
        inwards = math.atan(2.0 * (distance - radius) / radius)
        close = abs(distance - radius) < 0.5 * radius
        rate = math.hypot(v.vn, v.ve) / radius if close else 0.0
        return self._towards(tangent + inwards, rate, height_m)

    def _follow(self, path: Path, height_m: float) -> tuple[float, float, float]:
        v = self.vehicle
        off_n, off_e = v.n - path.n, v.e - path.e
        right_of = off_e * math.cos(path.course) - off_n * math.sin(path.course)
        course = path.course - math.atan(TRACK_GAIN_PER_M * right_of)
        return self._towards(course, path.curvature * math.hypot(v.vn, v.ve), height_m)

    # -- OFFBOARD ------------------------------------------------------------------------------------------------

    def _offboard(self, wind_n: float, wind_e: float) -> None:
        v, s = self.vehicle, self.setpoint
        if isinstance(s, RatesTarget):
            if math.isfinite(s.roll_rate + s.pitch_rate + s.yaw_rate):
                self._rates = (s.roll_rate, s.pitch_rate, s.yaw_rate)
            v.step_rates(*self._rates, _or_zero(s.thrust), wind_n, wind_e)
            return
        if isinstance(s, AttitudeTarget):
            if not math.isfinite(s.roll):  # q is NaN: the last rate setpoint, that of the turn, goes on; the bank stays
                v.step_attitude(v.roll, v.pitch, _or_zero(s.thrust), wind_n, wind_e)
                return
            self._flown = (s.roll, s.pitch, _or_zero(s.thrust))
        elif isinstance(s, Trajectory):
            self._flown = self._trajectory(s) or self._flown
        v.step_attitude(*self._flown, wind_n, wind_e)

    def _trajectory(self, s: Trajectory) -> tuple[float, float, float] | None:
        """Return what a trajectory setpoint makes PX4 fly; None if it changes nothing (velocity without a place)."""
        if s.pn != s.pn or s.pe != s.pe or s.pd != s.pd:
            return None
        n, e, height_m = s.pn + self.local_n, s.pe + self.local_e, self.local_h - s.pd
        speed = math.hypot(s.vn, s.ve)
        if not speed > 0.0:
            return self._to_point(n, e, height_m)
        curvature = 0.0
        if s.an == s.an and s.ae == s.ae:
            curvature = (s.vn * s.ae - s.ve * s.an) / speed**3
        return self._follow(Path(n, e, math.atan2(s.ve, s.vn), curvature), height_m)

    def _loiter_radius(self) -> float:
        return max(LEAST_RADIUS_M, float(self.params["NAV_LOITER_RAD"]))

    def _to_point(self, n: float, e: float, height_m: float) -> tuple[float, float, float]:
        v = self.vehicle
        radius = self._loiter_radius()
        if math.hypot(n - v.n, e - v.e) < 1.5 * radius:
            return self._circle(n, e, radius, height_m)
        return self._towards(math.atan2(e - v.e, n - v.n), 0.0, height_m)

    def _watch_bank(self) -> None:
        """PX4's failure detector complains about a steep bank, and the flight goes on."""
        steep = abs(self.vehicle.roll) > FAILURE_ROLL
        if steep and not self._overbanked:
            self.commander.texts.append((CRITICAL_TEXT, "Preflight Fail: Attitude failure (roll)\t"))
            self.commander.texts.append((CRITICAL_TEXT, "Failsafe activated\t"))
        self._overbanked = steep


def _or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0
