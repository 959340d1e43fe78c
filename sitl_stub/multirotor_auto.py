"""The AUTO modes of a multirotor: take-off, hold, land, return, as velocities.

Take-off and climb were fitted to a recorded take-off of PX4 to 30 m, whose setpoints show how PX4 makes them:

* COM_SPOOLUP_TIME after arming the thrust begins to rise; 0.8 s later the land detector lets go ("Takeoff detected");
* the speed that is allowed then grows by MPC_TKO_SPEED in MPC_TKO_RAMP_T, but the thrust trails what hovering takes: it
  leaves the ground at 57 % of the ramp and comes up to MPC_TKO_SPEED like a lag of 1.15 s, the climb's own included;
* above MPC_LAND_ALT1 the climb goes on at up to MPC_Z_V_AUTO_UP, along a height setpoint that approaches its aim with
  0.5 / s and runs slower than time, by its horizontal tracking error over MPC_XY_ERR_MAX: 0.5 m of 2 m on the way up;
* the take-off is over NAV_MC_ALT_RAD below its aim, and Hold brings up the rest.
"""

from __future__ import annotations

import math

from sitl_stub.commander import INFO_TEXT, Commander
from sitl_stub.kinematics import AIRFRAME_MAX_M_S, CLIMB_TAU_S, Multirotor
from sitl_stub.modes import Mode
from sitl_stub.params import Parameters
from sitl_stub.world import HOME_AMSL_M

SPOOL_UP_S = 1.0  # COM_SPOOLUP_TIME
DETECTED_S = 0.82  # from the start of the ramp until the land detector sees thrust
RAMP_FROM_S, LIFT_OFF_SHARE = 1.42, 0.57
LIFT_TAU_S = 1.15 - CLIMB_TAU_S
TRAJECTORY_GAIN_PER_S = 0.5
APPROACH_GAIN_PER_S, ARRIVED_M = 0.6, 2.0  # of the way home: 4 m/s are left at 7 m, and it lands from 2 m on
TRACKING_ERROR_M = 0.5
STOPPED_M_S = 0.3
NEARLY_UP_M = 1.0


class Climb:
    """PX4's vertical trajectory: a height setpoint that moves towards an aim, and the velocity that follows it."""

    def __init__(self, vehicle: Multirotor, params: Parameters) -> None:
        self.vehicle, self.params = vehicle, params
        self.h, self.v = vehicle.h, 0.0

    def ride(self, v_m_s: float) -> float:
        """Move the setpoint along with the vehicle, and return the velocity as it is."""
        self.h, self.v = self.vehicle.h, v_m_s
        return v_m_s

    def towards(self, height_m: float) -> float:
        """Return the velocity up [m/s] of one step towards a height."""
        params, dt = self.params, self.vehicle.dt_s
        if self.h == height_m:
            return float(params["MPC_Z_P"]) * (height_m - self.vehicle.h)
        down, up = float(params["MPC_Z_V_AUTO_DN"]), float(params["MPC_Z_V_AUTO_UP"])
        wanted = min(max(TRAJECTORY_GAIN_PER_S * (height_m - self.h), -down), up)
        most = float(params["MPC_ACC_UP_MAX" if wanted > self.v else "MPC_ACC_DOWN_MAX"]) / 2.0 * dt  # limited jerk
        self.v += min(max(wanted - self.v, -most), most)
        slowed = max(0.0, 1.0 - TRACKING_ERROR_M / max(float(params["MPC_XY_ERR_MAX"]), 0.1))
        self.h += slowed * self.v * dt
        if abs(height_m - self.h) < 1e-3 and abs(self.v) < 1e-2:
            self.h, self.v = height_m, 0.0
        return self.v + float(params["MPC_Z_P"]) * (self.h - self.vehicle.h)


