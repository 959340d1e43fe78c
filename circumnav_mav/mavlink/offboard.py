"""Who flies: whether OFFBOARD is held by this app, and whether a setpoint may leave it. A table driven by now_s.

What PX4 does, measured: an ACK of a mode request says nothing (two come, only the second is the verdict), the mode in
HEARTBEAT or CURRENT_MODE does; OFFBOARD comes back BY ITSELF when a stream resumes after a failsafe, because the
intention stays OFFBOARD. So nothing is streamed unless the newest mode message shows that OFFBOARD is held by this app,
or a mode that streaming cannot change, and that in the air: PX4 then refuses OFFBOARD on the ground.

OFFBOARD stands for the mode in which the app flies: GUIDED on ArduPilot. Which one, and how a pilot's choice of it is
known to be meant for this app, is in the autopilot's ModeWords.

Transitions on a mode message (state x what it shows -> state; RELEASED is latched and has no row):

    NOT_HELD    x OFFBOARD, meant for us     -> HELD         the pilot engaged
    NOT_HELD    x OFFBOARD, otherwise        -> NOT_HELD     somebody else's; never joined
    ASKED       x OFFBOARD                   -> HELD         confirmed
    ASKED       x another mode than when asked -> RELEASED   the pilot chose while we asked
    HELD        x OFFBOARD                   -> HELD
    HELD        x anything else              -> RELEASED     pilot, ground station or failsafe
    GIVING_BACK x anything but OFFBOARD      -> GIVEN_BACK   what we asked for
    GIVEN_BACK  x a settled mode             -> NOT_HELD     may be engaged again by the pilot

Without a mode message, ASKED, HELD and GIVING_BACK become RELEASED when the autopilot has not been heard for
SILENT_AFTER_S, when it has restarted, and when somebody else sends setpoints to it; HELD also when our last setpoint is
so old that the next one could come after the autopilot's own failsafe, and would take the aircraft back. A setpoint
that left after the autopilot was last heard counts as never sent once half the loss timeout has passed in silence
(`cut_off`). Somebody who merely speaks under our ids keeps us from engaging. RELEASED is left by a restart of the app,
or by the operator's command (`open_latch`).

Mode requests: to enter OFFBOARD while ASKED; to leave it while GIVING_BACK and OFFBOARD is shown. No others.
"""

from __future__ import annotations

from enum import StrEnum
from math import inf, nan, nextafter
from typing import NamedTuple

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import SILENT_AFTER_S, STATUS_CRITICAL, Autopilot
from circumnav_mav.mavlink.modes import ModeWords

ASK_AGAIN_S = 1.0
ASKS = 3
PRIMED_WITHIN_S = 0.5
"""A request goes out only behind a setpoint younger than this: PX4 refuses one that comes first."""
RIVAL_WITHIN_S = 5.0
"""So long after it was last heard, another companion is taken to be there."""
UNDER_WAY_S = 1.0
"""The longest that a message is taken to be under way."""
READY_WITHIN_S = 0.5
"""A pilot who chooses the mode means this app if it said that it is ready so lately."""


class Control(StrEnum):
    """Where the authority over the aircraft stands."""

    NOT_HELD = "not held"
    ASKED = "asked for"
    HELD = "held"
    GIVING_BACK = "giving back"
    GIVEN_BACK = "given back"
    RELEASED = "released"


class Seen(StrEnum):
    """What the newest mode message shows."""

    NOTHING = "nothing"
    OFFBOARD = "offboard"
    OFFBOARD_DISARMED = "offboard, disarmed"
    SETTLED = "settled"  # another mode, and a stream cannot change it
    FAILSAFE = "failsafe"  # another mode, and a stream would take the aircraft back
    UNCLEAR = "unclear"  # another mode, and the autopilot does not say what it intends


class ModeRequest(NamedTuple):
    """A mode that the app asks for, as PX4's custom_mode."""

    custom_mode: int


WITH_AUTHORITY = frozenset({Control.ASKED, Control.HELD, Control.GIVING_BACK})

_ON_MODE: dict[tuple[Control, Seen], tuple[Control, str]] = {
    (Control.ASKED, Seen.OFFBOARD): (Control.HELD, "{ours} confirmed by the autopilot"),
    (Control.HELD, Seen.OFFBOARD_DISARMED): (Control.RELEASED, "the vehicle was disarmed"),
    (Control.HELD, Seen.SETTLED): (Control.RELEASED, "pilot or ground station chose {mode}"),
    (Control.HELD, Seen.UNCLEAR): (Control.RELEASED, "the autopilot left {ours} for {mode}"),
    (Control.HELD, Seen.FAILSAFE): (Control.RELEASED, "failsafe: the autopilot left {ours} for {mode}"),
    (Control.GIVING_BACK, Seen.OFFBOARD_DISARMED): (Control.GIVEN_BACK, "disarmed"),
    (Control.GIVING_BACK, Seen.SETTLED): (Control.GIVEN_BACK, "handed over to {mode}"),
    (Control.GIVING_BACK, Seen.UNCLEAR): (Control.GIVEN_BACK, "handed over to {mode}"),
    (Control.GIVING_BACK, Seen.FAILSAFE): (Control.GIVEN_BACK, "handed over to {mode} by failsafe"),
    (Control.GIVEN_BACK, Seen.SETTLED): (Control.NOT_HELD, "{mode} flies"),
}


