"""`circumnav ranging`: what the sensor says, live. It listens; it never sends a setpoint or a command.

Over MAVLink it asks for the clocks (TIMESYNC), as a flight does, and where it must call first it sends a heartbeat.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Iterable, Iterator
from math import inf

from circumnav_mav.config import Config
from circumnav_mav.endpoint import parse
from circumnav_mav.mavlink.codec import Packer
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.ranging.monitor import Monitor, Status
from circumnav_mav.ranging.receiver import Channel
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.runtime.keyfile import open_signer
from circumnav_mav.runtime.links import open_link, open_ranging_link
from circumnav_mav.runtime.ranging_view import RangingView, number
from circumnav_mav.types import RangeSample

REFRESH_S = 0.25
HEARTBEAT_S = 1.0
LISTENER = 192
"""MAV_COMP_ID_ONBOARD_COMPUTER2: a flight that goes on meanwhile must not take this for a rival with its own ids."""


class RangingApp:
    """Listens to the configured source until the duration is over or somebody stops it."""

    def __init__(self, config: Config, clock: Clock, view: RangingView, duration_s: float = inf) -> None:
        self._config, self._clock, self._view, self._duration_s = config, clock, view, duration_s
        self.feed = RangeFeed(config.ranging)
        self.feed.on_vehicle(None, moving=False)  # on the bench a range may stand still
        self.monitor = Monitor(self.feed.counts, clock.now())
        self.samples: list[RangeSample] = []
        self._told: set[str] = set()
        self._channels: set[Channel] = set()
        self._clock_told = False
        self._stopped = asyncio.Event()
        # Signatures guard the vehicle's link; a radio with an endpoint of its own has none.
        own = self.feed.endpoint
        self._signer = None if own else open_signer(config.vehicle.signing_key_file, clock.now())
        if own is not None:
            self._link = open_ranging_link(own, self.feed)
        else:
            self._link = open_link(parse(config.vehicle.link))
        self._packer = Packer(config.vehicle.system_id or 1, LISTENER, self._signer)
        self._calls = self._link.endpoint.kind == "udpout" and bool(self.feed.messages)  # else nobody answers
        self.feed.follow_clocks(self.feed.time)

    async def run(self) -> Status:
        """Listen to the end; return the last figures."""
        loop = asyncio.get_running_loop()
        for signum in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(signum, self._stopped.set)
        try:
            self._link.start(loop, self.take, self._on_change)
            await self._show_until_stopped()
        finally:
            self._link.close()
            self._view.close()
        return self.monitor.status(self._clock.now())

    async def _show_until_stopped(self) -> None:
        heartbeat_next_s = -inf
        while not self._stopped.is_set() and (now_s := self._clock.now()) < self._duration_s:
            if self._calls and now_s >= heartbeat_next_s:
                heartbeat_next_s = now_s + HEARTBEAT_S
                self._link.send(_heartbeat(self._packer))
            for question in self.feed.questions(now_s, self._packer):
                self._link.send(question)
            self.monitor.whole_delay = self.feed.tells_whole_delay(now_s)
            self._view.show(now_s, self.monitor.status(now_s), self.hint() if now_s > 3.0 else "")
            wait_s = min(REFRESH_S, self._duration_s - now_s)
            try:
                await asyncio.wait_for(self._stopped.wait(), wait_s)
            except TimeoutError:
                continue

    def take(self, data: bytes) -> bool:
        """Take in what the link has heard; return whether it came from whom we listen to, and so are to ask."""
        now_s = self._clock.now()
        _, results = self.feed.on_bytes(data, now_s, whole=self._link.whole, signer=self._signer)
        for channel in [channel for channel in self.feed.receiver.heard if channel not in self._channels]:
            self._channels.add(channel)
            self._view.event(now_s, f"heard: {channel}")
        for result in results:
            self.monitor.add(result, now_s)
            if isinstance(result, RangeSample):
                self.samples.append(result)
            elif result.reason not in self._told:
                self._told.add(result.reason)
                self._view.event(now_s, f"rejected, {result.reason}: {result.detail}")
        if not self._clock_told and (words := self.feed.receiver.clock_words):
            self._clock_told = True
            self._view.event(now_s, words)
        return any(isinstance(result, RangeSample) for result in results)

    def _on_change(self, up: bool, words: str) -> None:
        self._view.event(self._clock.now(), words)
        if not up and self._link.endpoint.kind == "file":  # nothing more will come
            self._stopped.set()

    def heard(self) -> Iterator[str]:
        """Yield a line for each beacon, sensor and sender that was heard: what the configuration can choose from."""
        receiver = self.feed.receiver
        for channel, range_m in receiver.heard.items():
            yield f"{channel}: {range_m:.3f} m" + (", flown on" if channel == receiver.flown else "")

    def hint(self) -> str:
        """Return in words why no range comes, as far as can be told, and what to do; empty while none is overdue."""
        signer = self._signer
        if signer is not None and signer.refused and not signer.accepted:
            return f"no frame on {self._link.endpoint} is believed: {signer.complaint()}"
        return self.feed.why_none(self._link.endpoint, self._clock.now())


def summary(status: Status, duration_s: float, hint: str, heard: Iterable[str] = ()) -> Iterator[str]:
    """Yield the lines that end a run. heard: as RangingApp.heard says it."""
    rate_hz = status.accepted / duration_s if duration_s > 0.0 else 0.0
    yield f"ranges     {status.accepted} in {duration_s:.1f} s, {rate_hz:.1f} Hz"
    if status.last is not None:
        last = status.last
        beacon = "" if last.beacon_id is None else f" from beacon {last.beacon_id}"
        yield f"last       {last.range_m:.3f} m{beacon}, range rate {number(last.range_rate_m_s, '+.2f', ' m/s')}"
        yield (
            f"timing     jitter {number(status.jitter_s * 1e3, '.1f', ' ms')}, "
            f"longest gap {status.longest_gap_s:.2f} s, "
            f"{status.delay_name} {number(status.delay_s * 1e3, '.1f', ' ms')} (last 10 s)"
        )
        yield f"noise      {number(status.noise_m, '.3f', ' m')} (last 10 s)"
    yield from (f"heard      {words}" for words in heard)
    for reason, count in sorted(status.rejected.items(), key=lambda item: -item[1]):
        yield f"rejected   {count} {reason}: {status.details.get(reason, '')}".rstrip(": ")
    if hint:
        yield f"why        {hint}"


def _heartbeat(packer: Packer) -> bytes:
    return packer.pack(
        "HEARTBEAT",
        type=enums.MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot=enums.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=enums.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )
