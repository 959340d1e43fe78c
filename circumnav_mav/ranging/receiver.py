"""From what a device says to a range that may be flown on: what every source has in common, done once.

    Reading -> whose is it (sender, orientation, sensor, beacon) -> when was it (stamps, latency) -> bias -> gate

One receiver flies on one channel: where the configuration leaves the sender, sensor or beacon open, the first that is
accepted is kept and any other is rejected, because two beacons mixed into one circle are worse than none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from typing import Any, NamedTuple

from circumnav_mav.ranging.counts import Counts
from circumnav_mav.ranging.gate import Gate, Limits
from circumnav_mav.ranging.plug import NAN, ByteSource, MessageSource, Reading, Reason, Settings, Source
from circumnav_mav.ranging.shared_clock import SharedClock
from circumnav_mav.ranging.stamps import StampClock
from circumnav_mav.types import ClockOffset, RangeSample, Rejected

DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270: a range finder that looks at the ground, never a beacon."""

AUTOPILOT_COMPONENT = 1
DOUBT_SHARE = 0.25
"""The share of max_age_s above which an age that stays is blamed on the device's clock."""

STANDING_AFTER = 3
"""So many different ranges with one and the same stamp show that it is none."""

MOST_HEARD = 64
"""How many channels are remembered for people to choose from; rubbish could invent any number."""


class Channel(NamedTuple):
    """Who measured what: None where the link or the device has no such thing."""

    sender: tuple[int, int] | None
    sensor_id: int | None
    beacon_id: int | None

    def __str__(self) -> str:
        """Return it in the words of the configuration: what would choose it."""
        sender = None if self.sender is None else list(self.sender)
        keys = (("from", sender), ("sensor_id", self.sensor_id), ("beacon_id", self.beacon_id))
        return ", ".join(f"{key} {value}" for key, value in keys if value is not None) or "the only channel"


class _Receiver:
    def __init__(self, source: Source, settings: Settings) -> None:
        self.counts = Counts()
        self.moving = False
        """Set True while the vehicle is known to move: a value that does not change is then a fault."""
        self.heard: dict[Channel, float] = {}
        """The last range [m] of every channel heard, flown on or not: what from, sensor_id, beacon_id choose from."""
        self._settings = settings
        self._names_beacon = "beacon_id" in source.carries
        s = settings
        self._limits = Limits(s.max_age_s, s.min_m, s.max_m, source.most_m, s.min_quality_pct, s.stuck_s)
        self._gate = Gate(self._limits)
        self._clock = StampClock(DOUBT_SHARE * settings.max_age_s)
        self._shared = SharedClock()
        self._stamp_s = self._stamped_m = NAN
        self._standing = 0
        self.flown: Channel | None = None
        """The channel that is flown on, once a range was accepted."""

    @property
    def clock_words(self) -> str:
        """What is wrong with the device's clock, for people; empty where nothing is."""
        return self._shared.words or ("" if self._shared.fits else self._clock.words)

    def _finish(
        self, sender: tuple[int, int] | None, reading: Reading | Rejected, now_s: float
    ) -> RangeSample | Rejected:
        result = reading if isinstance(reading, Rejected) else self._judge(sender, reading, now_s)
        self.counts.add(result)
        return result

    def _judge(self, sender: tuple[int, int] | None, reading: Reading, now_s: float) -> RangeSample | Rejected:
        channel = Channel(sender, reading.sensor_id, reading.beacon_id)
        if channel in self.heard or len(self.heard) < MOST_HEARD:
            self.heard[channel] = reading.range_m
        mismatch = self._match(reading, now_s) or self._match_channel(channel, now_s)
        if mismatch is not None:
            return mismatch
        if self.flown is None:  # what other channels said before must not colour the first of ours
            self._gate = Gate(self._limits)
            self._clock, self._shared = StampClock(DOUBT_SHARE * self._settings.max_age_s), SharedClock()
        sample = RangeSample(
            t_s=self._measured_at(sender, reading, now_s),
            range_m=reading.range_m - self._settings.bias_m,
            range_rate_m_s=reading.range_rate_m_s,
            sigma_m=reading.sigma_m if math.isfinite(reading.sigma_m) and reading.sigma_m > 0.0 else NAN,
            beacon_id=reading.beacon_id,
        )
        rejected = self._gate.judge(reading, sample, now_s, moving=self.moving)
        if rejected is not None:
            return rejected
        self.flown = channel
        return sample

    def _match(self, reading: Reading, now_s: float) -> Rejected | None:
        want = self._settings
        if want.orientation is None and reading.orientation == DOWN:
            return Rejected(now_s, Reason.DECOY_ORIENTATION, "orientation 25 looks down: a height, not a beacon")
        if want.orientation is not None and reading.orientation not in (None, want.orientation):
            detail = f"orientation {reading.orientation}, ranging.orientation is {want.orientation}"
            return Rejected(now_s, Reason.DECOY_ORIENTATION, detail)
        if want.sensor_id is not None and reading.sensor_id not in (None, want.sensor_id):
            return Rejected(
                now_s, Reason.WRONG_SENSOR, f"sensor {reading.sensor_id}, ranging.sensor_id is {want.sensor_id}"
            )
        if want.beacon_id is not None and reading.beacon_id != want.beacon_id:
            if reading.beacon_id is not None:
                detail = f"beacon {reading.beacon_id}, ranging.beacon_id is {want.beacon_id}"
                return Rejected(now_s, Reason.WRONG_BEACON, detail)
            if self._names_beacon:  # whose it is cannot be told: flown on, it would lock the wanted beacon out
                detail = f"a range without a beacon's id, ranging.beacon_id is {want.beacon_id}"
                return Rejected(now_s, Reason.WRONG_BEACON, detail)
        return None

    def _match_channel(self, channel: Channel, now_s: float) -> Rejected | None:
        """Reject whatever is not the channel that was first accepted."""
        if self.flown is None or channel == self.flown:
            return None
        for name, key, reason, ours, theirs in (
            ("sender", "from", Reason.WRONG_SOURCE, self.flown.sender, channel.sender),
            ("sensor", "sensor_id", Reason.WRONG_SENSOR, self.flown.sensor_id, channel.sensor_id),
            ("beacon", "beacon_id", Reason.WRONG_BEACON, self.flown.beacon_id, channel.beacon_id),
        ):
            if theirs != ours:
                flown = f"a range without a {name}" if ours is None else str(ours)
                detail = f"{name} {theirs} beside {flown}, which is flown on: set ranging.{key} to choose"
                return Rejected(now_s, reason, detail)
        return None

    def _measured_at(self, sender: tuple[int, int] | None, reading: Reading, now_s: float) -> float:
        if not (self._settings.use_stamps and math.isfinite(reading.stamp_s)):
            return now_s - self._settings.latency_s
        if self._stands(reading):
            return now_s - self._settings.latency_s
        by_line_s = self._clock.to_ours(reading.stamp_s, now_s)
        clock = self._clock_of(sender, now_s)
        by_clock_s = None if clock is None else self._shared.to_ours(reading.stamp_s, now_s, clock)
        return (by_line_s if by_clock_s is None else by_clock_s) - self._settings.latency_s

    def _stands(self, reading: Reading) -> bool:
        """Whether the stamp stays the same while the range changes: some senders fill in any number."""
        if reading.stamp_s != self._stamp_s:
            self._stamp_s, self._standing = reading.stamp_s, 0
        elif reading.range_m != self._stamped_m:
            self._standing += 1
        self._stamped_m = reading.range_m
        return self._standing >= STANDING_AFTER

    def _clock_of(self, sender: tuple[int, int] | None, now_s: float) -> ClockOffset | None:
        """Return the clock that stamps, where somebody knows it."""
        return None


