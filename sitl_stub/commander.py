"""PX4's commander: arming, modes, and the failsafes of a lost setpoint stream or joystick (PX4.md, 2, 3, 8).

The pilot's or companion's wish is the `intention`; the mode that flies is the intention, or the failsafe's while one is
active. The intention outlives a failsafe: a stream that comes back takes the vehicle back without a word (3.5).
"""

from __future__ import annotations

import math

from sitl_stub.modes import (
    AUTO_MODES,
    OFFBOARD_LOSS_DISARM,
    OFFBOARD_LOSS_MODE,
    POSITION_MODES,
    STICK_MODES,
    Mode,
    title_of,
)
from sitl_stub.params import Parameters

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
UNINIT, STANDBY, ACTIVE, CRITICAL, TERMINATED = 0, 3, 4, 5, 8  # HEARTBEAT.system_status
CRITICAL_TEXT, INFO_TEXT = 2, 6  # STATUSTEXT.severity
STICK_LOSS_MARGIN_S = 0.15  # measured: 0.66 s after the last MANUAL_CONTROL
CHECK_PERIOD_S = 0.1  # arming checks run at 10 Hz
CHECK_MARGIN_S = 0.05  # so that the loss shows COM_OF_LOSS_T + 0.05..0.15 s after the last setpoint (measured 1.12)
LANDED_S, NEVER = 1.0, -math.inf


