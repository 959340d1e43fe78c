"""`engage: auto`: arm, take off, ask for control, for a vehicle that is disarmed on the ground at first sight.

How a vehicle class gets into the air is its TakeOff. Anything else (armed, in the air, a pilot who changes the mode on
the way) is left to the pilot, as with engage: pilot.
"""

from __future__ import annotations

from enum import StrEnum
from math import isnan, nan

from circumnav_mav.mavlink.autopilot import STATUS_STANDBY
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.link import AutopilotLink
from circumnav_mav.mavlink.offboard import Control
from circumnav_mav.mavlink.vehicles.plug import TakeOff

MODE, ARM, TAKE_OFF = "mode", "arming", "take-off"
ARRIVED_SHARE = 0.95
ARRIVED_WITHIN_M = 1.0
CLIMB_SLOWEST_M_S = 0.4
CLIMB_MARGIN_S = 20.0
LEVEL_CLIMB_M_S = 0.7
LEAST_CLIMB_M = 10.0
"""Below it a plane that takes off by itself is hardly clear of the ground, and not to be banked."""
ARM_AGAIN_S = 2.0
ARRIVED_EARLY_S = 2.0
"""The autopilot may call the climb done a little below the height; a mode kept longer than this there is a pilot's."""


class Step(StrEnum):
    """Where the sequence stands."""

    WAITING = "waiting until the autopilot is ready to arm"
    MODE = "asking for the mode to take off in"
    ARMING = "arming"
    TAKING_OFF = "asking for take-off"
    CLIMBING = "taking off"
    ASKED = "asking for control"
    LEFT_TO_PILOT = "the pilot engages"
    FAILED = "failed"


