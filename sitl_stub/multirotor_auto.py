"""The AUTO modes of a multirotor: take-off, hold, land, return, as velocities."""

from __future__ import annotations

import math

from sitl_stub.commander import INFO_TEXT, Commander
from sitl_stub.kinematics import AIRFRAME_MAX_M_S, Multirotor
from sitl_stub.modes import Mode
from sitl_stub.params import Parameters
from sitl_stub.world import HOME_AMSL_M

SPOOL_UP_S = 1.9  # from the take-off command (or arming) to the first centimetre
TAKEOFF_RAMP_S = 1.2
TAKEOFF_ACCEPT_M = 0.3
STOPPED_M_S = 0.3
NEARLY_UP_M = 1.0


class AutoModes:
    """What PX4 flies by itself. `enter` a mode, then ask for its `velocity` every step."""

    def __init__(self, vehicle: Multirotor, commander: Commander, params: Parameters) -> None:
        self.vehicle, self.commander, self.params = vehicle, commander, params
        self.home_n, self.home_e = vehicle.n, vehicle.e
        self.takeoff_height_m = math.nan  # asked for; NaN: MIS_TAKEOFF_ALT
        self.wanted: tuple[float, float, float] | None = None  # north, east, height, by DO_REPOSITION
        self.entered_s = 0.0
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
        if mode is Mode.TAKEOFF:
            asked = self.takeoff_height_m
            default = self.params["MIS_TAKEOFF_ALT"]
            self._target_h = self.vehicle.h + default if math.isnan(asked) else asked
            self._told_default = not math.isnan(asked)
            self.takeoff_height_m = math.nan
        elif mode is Mode.RTL:
            self._target_h = max(self.vehicle.h, float(self.params["RTL_RETURN_ALT"]))

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
        if self.vehicle.h <= 0.0 and now_s - self.entered_s < SPOOL_UP_S:
            return 0.0, 0.0, 0.0
        if self.vehicle.h > self._target_h - TAKEOFF_ACCEPT_M:
            self.commander.mode_finished(Mode.HOLD)
        vn, ve = self.stay()
        ramp = 1.0
        if self._hold_h <= 0.1:  # from the ground
            ramp = min(1.0, (now_s - self.entered_s - SPOOL_UP_S) / TAKEOFF_RAMP_S)
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
            return (*self.stay(), self._climb_to(self._target_h))
        if self._leg == "home":
            if distance < 1.0:
                self._leg = "land"
            return (*self._towards(self.home_n, self.home_e), self._climb_to(self._target_h))
        return (*self._towards(self.home_n, self.home_e), -self._descent())

    def stay(self) -> tuple[float, float]:
        """Return the velocity that brakes and then holds the place."""
        v = self.vehicle
        if self._hold is None:
            if math.hypot(v.vn, v.ve) > STOPPED_M_S:
                return 0.0, 0.0
            self._hold = v.n, v.e
        return self._towards(*self._hold)

    def _towards(self, north_m: float, east_m: float) -> tuple[float, float]:
        gain = float(self.params["MPC_XY_P"])
        vn, ve = gain * (north_m - self.vehicle.n), gain * (east_m - self.vehicle.e)
        return limited(vn, ve, float(self.params["MPC_XY_CRUISE"]))

    def _climb_to(self, height_m: float) -> float:
        return self.climb_limited(float(self.params["MPC_Z_P"]) * (height_m - self.vehicle.h))

    def climb_limited(self, climb_m_s: float) -> float:
        """Return a climb rate within the parameters' limits."""
        down = max(-self.params["MPC_Z_VEL_MAX_DN"], -AIRFRAME_MAX_M_S)
        up = min(self.params["MPC_Z_VEL_MAX_UP"], AIRFRAME_MAX_M_S)
        return down if climb_m_s < down else up if climb_m_s > up else climb_m_s

    def _descent(self) -> float:
        fast = self.vehicle.h > self.params["MPC_LAND_ALT1"]
        speed = float(self.params["MPC_Z_VEL_MAX_DN" if fast else "MPC_LAND_SPEED"])
        return min(max(speed, 0.1), AIRFRAME_MAX_M_S)


def limited(north: float, east: float, limit: float) -> tuple[float, float]:
    """Return a horizontal velocity cut to a limit, and to what the airframe can do [m/s]."""
    size, limit = math.hypot(north, east), min(max(limit, 0.0), AIRFRAME_MAX_M_S)
    return (north, east) if size <= limit else (north * limit / size, east * limit / size)