class MessageReceiver(_Receiver):
    """Ranges from decoded MAVLink messages. Tell it the autopilot as soon as that is known."""

    def __init__(self, source: MessageSource, settings: Settings) -> None:
        super().__init__(source, settings)
        self.message_ids = frozenset(source.message_ids)
        self.autopilot: tuple[int, int] | None = None
        self.clocks: Callable[[tuple[int, int], float], ClockOffset | None] = lambda sender, now_s: None
        """What is known of the clock of (system, component)."""
        self._from = None if settings.from_ is None else tuple(settings.from_)  # a list out of a file will do
        self._read = source.read

    def on_message(self, system: int, component: int, fields: Any, now_s: float) -> RangeSample | Rejected:
        """Judge one message of `message_ids` from (system, component) that arrived at `now_s` [s, monotonic]."""
        sender = (system, component)
        reading = self._match_sender(sender, now_s) or self._read(fields, now_s)
        return self._finish(sender, reading, now_s)

    def _clock_of(self, sender: tuple[int, int] | None, now_s: float) -> ClockOffset | None:
        whose = self.autopilot if self._settings.stamped_by == "autopilot" else sender
        return None if whose is None else self.clocks(whose, now_s)

    def _match_sender(self, sender: tuple[int, int], now_s: float) -> Rejected | None:
        want = self._from
        if want is not None:  # whoever it is: what else sends, and what is echoed under another id, is not he
            return None if sender == want else Rejected(now_s, Reason.WRONG_SOURCE, f"{sender}, ranging.from is {want}")
        if sender == self.autopilot or sender[1] == AUTOPILOT_COMPONENT:
            # An autopilot streams its own range finder, and echoes ours late, rounded and under another id (PX4.md 7).
            return Rejected(now_s, Reason.WRONG_SOURCE, f"{sender} is an autopilot: its own range finder or an echo")
        return None


class ByteReceiver(_Receiver):
    """Ranges from a device's byte stream."""

    def __init__(self, source: ByteSource, settings: Settings) -> None:
        super().__init__(source, settings)
        self._decoder = source.decoder(settings.options)

    def feed(self, data: bytes, now_s: float) -> list[RangeSample | Rejected]:
        """Take bytes that arrived at `now_s` [s, monotonic], in any pieces; return what they complete, oldest first."""
        return [self._finish(None, reading, now_s) for reading in self._decoder.feed(data, now_s)]


def check_options(source: Source, given: Iterable[str]) -> None:
    """Raise ValueError that names every option the source does not know, with the nearest that it knows."""
    known = list(source.options) if isinstance(source, ByteSource) else []
    faults = []
    for key in given:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            faults.append(f"ranging.{key} is unknown to {source.name}" + (f": did you mean {near[0]}?" if near else ""))
    if faults:
        raise ValueError("; ".join(faults))