class AutoEngage:
    """The sequence; `height_m` is the height above the take-off point to climb to."""

    def __init__(self, link: AutopilotLink, take_off: TakeOff, height_m: float) -> None:
        self._link = link
        self._plan = take_off
        self._height_m = height_m
        self._by_s = self._level_since_s = self._arm_by_s = self._arm_next_s = nan
        self._arm_tries = 0
        self._mode_before: int | None = None
        self._climbed = self._arrived = False
        self._early_s = nan
        self._decided = self._rival = False
        self.step = Step.WAITING
        self.problem = ""

    def tick(self, now_s: float, *, ready: bool, may_ask: bool) -> None:
        """Do what is due. ready: the beacon is heard; may_ask: and the encoder knows what it needs."""
        self._rival = bool(self._link.authority.rival_words(now_s))
        if not self._decided:
            self._decided = self._decide()
            return
        if self._pilot_acts():
            self._leave_to_pilot()
        elif self.step is Step.WAITING:
            if ready and self._may_begin():
                self._mode_before = self._link.autopilot.custom_mode
                self._begin(now_s)
        elif self.step is Step.MODE:
            if self._done(MODE):
                self._arm(now_s)
        elif self.step is Step.ARMING:
            self._watch_arming(now_s)
        elif self.step is Step.TAKING_OFF:
            if self._done(TAKE_OFF):
                self._climb(now_s)
        elif self.step is Step.CLIMBING:
            self._watch_climb(now_s, may_ask=may_ask and not self._rival and not self._link.authority.grounded)
        elif self.step is Step.ASKED:
            if self._link.authority.refused:
                self._fail(self._link.authority.reason)
            elif self._link.authority.control in (Control.HELD, Control.RELEASED):
                self.step = Step.LEFT_TO_PILOT  # done: whoever engages from now on is a pilot

    def _pilot_acts(self) -> bool:
        """Whether somebody else has taken the vehicle up, or chosen a mode, since it was first seen."""
        ap = self._link.autopilot
        if self.step is Step.WAITING:
            return bool(ap.armed or ap.in_air)
        if self.step in (Step.MODE, Step.ARMING, Step.TAKING_OFF):
            return ap.custom_mode not in {self._mode_before, self._plan.first_mode, *self._plan.climbing}
        return False

    def _leave_to_pilot(self) -> None:
        self._link.commands.clear()
        self.step = Step.LEFT_TO_PILOT

    def _decide(self) -> bool:
        """The first sight of the vehicle decides, once and for all."""
        ap = self._link.autopilot
        on_ground = ap.in_air is False or ap.system_status == STATUS_STANDBY
        if ap.custom_mode is None or not (ap.armed or ap.in_air or on_ground):
            return False
        if ap.armed or ap.in_air or ap.custom_mode == self._link.words.ours:  # left over: a flight was cut short
            self.step = Step.LEFT_TO_PILOT
        return True

    def _may_begin(self) -> bool:
        ap, link = self._link.autopilot, self._link
        named = self._plan.height_parameter
        return (
            not self._rival
            and ap.system_status == STATUS_STANDBY
            and (self._plan.command != "amsl" or ap.amsl_m == ap.amsl_m)
            and (not named or named in link.parameters)
        )

    def _begin(self, now_s: float) -> None:
        named = self._plan.height_parameter
        if named:  # the take-off climbs to this; what is left to orbit.height_m is climbed once we have control
            climbs_to = self._link.parameters[named]
            if not climbs_to >= min(LEAST_CLIMB_M, self._height_m):
                self._fail(f"take-off: {named} is {climbs_to:g} m: set it to {LEAST_CLIMB_M:g} m or more")
                return
            self._height_m = min(self._height_m, climbs_to)
        if self._plan.first_mode is None:
            self._arm(now_s)
        else:
            custom, param2, param3 = 1.0, *map(float, self._link.words.split(self._plan.first_mode))
            self._link.commands.push(enums.MAV_CMD_DO_SET_MODE, custom, param2, param3, purpose=MODE)
            self.step = Step.MODE

    def _arm(self, now_s: float) -> None:
        if self._arm_tries == 0:
            self._arm_by_s = now_s + self._plan.arm_patience_s
        self._arm_tries += 1
        self._link.commands.push(enums.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, purpose=self._arming)
        self.step = Step.ARMING

    @property
    def _arming(self) -> str:
        return ARM if self._arm_tries == 1 else f"{ARM} (try {self._arm_tries})"

    def _watch_arming(self, now_s: float) -> None:
        commands = self._link.commands
        failure = commands.failure(self._arming)
        if self._arming in commands.accepted:
            if self._plan.command == "none":
                self._climb(now_s)
            else:
                self._take_off()
        elif failure is not None:
            if now_s >= self._arm_by_s:
                said = self._link.autopilot_texts[-1:]  # ArduPilot tells why; PX4 tells ground stations only
                self._fail(f"{failure}: {said[0]}" if said else str(failure))
            elif not now_s < self._arm_next_s:
                self._arm_next_s = now_s + ARM_AGAIN_S
                self._arm(now_s)

    def _done(self, purpose: str) -> bool:
        failure = self._link.commands.failure(purpose)
        if failure is not None:
            self._fail(str(failure))
        return purpose in self._link.commands.accepted

    def _take_off(self) -> None:
        ap = self._link.autopilot
        if self._plan.command == "amsl":
            here, to_m = (
                (nan, nan, nan),
                ap.amsl_m - ap.height_m + self._height_m,
            )  # yaw, latitude, longitude as they are
        else:
            here, to_m = (0.0, 0.0, 0.0), self._height_m
        self._link.commands.push(enums.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, *here, to_m, purpose=TAKE_OFF)
        self.step = Step.TAKING_OFF

    def _climb(self, now_s: float) -> None:
        self._by_s = now_s + self._height_m / CLIMB_SLOWEST_M_S + CLIMB_MARGIN_S
        self.step = Step.CLIMBING

    def _watch_climb(self, now_s: float, *, may_ask: bool) -> None:
        ap, plan = self._link.autopilot, self._plan
        height_m = ap.height_above_home_m(now_s)
        arrived = height_m >= min(ARRIVED_SHARE * self._height_m, self._height_m - ARRIVED_WITHIN_M)
        if not abs(ap.climb_m_s) < LEVEL_CLIMB_M_S:
            self._level_since_s = nan
        elif not now_s >= self._level_since_s:
            self._level_since_s = now_s
        level = plan.level_s == 0.0 or now_s - self._level_since_s >= plan.level_s
        mode = ap.custom_mode
        self._arrived = self._arrived or (mode == plan.arrived and arrived)
        if mode == plan.arrived and self._arrived:  # for good: a plane may sink by meters before it flies level
            if level and may_ask:  # else it waits in the air, in the autopilot's own mode
                self._link.authority.ask(now_s)
                self.step = Step.ASKED
        elif self._arrived:
            self._leave_to_pilot()
        elif now_s > self._by_s:
            self._fail(f"take-off: {height_m:.1f} m after a climb that should have reached {self._height_m:g} m")
        elif mode in plan.climbing:
            self._climbed, self._early_s = True, nan
        elif mode == plan.arrived and self._climbed and not now_s - self._early_s > ARRIVED_EARLY_S:
            self._early_s = now_s if isnan(self._early_s) else self._early_s
        elif self._climbed or mode != self._mode_before:
            self._leave_to_pilot()

    def _fail(self, problem: str) -> None:
        self.step, self.problem = Step.FAILED, problem
