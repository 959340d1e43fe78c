"""One flight, SANS-IO: bytes and a clock in, bytes and a record out.

`runtime` drives it over sockets, the lockstep tests in memory.

    bytes -> link -> ranging -> computer.on_sample
    tick  -> authority -> computer.tick -> encoder -> bytes
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from math import inf, nan, pi
from typing import NamedTuple

from circumnav_mav.config import Config, guidance_settings, safety_limits
from circumnav_mav.guidance.computer import Decision, GuidanceComputer, Status
from circumnav_mav.guidance.kernel import Motion
from circumnav_mav.guidance.phases import ENGAGED, Phase
from circumnav_mav.guidance.safety import Facts, Trip, Watch
from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.codec import Frame
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.engage import AutoEngage, Step
from circumnav_mav.mavlink.link import AutopilotLink
from circumnav_mav.mavlink.offboard import Control
from circumnav_mav.mavlink.setpoints import ENCODERS, SetpointLimits
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.types import RangeSample, Rejected

VEHICLE, RANGING = "vehicle", "ranging"
"""Names of the two links. Ranges come on the first unless ranging.endpoint opens the second."""

HAND_OVER = {"hold": px4_modes.HOLD, "return": px4_modes.RETURN, "land": px4_modes.LAND, "stop": None}
WARNING, INFO = 4, 6
MOVING_M_S = 1.0
TEXT_SEVERITY = {Phase.RELEASED: WARNING, Phase.RANGE_LOST: WARNING, Phase.BROKEN_OFF: WARNING}
"""MAV_SEVERITY of what a phase says; INFO for the others."""
NEEDED_ESTIMATES = {"px4_multirotor": enums.ESTIMATOR_ATTITUDE | enums.ESTIMATOR_VELOCITY_HORIZ}
"""ESTIMATOR_STATUS_FLAGS that a vehicle class cannot fly without; attitude for the others."""


class TickRecord(NamedTuple):
    """One line of the flight record. Seconds are flight seconds but lateness_s, which is on the wall."""

    t_s: float
    phase: str
    control: str
    mode: str
    r_m: float  # estimated horizontal range
    r_dot_m_s: float
    range_m: float  # newest range as measured, used or not
    sample_age_s: float  # of the newest range that was used
    turn_rate_wanted_rad_s: float  # by the law, + counter-clockwise
    turn_rate_sent_rad_s: float  # NaN: nothing sent
    turn_rate_flown_rad_s: float  # measured
    speed_m_s: float
    speed_source: str
    height_m: float
    saturated: int
    rejected: int  # ranges rejected so far
    lateness_s: float
    missed_ticks: int


class Event(NamedTuple):
    """Something a person should read."""

    t_s: float
    text: str
    severity: int


class Flight:
    """Everything between the sockets. `end` asks for a polite end; `done` says that there is nothing left to do."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self.ranges = RangeFeed(config.ranging)
        self.link = AutopilotLink(() if self.ranges.own_link else self.ranges.messages)
        self.computer = GuidanceComputer(guidance_settings(config))
        limits = SetpointLimits(config.limits.turn_rate_rad_s, config.orbit.speed_m_s)
        self._encoder = ENCODERS[config.vehicle.kind](limits, config.vehicle.lead_s)
        self._auto = AutoEngage(self.link, config.orbit.height_m or nan) if config.engage == "auto" else None
        self.events: list[Event] = []
        self.rejected: Counter[str] = Counter()
        self.engaged_s = nan
        self.end_reason = ""
        self._newest_range_m = nan
        self._sent_rad_s = nan
        self._invited = False
        self._latch_commands = 0
        self._phase = self.computer.phase
        self._failures_told = 0
        self._ticked_s = nan
        self._stopped = False
        self._frames: list[bytes] = []
        self._watch = Watch(*safety_limits(config))
        self._trip: Trip | None = None
        self._engaged_since_s = nan
        self._turned_rad = 0.0
        self._restarts = 0
        self._restarts_s: deque[float] = deque(maxlen=32)
        self._end_mode: int | None = px4_modes.HOLD

    # -- bytes in ---------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float, link: str = VEHICLE, *, whole: bool = True) -> list[Frame]:
        """Take in what arrived on a link at `now_s`; return its frames, for the recorder."""
        if link == RANGING and self.ranges.own_link:
            self.ranges.on_vehicle(self.link.autopilot.sysid, moving=self._moving())
            frames, results = self.ranges.on_bytes(data, now_s, whole=whole)
        else:
            frames, messages = self.link.receive(data, now_s, whole=whole)
            self.ranges.on_vehicle(self.link.autopilot.sysid, moving=self._moving())
            results = [] if self.ranges.own_link else self.ranges.on_messages(messages, now_s)
        for result in results:
            self._on_range(result, now_s)
        return frames

    def _on_range(self, result: RangeSample | Rejected, now_s: float) -> None:
        if self.was_away(now_s):
            result = Rejected(now_s, "waited", "it waited in the link while the loop was held up: its age is unknown")
        if isinstance(result, RangeSample):
            self._newest_range_m = result.range_m
            rejected = self.computer.on_sample(result, self._motion(now_s), self._height_m(now_s))
            if rejected is None:
                return
            result = rejected
        self._count(result)

    def _moving(self) -> bool:
        """Whether a range that stands still must be a stuck one: only above a walking speed."""
        return self.link.autopilot.speed_m_s > MOVING_M_S

    def _count(self, rejected: Rejected) -> None:
        self.rejected[str(rejected.reason)] += 1

    # -- the tick ---------------------------------------------------------------------------------------------------

    def was_away(self, now_s: float) -> bool:
        """Return whether the loop was held up for longer than half the loss timeout, or the process was stopped.

        What arrived meanwhile waits in the links with no sign of its age, and the autopilot may fly on its own by now.
        """
        return self._stopped or now_s - self._ticked_s > self.link.authority.loss_timeout_s / 2

    def stopped(self) -> None:
        """The process was stopped and continues (SIGCONT): the next tick counts as one after a gap, however short."""
        self._stopped = True

    def resume(self, now_s: float, take_in: Callable[[], float]) -> tuple[float, list[bytes]]:
        """Begin a tick: after a gap, `take_in` all that waits in the links, and believe no mode message older than now.

        take_in returns the time when it is done. Return (the time to tick at, frames to send first). To be called
        before every `tick`.
        """
        if not self.was_away(now_s):
            return now_s, []
        now_s = take_in()
        self._stopped = False
        self._say(now_s, "the loop was held up: no setpoint before a fresh mode message", WARNING)
        return now_s, [self.link.after_gap(now_s)]

    def tick(self, now_s: float, lateness_s: float = 0.0, missed_ticks: int = 0) -> tuple[list[bytes], TickRecord]:
        """Decide and return (frames to send now, the record of this tick)."""
        link, authority = self.link, self.link.authority
        self._look_out(now_s)
        self._ticked_s = now_s
        self._follow_operator(now_s)
        if self._auto is not None and link.autopilot.heard(now_s):
            self._auto.tick(now_s, ready=self.computer.phase is Phase.READY)
        decision = self.computer.tick(now_s, self._status(now_s))
        self._r_m = decision.estimate.r if decision.estimate else nan
        self._on_phase(now_s, decision)
        frames, self._frames = self._frames, []
        self._sent_rad_s = nan
        if decision.setpoint is not None and authority.may_stream(now_s):
            name, fields = self._encoder.encode(decision.setpoint, self._height_m(now_s))
            frames.append(link.setpoint(name, fields, now_s))
            self._sent_rad_s = decision.setpoint.turn_rate_rad_s
            if decision.phase is Phase.READY and not self._invited:
                self._invited = True
                self._say(now_s, "ready: streaming, select Offboard to engage", INFO)
        frames += link.poll(now_s) + link.read_parameters(now_s)
        self._tell_failures(now_s)
        return frames, self._record(now_s, decision, lateness_s, missed_ticks)

    def _look_out(self, now_s: float) -> None:
        """Walk the table of causes that end a flight."""
        ap, phase, computer = self.link.autopilot, self.computer.phase, self.computer
        engaged = phase in ENGAGED
        if not engaged:
            self._engaged_since_s, self._turned_rad = nan, 0.0
            self._restarts_s.clear()
        elif not now_s >= self._engaged_since_s:
            self._engaged_since_s = now_s
        if phase is Phase.ORBITING and (u := ap.turn_rate_rad_s(now_s)) == u:
            self._turned_rad += u * (now_s - self._ticked_s)
        self._count_restarts(now_s, engaged)
        needed = NEEDED_ESTIMATES.get(self._config.vehicle.kind, enums.ESTIMATOR_ATTITUDE)
        facts = Facts(
            r_m=self._r_m if engaged and computer.entered else nan,
            battery_pct=ap.battery_pct,
            battery_alarm=ap.battery_alarm,
            height_age_s=ap.mode_s - ap.height_s if engaged else nan,  # a silent link is another cause
            estimates_missing=ap.estimator_flags is not None and ap.estimator_flags & needed != needed,
            restarts_a_minute=len(self._restarts_s),
            engaged_s=now_s - self._engaged_since_s,
            laps=abs(self._turned_rad) / (2 * pi),
        )
        self._trip, news = self._watch.check(now_s, facts)
        for trip in news:
            self._say(now_s, f"{trip.text}: {trip.action.replace('_', ' ')}", WARNING)
        if self._trip is not None and self._trip.ends:
            self.end(self._trip.text, HAND_OVER[self._trip.action])

    def _count_restarts(self, now_s: float, engaged: bool) -> None:
        restarts = self.computer.estimator.restarts
        if engaged and restarts > self._restarts:
            self._restarts_s.append(now_s)
            self._say(now_s, "the ranges outvoted the estimate, which starts again", INFO)
        self._restarts = restarts
        while self._restarts_s and now_s - self._restarts_s[0] > 60.0:
            self._restarts_s.popleft()

    _r_m: float = nan

    def end(self, reason: str, mode: int | None = px4_modes.HOLD) -> None:
        """Ask for a polite end: that mode (None: no request), then silence."""
        if not self.end_reason:
            self.end_reason, self._end_mode = reason, mode

    @property
    def done(self) -> bool:
        """Whether the flight has ended."""
        return self.computer.phase is Phase.FINISHED

    @property
    def problem(self) -> str:
        """What the engage sequence failed on; empty while all is well."""
        return self._auto.problem if self._auto else ""

    @property
    def waiting_for(self) -> str:
        """What a person at the terminal should know while nothing flies yet."""
        phase = self.computer.phase
        if phase is Phase.READY and self._auto is not None and self._auto.step is not Step.LEFT_TO_PILOT:
            return self._auto.step.value
        return ""

    def _status(self, now_s: float) -> Status:
        authority = self.link.authority
        control = authority.control
        return Status(
            heard=self.link.autopilot.heard(now_s),
            held=control in (Control.HELD, Control.GIVING_BACK),
            released=control is Control.RELEASED,
            ending=bool(self.end_reason) and control is not Control.ASKED,
            why=authority.reason if control is Control.RELEASED else self._why(),
            motion=self._motion(now_s),
            height_m=self._height_m(now_s),
            broken=self._trip is not None and not self._trip.ends,
        )

    def _why(self) -> str:
        if self.end_reason:
            return self.end_reason
        return self._trip.text if self._trip else self.link.authority.reason

    def _follow_operator(self, now_s: float) -> None:
        authority = self.link.authority
        if self.end_reason and authority.control is Control.HELD:
            authority.give_back(self._end_mode, now_s, self.end_reason)
        if self.link.latch_commands != self._latch_commands:
            self._latch_commands = self.link.latch_commands
            opened = authority.open_latch()
            self._frames.append(self.link.answer_latch(opened))
            self._say(now_s, "latch opened" if opened else "latch kept: no settled mode", INFO if opened else WARNING)

    def _on_phase(self, now_s: float, decision: Decision) -> None:
        phase = decision.phase
        if phase is self._phase:
            return
        self._phase = phase
        if phase is Phase.ACQUIRING and not now_s >= self.engaged_s:
            self.engaged_s = now_s
        if phase is Phase.RANGE_LOST:
            action = self._config.on_range_lost
            self.link.authority.give_back(HAND_OVER[action], now_s, f"range lost: {action}")
        elif phase is Phase.BROKEN_OFF and self._trip is not None:
            self.link.authority.give_back(
                HAND_OVER[self._trip.action], now_s, f"{self._trip.text}: {self._trip.action}"
            )
        self._invited = False
        self._say(now_s, f"{phase}: {decision.reason}", TEXT_SEVERITY.get(phase, INFO))

    def _say(self, now_s: float, text: str, severity: int) -> None:
        """Tell the log, the terminal and the ground station."""
        self._tell(now_s, text, severity)
        if self.link.autopilot.sysid is not None:
            self._frames += self.link.statustext(f"circumnav {text}", severity)

    def _tell(self, now_s: float, text: str, severity: int) -> None:
        self.events.append(Event(now_s, text, severity))

    def _tell_failures(self, now_s: float) -> None:
        failures = self.link.commands.failures
        for failure in failures[self._failures_told :]:
            if failure.command.command != enums.MAV_CMD_SET_MESSAGE_INTERVAL:  # an autopilot may lack a stream
                self._tell(now_s, str(failure), WARNING)
        self._failures_told = len(failures)

    def _motion(self, now_s: float) -> Motion:
        ap = self.link.autopilot
        turn_rate = ap.turn_rate_rad_s(now_s)
        if turn_rate != turn_rate:  # NaN: not measured, so what was asked
            turn_rate = self._sent_rad_s
        speed = ap.speed_m_s if now_s - ap.velocity_s <= 1.0 else nan
        return Motion(V=speed, u=turn_rate, psi=ap.heading_rad(now_s))

    def _height_m(self, now_s: float) -> float:
        return self.link.autopilot.height_above_home_m(now_s)

    def _record(self, now_s: float, decision: Decision, lateness_s: float, missed_ticks: int) -> TickRecord:
        ap, estimate = self.link.autopilot, decision.estimate
        age_s = self.computer.sample_age_s(now_s)
        return TickRecord(
            now_s,
            decision.phase,
            self.link.authority.control,
            px4_modes.name(ap.custom_mode) if ap.custom_mode is not None else "",
            estimate.r if estimate else nan,
            estimate.r_dot if estimate else nan,
            self._newest_range_m,
            age_s if age_s < 1e6 else inf,
            decision.wanted_rad_s,
            self._sent_rad_s,
            ap.turn_rate_rad_s(now_s),
            ap.speed_m_s,
            decision.speed_source,
            self._height_m(now_s),
            int(decision.saturated),
            self.rejected.total(),
            lateness_s,
            missed_ticks,
        )
