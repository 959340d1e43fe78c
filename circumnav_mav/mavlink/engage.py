"""`engage: auto`: arm, take off, ask for OFFBOARD, for a vehicle that is disarmed on the ground at first sight.

Anything else (armed, in the air, a pilot who changes the mode on the way) is left to the pilot, as with engage: pilot.
"""

from __future__ import annotations

from enum import StrEnum
from math import isnan, nan

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import STATUS_STANDBY
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.link import AutopilotLink

ARM, TAKE_OFF = "arming", "take-off"
ARRIVED_SHARE = 0.95
ARRIVED_WITHIN_M = 1.0
CLIMB_SLOWEST_M_S = 0.4
CLIMB_MARGIN_S = 20.0


class Step(StrEnum):
    """Where the sequence stands."""

    WAITING = "waiting until the autopilot is ready to arm"
    ARMING = "arming"
    TAKING_OFF = "asking for take-off"
    CLIMBING = "taking off"
    ASKED = "asking for Offboard"
    LEFT_TO_PILOT = "the pilot engages"
    FAILED = "failed"


class AutoEngage:
    """The sequence; `height_m` is the height above the take-off point to climb to."""

    def __init__(self, link: AutopilotLink, height_m: float) -> None:
        self._link = link
        self._height_m = height_m
        self._by_s = nan
        self._decided = False
        self.step = Step.WAITING
        self.problem = ""

    def tick(self, now_s: float, *, ready: bool) -> None:
        """Do what is due. ready: the beacon is heard, so that there is something to fly to."""
        ap = self._link.autopilot
        if not self._decided:
            self._decided = self._decide()
        elif self.step is Step.WAITING:
            if ready and ap.system_status == STATUS_STANDBY and not isnan(ap.amsl_m):
                self._link.commands.push(enums.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, purpose=ARM)
                self.step = Step.ARMING
        elif self.step is Step.ARMING:
            self._after(ARM, self._take_off)
        elif self.step is Step.TAKING_OFF:
            if self._after(TAKE_OFF, self._climb):
                self._by_s = now_s + self._height_m / CLIMB_SLOWEST_M_S + CLIMB_MARGIN_S
        elif self.step is Step.CLIMBING:
            self._watch_climb(now_s)
        elif self.step is Step.ASKED and self._link.authority.refused:
            self._fail(self._link.authority.reason)

    def _decide(self) -> bool:
        """The first sight of the vehicle decides, once and for all."""
        ap = self._link.autopilot
        if ap.custom_mode is None or (ap.in_air is None and not ap.armed):
            return False
        if ap.armed or ap.in_air or ap.custom_mode == px4_modes.OFFBOARD:  # Offboard left over: a flight was cut short
            self.step = Step.LEFT_TO_PILOT
        return True

    def _after(self, purpose: str, then: object) -> bool:
        commands = self._link.commands
        failure = commands.failure(purpose)
        if failure is not None:
            self._fail(str(failure))
        elif purpose in commands.accepted:
            assert callable(then)
            then()
            return True
        return False

    def _take_off(self) -> None:
        ap = self._link.autopilot
        above_sea_m = ap.amsl_m - ap.height_m + self._height_m
        here = (nan, nan, nan)  # yaw, latitude, longitude: as they are
        self._link.commands.push(enums.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, *here, above_sea_m, purpose=TAKE_OFF)
        self.step = Step.TAKING_OFF

    def _climb(self) -> None:
        self.step = Step.CLIMBING

    def _watch_climb(self, now_s: float) -> None:
        ap = self._link.autopilot
        arrived = ap.height_m >= min(ARRIVED_SHARE * self._height_m, self._height_m - ARRIVED_WITHIN_M)
        if ap.custom_mode not in (px4_modes.TAKEOFF, px4_modes.HOLD) and arrived:
            self.step = Step.LEFT_TO_PILOT
        elif arrived and ap.custom_mode == px4_modes.HOLD:
            self._link.authority.ask(now_s)
            self.step = Step.ASKED
        elif now_s > self._by_s:
            self._fail(f"take-off: {ap.height_m:.1f} m after a climb that should have reached {self._height_m:g} m")

    def _fail(self, problem: str) -> None:
        self.step, self.problem = Step.FAILED, problem
