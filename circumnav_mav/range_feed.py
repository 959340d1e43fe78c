"""Where ranges come from in one configuration, SANS-IO: bytes or messages in, samples and rejections out.

Three ways: messages on the vehicle's link, messages on a MAVLink endpoint of the radio's own, or a device's own bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from math import nan
from typing import NamedTuple

from circumnav_mav.config import Ranging
from circumnav_mav.endpoint import USUAL_BAUD, Endpoint, parse
from circumnav_mav.mavlink.codec import Decoder, Frame, LinkCounts, Message, Packer, Splitter
from circumnav_mav.mavlink.dialect import layout
from circumnav_mav.mavlink.signing import Signer
from circumnav_mav.mavlink.timesync import TimeSync
from circumnav_mav.range_words import CARRIERS, TAIL_BYTES, Heard, why_none
from circumnav_mav.ranging import SOURCES, ByteReceiver, ByteSource, MessageReceiver, Settings, carried, open_receiver
from circumnav_mav.ranging.counts import Counts
from circumnav_mav.ranging.plug import Reason
from circumnav_mav.ranging.shared_clock import MOST_BOUND_S
from circumnav_mav.types import RangeSample, Rejected

AUTOPILOT_COMPONENT = 1


class Mark(NamedTuple):
    """What had come at `t_s`, when the last range did."""

    t_s: float
    bytes_in: int
    link: LinkCounts
    rejected: dict[str, int]
    echoes: int


class RangeFeed:
    """The receiver of the configured source, and what cuts its bytes into messages where it has a link of its own."""

    def __init__(self, ranging: Ranging) -> None:
        self._ranging = ranging
        self.source = SOURCES[ranging.source]
        self.receiver: MessageReceiver | ByteReceiver = open_receiver(ranging.source, receiver_settings(ranging))
        ids = self.receiver.message_ids if isinstance(self.receiver, MessageReceiver) else ()
        self.messages = frozenset(shape.name for i in ids if (shape := layout(i)))
        """Names of the messages that carry ranges; empty for a source of bytes."""
        self.endpoint = parse(ranging.endpoint) if ranging.endpoint else None
        """The radio's own, None for the vehicle's link."""
        self._splitter = Splitter()
        self._decoder = Decoder({*self.messages, "TIMESYNC"})
        self.time = TimeSync()
        """The clocks on the link that `on_bytes` reads; the vehicle's link has a client of its own."""
        self._stamped = ranging.use_stamps and "stamp_s" in carried(self.source, ranging.options)
        self._ends_lines = False
        self.bytes_in = 0
        self.echoes = 0
        """How many of the rejected were an autopilot's own: its range finder, or the echo of ours."""
        self._at: Mark | None = None
        self._tail = bytearray()
        self._others: set[str] = set()

    @property
    def own_link(self) -> bool:
        """Whether ranges come on an endpoint of the radio's own."""
        return self.endpoint is not None

    @property
    def counts(self) -> Counts:
        """What was accepted and rejected so far."""
        return self.receiver.counts

    @property
    def link_counts(self) -> LinkCounts:
        """What `on_bytes` took in, where it is MAVLink."""
        return self._splitter.counts

    @property
    def baud(self) -> int:
        """The baud rate at which the device is delivered."""
        return self.source.baud if isinstance(self.source, ByteSource) else USUAL_BAUD

    @property
    def start(self) -> tuple[tuple[float, bytes], ...]:
        """(wait s, send) steps that make a silent device talk."""
        return self.source.start if isinstance(self.source, ByteSource) else ()

    @property
    def understood(self) -> int:
        """How many times a device has said something in its own format, flown on or not."""
        return self.counts.accepted + sum(n for why, n in self.counts.rejected.items() if why != Reason.BAD_FRAME)

    def follow_clocks(self, vehicle: TimeSync) -> None:
        """Read stamps by the clocks that TIMESYNC shows on the radio's own link, or on the vehicle's (`vehicle`)."""
        ranging = self._ranging
        if isinstance(self.receiver, MessageReceiver) and self._stamped:
            seen = self.time if self.own_link and ranging.stamped_by == "sender" else vehicle
            seen.wanted = True
            self.receiver.clocks = seen.offset

    def questions(self, now_s: float, packer: Packer) -> list[bytes]:
        """Return what is to leave on the link that `on_bytes` reads: TIMESYNC questions, and never anything else."""
        token = self.time.question(now_s)
        return [] if token is None else [packer.pack("TIMESYNC", tc1=0, ts1=token)]

    def tells_whole_delay(self, now_s: float) -> bool:
        """Whether all of the delay is seen: by a clock of TIMESYNC, or given as latency_s. A line sees what varies."""
        receiver, ranging = self.receiver, self._ranging
        if not self._stamped or ranging.latency_s > 0.0:
            return True
        if receiver.flown is None or not isinstance(receiver, MessageReceiver) or receiver.clock_words:
            return False
        whose = receiver.autopilot if ranging.stamped_by == "autopilot" else receiver.flown.sender
        clock = None if whose is None else receiver.clocks(whose, now_s)
        return clock is not None and clock.bound_s <= MOST_BOUND_S

    def on_vehicle(self, sysid: int | None, *, moving: bool) -> None:
        """Tell who the autopilot is, whose ranges are never a beacon's, and whether the vehicle may be moving."""
        if isinstance(self.receiver, MessageReceiver):
            self.receiver.autopilot = None if sysid is None else (sysid, AUTOPILOT_COMPONENT)
        self.receiver.moving = moving

    def on_bytes(
        self, data: bytes, now_s: float, *, whole: bool, signer: Signer | None = None
    ) -> tuple[list[Frame], list[RangeSample | Rejected]]:
        """Take what arrived on the link that carries ranges; return its MAVLink frames, and what they say."""
        self.bytes_in += len(data)
        data = self._ended(data) if whole else data
        self._tail += data
        del self._tail[:-TAIL_BYTES]
        if isinstance(self.receiver, ByteReceiver):
            results = self.receiver.feed(data, now_s)
            if any(isinstance(result, RangeSample) for result in results):
                self._flown_on(now_s)
            return [], results
        frames = self._splitter.feed(data, whole=whole)
        if signer is not None:
            signer.advance(now_s)
            frames = [frame for frame in frames if signer.believes(frame.raw, frame.sysid, frame.compid)]
        for frame in frames:
            if frame.msgid in CARRIERS and frame.compid != AUTOPILOT_COMPONENT:
                self._others.add(CARRIERS[frame.msgid])
        messages = [message for frame in frames if (message := self._decoder.decode(frame)) is not None]
        for message in messages:
            if message.name == "TIMESYNC" and message.fields.tc1:
                sender = (message.sysid, message.compid)
                self.time.answer(sender, message.fields.ts1, message.fields.tc1, now_s)
        return frames, self.on_messages(messages, now_s)

    def _ended(self, datagram: bytes) -> bytes:
        """Return it with the line ended, where a device writes lines into datagrams and never ends one.

        One that does end them may be cut anywhere by what turns its serial line into datagrams: half a number is a
        wrong range.
        """
        if not (isinstance(self.source, ByteSource) and self.source.lines):
            return datagram
        self._ends_lines = self._ends_lines or b"\n" in datagram or b"\r" in datagram
        return datagram if self._ends_lines else datagram + b"\n"

    def on_messages(self, messages: Iterable[Message], now_s: float) -> list[RangeSample | Rejected]:
        """Take decoded messages; return what those that carry ranges say."""
        if not isinstance(self.receiver, MessageReceiver):
            return []
        read, results = self.receiver.on_message, []
        for message in messages:
            if message.name in self.messages:
                result = read(message.sysid, message.compid, message.fields, now_s)
                results.append(result)
                if isinstance(result, RangeSample):
                    self._flown_on(now_s)
                elif message.compid == AUTOPILOT_COMPONENT and result.reason == Reason.WRONG_SOURCE:
                    self.echoes += 1
        return results

    def why_none(self, endpoint: Endpoint, now_s: float) -> str:
        """Return in words why no range comes over `endpoint`, and what to do; empty while none is overdue."""
        before = self._at is not None
        silent_s = now_s - self._at.t_s if self._at is not None else nan
        if silent_s <= self._ranging.max_age_s:
            return ""
        at = self._at or Mark(nan, 0, LinkCounts(), {}, 0)
        heard = Heard(
            endpoint=endpoint,
            source=self.source,
            options=self._ranging.options,
            messages=self.messages,
            others=frozenset(self._others - {self.source.name}),
            baud=self.baud,
            before=before,
            bytes_in=self.bytes_in - at.bytes_in,
            link=self._splitter.counts.since(at.link),
            rejected=Counter(self.counts.rejected) - Counter(at.rejected),
            echoes=self.echoes - at.echoes,
            tail=bytes(self._tail),
        )
        return f"no range for {silent_s:.1f} s: {why_none(heard)}" if before else why_none(heard)

    def _flown_on(self, now_s: float) -> None:
        """A range came: what is wrong is reckoned from here on."""
        self._at = Mark(now_s, self.bytes_in, replace(self._splitter.counts), dict(self.counts.rejected), self.echoes)
        self._tail.clear()
        self._others.clear()


def receiver_settings(ranging: Ranging) -> Settings:
    """Return the `ranging:` section as the receiver needs it."""
    optional = {
        "min_m": ranging.min_m,
        "max_m": ranging.max_m,
        "min_quality_pct": ranging.min_quality_pct,
        "stuck_s": ranging.stuck_s,
    }
    return Settings(
        from_=ranging.sender,
        sensor_id=ranging.sensor_id,
        beacon_id=ranging.beacon_id,
        orientation=ranging.orientation,
        bias_m=ranging.bias_m,
        max_age_s=ranging.max_age_s,
        latency_s=ranging.latency_s,
        use_stamps=ranging.use_stamps,
        stamped_by=ranging.stamped_by,
        options=ranging.options,
        **{key: value for key, value in optional.items() if value is not None},
    )