class Authority:
    """The state of the table above; `loss_timeout_s` is the autopilot's COM_OF_LOSS_T (GUID_TIMEOUT)."""

    def __init__(self, autopilot: Autopilot, words: ModeWords = px4_modes.WORDS) -> None:
        self._autopilot = autopilot
        self._words = words
        self.control = Control.NOT_HELD
        self.reason = "waiting for the autopilot's mode"
        self.loss_timeout_s = words.loss_timeout_s
        self.needs_air = True
        """Whether a pilot can engage in the air only: all but a rover."""
        self.refused = False
        """Whether OFFBOARD was asked for `ASKS` times in vain."""
        self._rival = ""
        self._rival_s = -inf
        self._cut_off = False
        """Whether no setpoint has left since the autopilot fell silent."""
        self._blind_since_s = -inf
        """Mode messages up to this time prove nothing."""
        self._sent_s = nan
        self._round_trip_s = 0.0
        """As measured after the last gap; 0 once a setpoint has left since."""
        self._ready_s = nan
        self._was_elsewhere = False
        """Whether the mode message before the newest one showed another mode than ours."""
        self._asked_mode: int | None = None
        self._give_back_mode: int | None = None
        self._asks = 0
        self._ask_next_s = nan

    def seen(self) -> Seen:
        """Return what the newest mode message shows, NOTHING while it is older than the last gap."""
        ap = self._autopilot
        if ap.custom_mode is None or not ap.mode_s > self._blind_since_s:
            return Seen.NOTHING
        if ap.custom_mode == self._words.ours:
            return Seen.OFFBOARD if ap.armed else Seen.OFFBOARD_DISARMED
        if ap.system_status >= STATUS_CRITICAL or ap.intended_mode == self._words.ours:
            return Seen.FAILSAFE
        if not self._words.tells_intention:
            return Seen.SETTLED
        return Seen.SETTLED if ap.intended_mode == ap.custom_mode else Seen.UNCLEAR

    def may_stream(self, now_s: float) -> bool:
        """Return whether a setpoint may leave now."""
        if not self._autopilot.heard(now_s):
            return False
        seen = self.seen()
        if seen is Seen.NOTHING:
            return False
        if self.control is Control.GIVING_BACK:
            return self._give_back_mode is not None and not self._too_late(now_s)
        if self.control is Control.HELD:
            return not self._too_late(now_s)
        if self._has_rival(now_s):
            return False
        if self.control is Control.NOT_HELD:
            return seen is Seen.SETTLED and self._words.stream_first and not self.grounded
        return self.control is Control.ASKED

    @property
    def grounded(self) -> bool:
        """Whether it stands on the ground: who selects our mode there would have it dragged over the grass."""
        return self.needs_air and self._autopilot.in_air is False

    @property
    def waits_for_take_off(self) -> bool:
        """Whether standing on the ground is all that keeps a pilot from engaging."""
        return self.grounded and self.control is Control.NOT_HELD and self.seen() is Seen.SETTLED

    def why_not(self, now_s: float) -> str:
        """Return in words why no setpoint may leave now; empty where one may."""
        if self.may_stream(now_s):
            return ""
        if not self._autopilot.heard(now_s):
            return "the autopilot is not heard"
        if self.control in (Control.RELEASED, Control.GIVING_BACK, Control.GIVEN_BACK):
            return self.reason
        if rival := self.rival_words(now_s):
            return rival
        ours = self._words.ours_name
        return {
            Seen.NOTHING: "waiting for a mode message newer than the gap",
            Seen.OFFBOARD: f"{ours} was active before this app was ready: choose another mode, then {ours} again",
            Seen.OFFBOARD_DISARMED: f"{ours} is selected on the ground: choose another mode first",
            Seen.SETTLED: "the vehicle is on the ground: take off first" if self.grounded else "",
            Seen.FAILSAFE: "failsafe: a stream would take the aircraft by itself; choose a mode first",
            Seen.UNCLEAR: "the autopilot does not send CURRENT_MODE, so streaming early is not safe",
        }.get(seen := self.seen(), str(seen))

    def on_mode(self, now_s: float) -> None:
        """Walk the table after a HEARTBEAT or CURRENT_MODE."""
        seen = self.seen()
        if self.control is Control.NOT_HELD and seen is Seen.OFFBOARD and self._meant_for_us(now_s):
            self._to(Control.HELD, f"the pilot selected {self._words.ours_name}")
        elif self._pilot_chose_while_asked(seen):
            self._to(
                Control.RELEASED,
                f"pilot or ground station chose {self._mode()} while {self._words.ours_name} was asked for",
            )
        elif row := _ON_MODE.get((self.control, seen)):
            stopped = self.control is Control.GIVING_BACK and self._give_back_mode is None
            words = "streaming stopped, and the autopilot chose {mode}" if stopped else row[1]
            self._to(row[0], words.format(mode=self._mode(), ours=self._words.ours_name))
        if seen is not Seen.NOTHING:
            self._was_elsewhere = seen is not Seen.OFFBOARD and seen is not Seen.OFFBOARD_DISARMED

    def _meant_for_us(self, now_s: float) -> bool:
        if self._words.stream_first:
            return self._primed(now_s, self.loss_timeout_s + 1)
        return self._was_elsewhere and now_s - self._ready_s <= READY_WITHIN_S

    def _pilot_chose_while_asked(self, seen: Seen) -> bool:
        if self.control is not Control.ASKED or seen not in (Seen.SETTLED, Seen.FAILSAFE, Seen.UNCLEAR):
            return False
        ap = self._autopilot
        return ap.custom_mode != self._asked_mode or ap.system_status >= STATUS_CRITICAL

    def lost(self, reason: str) -> None:
        """The autopilot is gone or has restarted: whatever it does now, it is not ours any more."""
        if self.control in WITH_AUTHORITY:
            self._to(Control.RELEASED, reason)

    def rival(self, now_s: float, who: str, *, flies: bool) -> None:
        """Somebody else speaks as this app, or (flies) sends setpoints to the vehicle. Never fought, never joined."""
        self._rival_s = now_s
        if flies:
            self._rival = f"{who} sends setpoints to this vehicle: two must not fly it; stop one of them"
            self.lost(self._rival)
        else:
            self._rival = (
                f"another program on the link speaks as {who}: stop it (or the router that sends our own messages back)"
            )
            if self.control is Control.ASKED:  # nothing may be granted later, when nobody expects it any more
                self.lost(self._rival)

    def rival_words(self, now_s: float) -> str:
        """Return who else speaks as this app or flies this vehicle, in words; empty while nobody does."""
        return self._rival if self._has_rival(now_s) else ""

    def _has_rival(self, now_s: float) -> bool:
        return now_s - self._rival_s <= RIVAL_WITHIN_S

    def gap(self, now_s: float) -> None:
        """The app was away (a lag above half the loss timeout, SIGCONT, silence): believe only newer mode messages."""
        self._blind_since_s = now_s
        self._was_elsewhere = False
        silent_s = now_s - self._sent_s
        stays = not self._words.leaves_when_silent
        if self.control is Control.HELD and stays and silent_s > self.loss_timeout_s:
            self._to(Control.RELEASED, f"no setpoint for {silent_s:.1f} s: the autopilot has taken over")

    def silent(self, now_s: float, heard_s: float) -> bool:
        """Return whether setpoints have left for half the loss timeout with nothing coming back since `heard_s`."""
        streams = self.control in WITH_AUTHORITY or self._sent_s > heard_s
        return streams and now_s - heard_s > self.loss_timeout_s / 2

    def cut_off(self, heard_s: float) -> None:
        """The autopilot fell silent at `heard_s`: what has left since may never have arrived, and must not count."""
        self._cut_off = True
        self._sent_s = min(self._sent_s, heard_s)

    def await_answer(self, now_s: float) -> None:
        """The autopilot was asked something at `now_s`. Until it answers, a mode message that comes may have been under
        way since before the gap, and show what is no longer so; after UNDER_WAY_S none is taken to be.
        """
        self._blind_since_s = now_s + UNDER_WAY_S

    def answered(self, now_s: float, asked_s: float) -> None:
        """The answer came to what was asked at `asked_s`: what follows it on the wire, be it in the same packet, is
        newer than the gap.
        """
        self._blind_since_s = min(self._blind_since_s, nextafter(now_s, -inf))
        self._round_trip_s = now_s - asked_s

    def _too_late(self, now_s: float) -> bool:
        """Whether a setpoint that left now could come after the autopilot took over, and take the aircraft back."""
        acts = self._words.leaves_when_silent or self._cut_off
        return acts and now_s - self._sent_s + self._round_trip_s > self.loss_timeout_s

    def ready(self, now_s: float) -> None:
        """A pilot may engage at `now_s`: the beacon is heard, and nothing else flies. Called every tick while so."""
        if not self.grounded:
            self._ready_s = now_s

    def sent(self, now_s: float) -> None:
        """A setpoint left at `now_s`."""
        self._sent_s = now_s
        self._round_trip_s = 0.0
        self._cut_off = False

    def ask(self, now_s: float) -> None:
        """Ask for OFFBOARD (engage auto). Only from NOT_HELD; the verdict comes from the mode messages."""
        if self.control is Control.NOT_HELD:
            self._to(Control.ASKED, f"asking for {self._words.ours_name}")
            self._asked_mode = self._autopilot.custom_mode
            self._asks, self._ask_next_s = 0, now_s

    def give_back(self, custom_mode: int | None, now_s: float, reason: str) -> None:
        """Hand the aircraft over: ask for a mode, or with None fall silent. Only while HELD."""
        if self.control is Control.HELD:
            self._to(Control.GIVING_BACK, reason)
            self._give_back_mode = custom_mode
            self._asks, self._ask_next_s = 0, now_s

    def open_latch(self) -> bool:
        """The operator asks to be followed again after a release; only in a settled mode. Return whether it opened."""
        if self.control is Control.RELEASED and self.seen() is Seen.SETTLED:
            self._to(
                Control.NOT_HELD, f"released by the operator's command: {self._words.ours_name} may be selected again"
            )
            return True
        return False

    def poll(self, now_s: float) -> list[ModeRequest]:
        """Return the mode requests that are due."""
        if not self._autopilot.heard(now_s):
            self.lost(f"the autopilot was not heard for {SILENT_AFTER_S:g} s")
        elif self.control is Control.HELD and self._too_late(now_s):
            what = "nothing came from the autopilot" if self._cut_off else "no setpoint"
            self.lost(f"{what} for {now_s - self._sent_s:.1f} s: the autopilot takes over")
        elif self.control is Control.ASKED:
            if self._primed(now_s, PRIMED_WITHIN_S) and now_s >= self._ask_next_s:
                return self._ask(self._words.ours, now_s)
        elif self.control is Control.GIVING_BACK and now_s >= self._ask_next_s:
            if self._give_back_mode is not None:
                return self._ask(self._give_back_mode, now_s) if self.seen() is Seen.OFFBOARD else []
            if now_s >= self._ask_next_s + self.loss_timeout_s + ASK_AGAIN_S:
                self._to(Control.GIVEN_BACK, "streaming stopped")
        return []

    def _ask(self, custom_mode: int, now_s: float) -> list[ModeRequest]:
        if self._asks == ASKS:
            self._in_vain(custom_mode)
            return []
        self._asks += 1
        self._ask_next_s = now_s + ASK_AGAIN_S
        return [ModeRequest(custom_mode)]

    def _in_vain(self, custom_mode: int) -> None:
        wanted = self._words.name(custom_mode)
        if self.control is Control.ASKED:
            self.refused = True
            self._to(Control.RELEASED, f"the autopilot did not enter {wanted} when asked {ASKS} times")
        else:
            self._to(Control.GIVEN_BACK, f"{wanted} was not confirmed; streaming stopped")

    def _primed(self, now_s: float, within_s: float) -> bool:
        return now_s - self._sent_s <= within_s

    def _mode(self) -> str:
        return self._words.name(self._autopilot.custom_mode or 0)

    def _to(self, control: Control, reason: str) -> None:
        self.control, self.reason = control, reason
        if control in (Control.GIVEN_BACK, Control.RELEASED):
            # Whoever chooses our mode now has not seen us stream, or say that we are ready, since.
            self._sent_s = self._ready_s = nan