class Commander:
    """Decides the mode. Everything is driven by `update(now_s, ...)`; words for people collect in `texts`."""

    def __init__(self, params: Parameters, ready_s: float) -> None:
        self.params = params
        self.position_ok = True
        self.has_mission = False
        self.sticks_override = True  # an airplane's do not
        self.refuse_arming = False  # faults
        self.refuse_offboard = False
        self.texts: list[tuple[int, str]] = []
        self._next_check_s = 0.0
        self._now_s = 0.0
        self.boot(ready_s)

    def boot(self, ready_s: float) -> None:
        """Begin disarmed in Hold; arming is refused until ready_s."""
        self.ready_s = ready_s
        self.armed = False
        self.intention = self.mode = Mode.HOLD
        self.failsafe = False
        self.disarmed_by_failsafe = False
        self.offboard_ok = False
        self.last_setpoint_s = NEVER
        self._needs_position = False
        self.last_stick_s = NEVER
        self._stick_loss_s = NEVER
        self._stick_loss_overridden = False
        self._armed_s = NEVER
        self._landed_s = self._now_s  # since when on the ground, inf in the air
        self._flew = False

    # -- what comes in -------------------------------------------------------------------------------------------

    def setpoint_received(self, now_s: float, needs_position: bool) -> None:
        """Note a setpoint that PX4 accepts as stream."""
        self.last_setpoint_s = now_s
        self._needs_position = needs_position

    def sticks_received(self, now_s: float, moved: bool) -> None:
        """Note a MANUAL_CONTROL. Moved sticks take a multirotor over where COM_RC_OVERRIDE says so.

        Bit 0: from what flies by itself (the default, by PX4's documents); bit 1: from OFFBOARD (measured).
        """
        self.last_stick_s = now_s
        bit = 2 if self.mode is Mode.OFFBOARD else 1 if self.mode in AUTO_MODES else 0
        if moved and self.armed and self.sticks_override and int(self.params["COM_RC_OVERRIDE"]) & bit:
            self.intention = Mode.POSCTL
            self._say(INFO_TEXT, "Pilot took over using sticks\t")

    def request_mode(self, mode: Mode, now_s: float, from_component: int = 0) -> int:
        """Take or refuse a wish for a mode. While disarmed, nothing is refused."""
        self._now_s = now_s
        if self.mode is Mode.TERMINATION and self.armed:
            return TEMPORARILY_REJECTED
        if self.armed and not self._can_fly(mode, now_s):
            if from_component == 190:
                self._say(CRITICAL_TEXT, f"Switching to {title_of(mode)} is currently not available\t")
            return TEMPORARILY_REJECTED
        self.intention = mode
        self._stick_loss_overridden = True
        return ACCEPTED

    def arm(self, now_s: float) -> int:
        """Arm, or refuse to."""
        if self.armed:
            return ACCEPTED
        blind = self.intention is Mode.OFFBOARD and not self._offboard_fresh(now_s)
        lacking = blind or not self._has_what_it_needs(self.intention, now_s)
        if now_s < self.ready_s or self.refuse_arming or self.mode is Mode.TERMINATION or lacking:
            self._say(CRITICAL_TEXT, "Arming denied: Resolve system health failures first\t")
            return TEMPORARILY_REJECTED
        self.armed, self._armed_s, self._flew = True, now_s, False
        self.disarmed_by_failsafe = False
        self._say(INFO_TEXT, "Armed by external command\t")
        return ACCEPTED

    def disarm(self, now_s: float, force: bool) -> int:
        """Disarm; in the air only by force."""
        if self.armed and math.isinf(self._landed_s) and not force:
            self._say(CRITICAL_TEXT, "Disarming denied: not landed\t")
            return TEMPORARILY_REJECTED
        if self.armed:
            self._disarm("Disarmed by external command\t")
        return ACCEPTED

    def terminate(self) -> None:
        """End the flight for good: motors off until the next boot."""
        self.mode = Mode.TERMINATION

    def start_flying(self, now_s: float) -> None:
        """Begin armed in Hold in the air (tests that need no take-off)."""
        self.armed, self._armed_s, self._flew, self._landed_s = True, now_s, True, math.inf

    def mode_finished(self, following: Mode) -> None:
        """A take-off that is up goes on to another mode by itself."""
        if self.intention is self.mode:
            self.intention = following

    # -- time ----------------------------------------------------------------------------------------------------

    def update(self, now_s: float, on_ground: bool) -> None:
        """Run one commander cycle; `on_ground`: the vehicle stands and does not push upwards."""
        self._now_s = now_s
        self._track_ground(now_s, on_ground)
        if now_s >= self._next_check_s:
            self._next_check_s += CHECK_PERIOD_S
            self.offboard_ok = self._offboard_fresh(now_s) and not self.refuse_offboard
        elif not self.offboard_ok and 0.01 <= now_s - self.last_setpoint_s < CHECK_PERIOD_S:
            self.offboard_ok = (
                self._offboard_fresh(now_s) and not self.refuse_offboard
            )  # a stream that comes back is seen at once
        mode = self._failsafe_mode(now_s) if self.armed else None
        if mode is None:
            if self.failsafe:
                self.failsafe = False
            if self.mode is not Mode.TERMINATION:
                self.mode = self.intention
        elif self.armed:
            if not self.failsafe:
                self.failsafe = True
                waiting = mode is Mode.HOLD and self._stick_loss_s != NEVER and self.offboard_ok
                hold_s = f": entering Hold for {self.params['COM_FAIL_ACT_T']:.0f} seconds" if waiting else ""
                self._say(CRITICAL_TEXT, f"Failsafe activated{hold_s}\t")
            self.mode = mode

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status."""
        if self.mode is Mode.TERMINATION:
            return TERMINATED
        if self.armed:
            return CRITICAL if self.failsafe else ACTIVE
        return UNINIT if self.disarmed_by_failsafe or self._now_s < self.ready_s else STANDBY

    @property
    def checks_pass(self) -> bool:
        """Whether PX4's checks pass, which SYS_STATUS shows: ready, and the mode has the sticks or place it needs."""
        ready = self._now_s >= self.ready_s and not self.disarmed_by_failsafe
        return ready and self._has_what_it_needs(self.mode, self._now_s)

    @property
    def landed(self) -> bool:
        """Whether the land detector says so."""
        return not math.isinf(self._landed_s)

    # -- rules ---------------------------------------------------------------------------------------------------

    def _offboard_fresh(self, now_s: float) -> bool:
        age = now_s - self.last_setpoint_s
        fresh = age <= self.params["COM_OF_LOSS_T"] + CHECK_MARGIN_S
        return fresh and (self.position_ok or not self._needs_position)

    def sticks_ok(self, now_s: float) -> bool:
        """Whether a joystick is there."""
        return now_s - self.last_stick_s <= self.params["COM_RC_LOSS_T"] + STICK_LOSS_MARGIN_S

    def _can_fly(self, mode: Mode, now_s: float) -> bool:
        if mode is Mode.OFFBOARD:
            just_now = now_s - self.last_setpoint_s < CHECK_PERIOD_S
            return not self.refuse_offboard and (self.offboard_ok or (just_now and self._offboard_fresh(now_s)))
        if mode is Mode.MISSION and not self.has_mission:
            return False
        return self._has_what_it_needs(mode, now_s)

    def _has_what_it_needs(self, mode: Mode, now_s: float) -> bool:
        """Whether there are sticks for a mode flown with them, and a position for one that needs it."""
        if mode in STICK_MODES and not self.sticks_ok(now_s):
            return False
        return self.position_ok or mode not in POSITION_MODES

    def _failsafe_mode(self, now_s: float) -> Mode | None:
        if self.mode is Mode.TERMINATION:
            return Mode.TERMINATION
        if self.intention is Mode.OFFBOARD and not self.offboard_ok:
            action = int(self.params["COM_OBL_RC_ACT"])
            if action == OFFBOARD_LOSS_DISARM:
                self._disarm("Disarmed by failsafe\t")
                self.disarmed_by_failsafe = True
                return None
            lost = OFFBOARD_LOSS_MODE.get(action, Mode.POSCTL)
            return Mode.LAND if lost in POSITION_MODES and not self.position_ok else lost
        if self.intention in POSITION_MODES and not self.position_ok:
            return Mode.LAND  # PX4's Descend: down, without knowing where
        return self._stick_loss_mode(now_s)

    def _stick_loss_mode(self, now_s: float) -> Mode | None:
        if self.last_stick_s == NEVER or self.sticks_ok(now_s):
            self._stick_loss_s = NEVER
            return None
        if self._stick_loss_s == NEVER:
            self._stick_loss_s, self._stick_loss_overridden = now_s, False
        excepted = {Mode.MISSION: 1, Mode.HOLD: 2, Mode.OFFBOARD: 4}.get(self.intention, 0)
        action = int(self.params["NAV_RCL_ACT"])
        if self._stick_loss_overridden or int(self.params["COM_RCL_EXCEPT"]) & excepted or action == 0:
            return None
        if now_s - self._stick_loss_s < self.params["COM_FAIL_ACT_T"]:
            return Mode.HOLD
        return {1: Mode.HOLD, 2: Mode.RTL, 3: Mode.LAND, 5: Mode.TERMINATION}.get(action, Mode.HOLD)

    def _track_ground(self, now_s: float, on_ground: bool) -> None:
        if not on_ground:
            if math.isfinite(self._landed_s) and self.armed:
                self._say(INFO_TEXT, "Takeoff detected\t")
                self._flew = True
            self._landed_s = math.inf
            return
        if math.isinf(self._landed_s):
            self._landed_s = now_s
            if self.armed:
                self._say(INFO_TEXT, "Landing detected\t")
        if not self.armed:
            return
        after_landing, preflight = self.params["COM_DISARM_LAND"], self.params["COM_DISARM_PRFLT"]
        if self._flew and after_landing > 0.0 and now_s - self._landed_s > after_landing:
            self._disarm("Disarmed by landing\t")
        elif not self._flew and preflight > 0.0 and now_s - self._armed_s > preflight + LANDED_S:
            self._disarm("Disarmed by auto preflight disarming\t")

    def _disarm(self, text: str) -> None:
        self.armed = self.failsafe = False
        if self.intention in (Mode.LAND, Mode.RTL, Mode.TAKEOFF):
            self.intention = Mode.HOLD
        self._say(INFO_TEXT, text)

    def _say(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))
