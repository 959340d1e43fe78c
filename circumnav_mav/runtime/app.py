"""The app: one event loop, one task that computes and sends. Whatever goes wrong in it, setpoints stop."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import inf, nan
from typing import Any

from circumnav_mav.config import Config
from circumnav_mav.endpoint import parse
from circumnav_mav.flight import RANGING, VEHICLE, Flight
from circumnav_mav.flight_record import LimitedTicks, TickRecord
from circumnav_mav.guidance.phases import ENGAGED, Phase
from circumnav_mav.guidance.target import describe, describe_drift
from circumnav_mav.runtime.clock import Clock, run_on_grid
from circumnav_mav.runtime.keyfile import open_signer
from circumnav_mav.runtime.links import open_ranging_link, open_vehicle_link
from circumnav_mav.runtime.realtime import settle
from circumnav_mav.runtime.recorder import Recorder
from circumnav_mav.runtime.stopped import on_continue
from circumnav_mav.runtime.systemd import Notifier
from circumnav_mav.runtime.transport import Transport
from circumnav_mav.runtime.view import REFRESH_HZ, View
from circumnav_mav.runtime.watchdog import WITHIN_S, Watchdog

END_WITHIN_S = 8.0
"""A polite end that has not come by then is cut short: three requests a second apart, and some."""
FIT_WITHIN = 3
"""An autopilot's estimator may take this many times `wait_s` to settle, its GPS longer than to be heard."""
MANY_DROPS = 10


@dataclass(slots=True)
class Options:
    """How one run ends and what it waits for, in flight seconds."""

    duration_s: float = inf
    wait_s: float = inf  # give up when the autopilot and the range have not been heard by then
    end_on_release: bool = False  # nobody is there to engage again (demo)
    end_after_orbiting_s: float = inf
    gone: Callable[[], str] | None = None  # asked every tick: why the vehicle's process is no more (demo), or nothing


@dataclass(slots=True)
class Result:
    """How a run ended.

    outcome: completed, released, range_lost, refused, no_autopilot, no_range, link_ended, hung, stopped, not_engaged.
    """

    outcome: str
    text: str
    phase: str
    engaged_s: float
    duration_s: float
    ticks: int = 0
    missed_ticks: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    scheduling: str = ""
    record_problem: str = ""