class AutoModes:
    """What PX4 flies by itself. `enter` a mode, then ask for its `velocity` every step."""

    def __init__(self, vehicle: Multirotor, commander: Commander, params: Parameters) -> None:
        self.vehicle, self.commander, self.params = vehicle, commander, params
        self.home_n, self.home_e = vehicle.n, vehicle.e
        self.takeoff_height_m = math.nan  # asked for; NaN: MIS_TAKEOFF_ALT
        self.wanted: tuple[float, float, float] | None = None  # north, east, height, by DO_REPOSITION
        self.entered_s = self.armed_s = 0.0
        self.pushing = False  # the motors of a take-off push, and the land detector has seen it
        self._climb = Climb(vehicle, params)
        self._from_ground = False
        self._mode = commander.mode
        self._hold: tuple[float, float] | None = None
        self._hold_h = vehicle.h
        self._target_h = 0.0
        self._told_default = True
        self._leg = ""  # of a return

    def enter(self, mode: Mode, now_s: float) -> None:
        """Begin a mode from the present place."""
        # The end of a take-off keeps its height as the aim; a pilot's Hold on the way up stays where it is.
        nearly = abs(self._target_h - self.vehicle.h) < NEARLY_UP_M
        up = self._mode is Mode.TAKEOFF and mode is Mode.HOLD and nearly
        self._mode, self.entered_s = mode, now_s
        self._hold, self._hold_h, self._leg = None, self._target_h if up else self.vehicle.h, ""
        self.pushing = False
        if not up:
            self._climb.ride(0.0)
        if mode is Mode.TAKEOFF:
            self._from_ground = self.vehicle.h <= 0.0
            asked = self.takeoff_height_m
            default = self.params["MIS_TAKEOFF_ALT"]
            self._target_h = self.vehicle.h + default if math.isnan(asked) else asked
            self._told_default = not math.isnan(asked)
            self.takeoff_height_m = math.nan
        elif mode is Mode.RTL:
            self._target_h = max(self.vehicle.h, float(self.params["RTL_RETURN_ALT"]))

    @property
    def landing(self) -> bool:
        """Whether it comes down to land."""
        return self._mode is Mode.LAND or (self._mode is Mode.RTL and self._leg == "land")

    def let_go(self) -> None:
        """Forget the place that is held."""
        self._hold = None

    def _go_to_wanted(self) -> None:
        assert self.wanted is not None
        north_m, east_m, height_m = self.wanted
        self.wanted = None
        if math.isfinite(north_m + east_m):
            self._hold = north_m, east_m
        if math.isfinite(height_m):
            self._hold_h = height_m

    def velocity(self, mode: Mode, now_s: float) -> tuple[float, float, float]:
        """Return the velocity north, east, up [m/s] that the mode flies now."""
        if mode is Mode.TAKEOFF:
            return self._take_off(now_s)
        if mode is Mode.LAND:
            vn, ve = self.stay()
            return vn, ve, -self._descent()
        if mode is Mode.RTL:
            return self._return()
        if self.wanted is not None:
            self._go_to_wanted()
        vn, ve = self.stay()
        if self.vehicle.h <= 0.0 and self._hold_h <= 0.0:
            return 0.0, 0.0, 0.0
        return vn, ve, self._climb_to(self._hold_h)

    def _take_off(self, now_s: float) -> tuple[float, float, float]:
        if not self._told_default:
            self._told_default = True
            default = self.params["MIS_TAKEOFF_ALT"]
            self.commander.texts.append((INFO_TEXT, f"Using default takeoff altitude: {default:.1f} m\t"))
        if self.vehicle.h > self._target_h - float(self.params["NAV_MC_ALT_RAD"]):
            self.commander.mode_finished(Mode.HOLD)
        vn, ve = self.stay()
        if not self._from_ground or self.vehicle.h > self.params["MPC_LAND_ALT1"]:
            return vn, ve, self._climb_to(self._target_h)
        lifted_s = self._since_lift_off(now_s)
        if lifted_s < 0.0:
            return 0.0, 0.0, 0.0
        speed = float(self.params["MPC_TKO_SPEED"]) * -math.expm1(-lifted_s / LIFT_TAU_S)
        wanted = TRAJECTORY_GAIN_PER_S * (self._target_h - self.vehicle.h)
        return vn, ve, self.climb_limited(self._climb.ride(max(0.02, min(speed, wanted))))

    def _since_lift_off(self, now_s: float) -> float:
        """Return how long the vehicle has had the thrust to climb [s], negative while it has not."""
        ramping_s = now_s - max(self.entered_s, self.armed_s + SPOOL_UP_S)
        self.pushing = ramping_s >= DETECTED_S
        return ramping_s - RAMP_FROM_S - LIFT_OFF_SHARE * float(self.params["MPC_TKO_RAMP_T"])

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
            return (*self.stay(), self._climb_to(self._target_h))
        if self._leg == "home":
            if distance < ARRIVED_M:
                self._leg = "land"
            return (*self._towards(self.home_n, self.home_e, APPROACH_GAIN_PER_S), self._climb_to(self._target_h))
        return (*self._towards(self.home_n, self.home_e, APPROACH_GAIN_PER_S), -self._descent())

    def stay(self) -> tuple[float, float]:
        """Return the velocity that brakes and then holds the place."""
        v = self.vehicle
        if self._hold is None:
            if math.hypot(v.vn, v.ve) > STOPPED_M_S:
                return 0.0, 0.0
            self._hold = v.n, v.e
        return self._towards(*self._hold, float(self.params["MPC_XY_P"]))

    def _towards(self, north_m: float, east_m: float, gain: float) -> tuple[float, float]:
        vn, ve = gain * (north_m - self.vehicle.n), gain * (east_m - self.vehicle.e)
        return limited(vn, ve, float(self.params["MPC_XY_CRUISE"]))

    def _climb_to(self, height_m: float) -> float:
        return self.climb_limited(self._climb.towards(height_m))

    def climb_limited(self, climb_m_s: float) -> float:
        """Return a climb rate within the parameters' limits."""
        down = -min(max(self.params["MPC_Z_VEL_MAX_DN"], 0.0), AIRFRAME_MAX_M_S)
        up = min(max(self.params["MPC_Z_VEL_MAX_UP"], 0.0), AIRFRAME_MAX_M_S)
        return down if climb_m_s < down else up if climb_m_s > up else climb_m_s

    def _descent(self) -> float:
        high, low = float(self.params["MPC_LAND_ALT1"]), float(self.params["MPC_LAND_ALT2"])
        share = min(max((self.vehicle.h - low) / max(high - low, 0.1), 0.0), 1.0)
        slow, fast = float(self.params["MPC_LAND_SPEED"]), float(self.params["MPC_Z_V_AUTO_DN"])
        return min(max(slow + share * (fast - slow), 0.1), AIRFRAME_MAX_M_S)


FAST_M_S = 1e6


def limited(north: float, east: float, limit: float) -> tuple[float, float]:
    """Return a horizontal velocity cut to a limit, and to what the airframe can do [m/s]."""
    north, east = (min(max(v, -FAST_M_S), FAST_M_S) for v in (north, east))  # infinite ones have no direction
    size, limit = math.hypot(north, east), min(max(limit, 0.0), AIRFRAME_MAX_M_S)
    return (north, east) if size <= limit else (north * limit / size, east * limit / size)