class App:
    """Runs one flight over sockets."""

    def __init__(self, config: Config, clock: Clock, recorder: Recorder, view: View, options: Options) -> None:
        self._config, self._clock, self._recorder, self._view = config, clock, recorder, view
        self._options = options
        self.flight = Flight(config, open_signer(config.vehicle.signing_key_file, clock.now()))
        self._links: dict[str, Transport] = {}
        self._last_tick_s = nan
        self._end_by_s = inf
        self._orbiting_since_s = nan
        self._show_next_s = 0.0
        self._shown_events = 0
        self._ticks = self._missed = 0
        self._lateness_s = 0.0
        self._drops_told = self._was_ready = False
        self._verdict: tuple[str, str] | None = None
        self._silenced = False
        self._link_ended = ""
        self._limited = LimitedTicks()
        self._watchdog = Watchdog(self._silence)
        self._systemd = Notifier(os.environ)

    def open_links(self) -> None:
        """Open the sockets. Raises LinkError, in words."""
        try:
            self._links[VEHICLE] = open_vehicle_link(self._config.vehicle)
            if (own := self.flight.ranges.endpoint) is not None:
                self._links[RANGING] = open_ranging_link(own, self.flight.ranges)
        except BaseException:
            self.close_links()
            raise

    def close_links(self) -> None:
        """Close the sockets: silence, at once."""
        for link in self._links.values():
            link.close()

    @property
    def vehicle_port(self) -> int:
        """The local port of the vehicle's link (a configured port 0 takes any free one)."""
        return self._links[VEHICLE].port

    async def run(self) -> Result:
        """Fly until it is over; return how it ended."""
        loop = asyncio.get_running_loop()
        for signum in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(signum, self._on_signal, signum)
        scheduling = settle()
        self._watchdog.start()
        try:
            for name, link in self._links.items():
                link.start(loop, partial(self._on_data, name), partial(self._on_change, name))
            self._systemd.tell("READY=1", f"STATUS=listening on {self._config.vehicle.link}")
            with on_continue(self.flight.stopped):
                await run_on_grid(self._clock, self._config.loop.rate_hz, self._tick)
        finally:
            self.close_links()
            self._watchdog.stop()
            self._systemd.close()
        self._show_events()
        return self._result(scheduling)

    def _on_signal(self, signum: int) -> None:
        if self.flight.end_reason:
            self._verdict = ("stopped", "stopped at once by a second signal; setpoints ended without a mode request")
        self.flight.end("stopped by the operator")

    def _silence(self) -> None:
        """Nothing leaves any more. Called by the watchdog's thread; the loop closes the sockets when it is back."""
        self._silenced = True
        self._verdict = ("hung", f"the loop did not tick for {WITHIN_S:g} s; setpoints have stopped for good")

    def _on_data(self, link: str, data: bytes) -> bool:
        frames = self.flight.receive(data, self._clock.now(), link, whole=self._links[link].whole)
        for frame in frames:
            self._recorder.frame(frame.raw)
        return self.flight.spoke

    def _on_change(self, link: str, up: bool, words: str) -> None:
        now_s = self._clock.now()
        if up:
            self.flight.link_back(link, now_s, words)
        else:
            self.flight.link_lost(link, now_s, words)
            if link == VEHICLE and self._config.vehicle.library == "mavsdk":  # its process does not come back
                self._link_ended = words

    def _tick(self, now_s: float, lateness_s: float, missed: int) -> bool:
        self._watchdog.beat()
        self._systemd.beat(time.monotonic())
        self._ticks += 1
        self._missed += missed
        self._lateness_s = max(lateness_s, 0.9 * self._lateness_s)
        now_s = self.flight.resume(now_s, self._take_in)
        self._last_tick_s = now_s
        frames, record = self.flight.tick(now_s, lateness_s, missed)
        if not self._send(VEHICLE, frames):
            record = record._replace(turn_rate_sent_rad_s=nan)
        self._send(RANGING, self.flight.questions(now_s))
        self._recorder.tick(record)
        self._limited.count(record)
        self._watch(now_s, record)
        return self._verdict is None and not self.flight.done

    def _take_in(self) -> float:
        """Read the links dry; return the time."""
        for link in self._links.values():
            link.drain()
        return self._clock.now()

    def _send(self, link: str, frames: list[bytes]) -> bool:
        """Return whether all of them left."""
        for frame in frames:
            if self._silenced or self.flight.was_away(self._clock.now()):  # since this tick began: it decided too early
                return False
            self._links[link].send(frame)
            self._recorder.frame(frame)
        return True

    def _watch(self, now_s: float, record: TickRecord) -> None:
        """See to the end of the flight, and show what goes on."""
        flight, options = self.flight, self._options
        phase = flight.computer.phase
        if phase is not Phase.ORBITING:
            self._orbiting_since_s = nan
        elif not now_s >= self._orbiting_since_s:
            self._orbiting_since_s = now_s
        if now_s >= options.duration_s:
            flight.end("the duration is over")
        if now_s - self._orbiting_since_s >= options.end_after_orbiting_s:
            flight.end("the laps are flown")
        if flight.end_reason and self._end_by_s == inf:
            self._end_by_s = now_s + END_WITHIN_S
        self._verdict = self._verdict or self._find_verdict(now_s, phase)
        if now_s >= self._show_next_s or self._verdict is not None or flight.done:
            self._show_next_s = now_s + self._clock.speed / REFRESH_HZ
            self._watch_drops(now_s)
            self._show_events()
            self._view.show(self._snapshot(now_s, record))

    def _watch_drops(self, now_s: float) -> None:
        """Tell once that a line takes less than what is sent: what does not fit is dropped, not queued."""
        link = self._links[VEHICLE]
        if link.send_errors >= MANY_DROPS and not self._drops_told and not self._link_ended:
            self._drops_told = True
            slow = (
                "raise its baud rate or lower loop.rate_hz" if link.endpoint.kind == "serial" else "check the network"
            )
            self.flight.tell(now_s, f"{link.endpoint} does not take all that is sent: {slow}")

    def _find_verdict(self, now_s: float, phase: Phase) -> tuple[str, str] | None:
        flight, options = self.flight, self._options
        if flight.problem:
            return "refused", flight.problem
        if self._link_ended:
            return "link_ended", f"{self._link_ended}; setpoints have stopped"
        if options.gone is not None and (why := options.gone()):
            return "no_autopilot", why
        if now_s >= self._end_by_s:
            return "stopped", "the autopilot did not confirm the end; setpoints have stopped"
        self._was_ready = self._was_ready or phase is Phase.READY
        if now_s >= options.wait_s and not self._was_ready:
            if flight.unfit is not None and (flight.unfit.final or now_s >= FIT_WITHIN * options.wait_s):
                return "refused", flight.unfit.text
            if flight.unfit is not None:
                return None
            if phase is Phase.WAITING_AUTOPILOT:
                return "no_autopilot", no_autopilot(self._config.vehicle.link, flight)
            if phase is Phase.WAITING_RANGE:
                return "no_range", flight.why_no_range(now_s)
        if options.end_on_release and phase is Phase.RELEASED:
            return "released", flight.computer.reason
        if options.end_on_release and phase is Phase.RANGE_LOST and flight.link.authority.control == "given back":
            return "range_lost", flight.computer.reason
        return None

    def _result(self, scheduling: str) -> Result:
        flight = self.flight
        phase = flight.computer.phase
        outcome, text = self._verdict or ("completed", flight.computer.reason)
        if self._verdict is None and not flight.engaged_s < inf:
            outcome, text = "not_engaged", "; ".join(filter(None, (text, flight.left_behind)))
        elif self._verdict is None and flight.link.authority.control == "released":
            outcome, text = "released", flight.link.authority.reason
        return Result(
            outcome=outcome,
            text=text,
            phase=str(phase),
            engaged_s=flight.engaged_s,
            duration_s=self._last_tick_s,
            ticks=self._ticks,
            missed_ticks=self._missed,
            rejected=dict(flight.rejected),
            scheduling=scheduling,
            record_problem=self._recorder.problem,
        )

    def _show_events(self) -> None:
        events = self.flight.events
        for event in events[self._shown_events :]:
            self._recorder.event(event.t_s, event.text)
            self._view.event(event.t_s, event.text)
            self._systemd.tell(f"STATUS={event.text}")
        self._shown_events = len(events)

    def _snapshot(self, now_s: float, record: TickRecord) -> dict[str, Any]:
        radius_m = self._config.orbit.radius_m
        return {
            "t_s": now_s,
            "phase": record.phase,
            "reason": self.flight.computer.reason,
            "waiting_for": self.flight.waiting_for or self._hint(now_s),
            "r_m": record.r_m,
            "error_m": record.r_m - radius_m if self.flight.computer.phase in ENGAGED else nan,
            "r_dot_m_s": record.r_dot_m_s,
            "turn_rate_rad_s": record.turn_rate_sent_rad_s,
            "speed_m_s": record.speed_m_s,
            "speed_source": record.speed_source,
            "height_m": record.height_m,
            "target": describe(self.flight.target, self.flight.target_place),
            "drift": describe_drift(self.flight.target),
            "sample_age_s": record.sample_age_s,
            "rejected": self.flight.turned_away.words(self.flight.ranges.echoes),
            "limited": self._limited.words(),
            "lateness_ms": self._lateness_s * 1e3,
            "missed_ticks": self._missed,
            "mode": record.mode,
            "control": record.control,
        }

    def _hint(self, now_s: float) -> str:
        """What stands in the way, for a person who waits."""
        phase = self.flight.computer.phase
        if phase is Phase.WAITING_AUTOPILOT and now_s > 5.0:
            return no_autopilot(self._config.vehicle.link, self.flight)
        if phase is Phase.WAITING_RANGE and now_s > 5.0:
            return self.flight.why_no_range(now_s)
        if phase in (Phase.COASTING, Phase.RANGE_LOST):
            return f"{self.flight.computer.reason}; {self.flight.why_no_range(now_s)}"
        if phase is Phase.READY:
            why_not = self.flight.link.authority.why_not(now_s)
            return why_not or f"select {self.flight.words.ours_name} to engage"
        return ""


def no_autopilot(link: str, flight: Flight) -> str:
    """Return why no autopilot is there, as far as can be told, and what to do."""
    counts, signer = flight.link.counts, flight.link.signer
    if signer is not None and signer.refused and not signer.accepted:
        return f"no frame on {link} is believed: {signer.complaint()}"
    if others := flight.link.autopilot.strangers:
        heard = ", ".join(f"system {n}" for n in sorted(others))
        return f"{heard} on {link}, but not vehicle.system_id = {flight.link.autopilot.only}: set it to the one to fly"
    if counts.understood and not counts.noise:
        frames = f"{counts.understood} MAVLink frames on {link}"
        return f"{frames}, but no autopilot's heartbeat (component 1): check the routing"
    if counts.noise and parse(link).kind == "serial":
        return (
            f"bytes on {link} that are not MAVLink: the baud rate must be that of the autopilot's port "
            "(PX4: SER_TEL1_BAUD, SER_TEL2_BAUD; ArduPilot: SERIAL1_BAUD)"
        )
    if counts.rubbish_bytes:
        return f"bytes on {link} that are not MAVLink: check what sends to this port"
    return f"nothing is heard on {link}: check vehicle.link, the cable and the autopilot's MAVLink port"
