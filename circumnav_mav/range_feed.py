"""Where ranges come from in one configuration, SANS-IO: bytes or messages in, samples and rejections out.

Three ways: messages on the vehicle's link, messages on a MAVLink endpoint of the radio's own, or a device's own bytes.
"""

from __future__ import annotations

from collections.abc import Iterable

from circumnav_mav.config import Ranging
from circumnav_mav.mavlink.codec import Decoder, Frame, LinkCounts, Message, Splitter
from circumnav_mav.mavlink.dialect import layout
from circumnav_mav.ranging import SOURCES, ByteReceiver, ByteSource, MessageReceiver, Settings, open_receiver
from circumnav_mav.ranging.counts import Counts
from circumnav_mav.types import RangeSample, Rejected

AUTOPILOT_COMPONENT = 1
MAVLINK_BAUD = 57_600


class RangeFeed:
    """The receiver of the configured source, and what cuts its bytes into messages where it has a link of its own."""

    def __init__(self, ranging: Ranging) -> None:
        self.source = SOURCES[ranging.source]
        self.receiver: MessageReceiver | ByteReceiver = open_receiver(ranging.source, receiver_settings(ranging))
        ids = self.receiver.message_ids if isinstance(self.receiver, MessageReceiver) else ()
        self.messages = frozenset(shape.name for i in ids if (shape := layout(i)))
        """Names of the messages that carry ranges; empty for a source of bytes."""
        self.own_link = ranging.endpoint is not None
        self._splitter = Splitter()
        self._decoder = Decoder(self.messages)
        self.bytes_in = 0

    @property
    def counts(self) -> Counts:
        """What was accepted and rejected so far."""
        return self.receiver.counts

    @property
    def link_counts(self) -> LinkCounts:
        """What came in on the endpoint of the radio's own, where it speaks MAVLink."""
        return self._splitter.counts

    @property
    def baud(self) -> int:
        """The baud rate at which the device is delivered."""
        return self.source.baud if isinstance(self.source, ByteSource) else MAVLINK_BAUD

    @property
    def start(self) -> tuple[tuple[float, bytes], ...]:
        """(wait s, send) steps that make a silent device talk."""
        return self.source.start if isinstance(self.source, ByteSource) else ()

    def on_vehicle(self, sysid: int | None, *, moving: bool) -> None:
        """Tell who the autopilot is, whose ranges are never a beacon's, and whether the vehicle may be moving."""
        if isinstance(self.receiver, MessageReceiver):
            self.receiver.autopilot = None if sysid is None else (sysid, AUTOPILOT_COMPONENT)
        self.receiver.moving = moving

    def on_bytes(self, data: bytes, now_s: float, *, whole: bool) -> tuple[list[Frame], list[RangeSample | Rejected]]:
        """Take what arrived on the endpoint of the radio's own; return its MAVLink frames, and what they say."""
        self.bytes_in += len(data)
        if isinstance(self.receiver, ByteReceiver):
            return [], self.receiver.feed(data, now_s)
        frames = self._splitter.feed(data, whole=whole)
        return frames, self.on_messages((m for f in frames if (m := self._decoder.decode(f)) is not None), now_s)

    def on_messages(self, messages: Iterable[Message], now_s: float) -> list[RangeSample | Rejected]:
        """Take decoded messages; return what those that carry ranges say."""
        if not isinstance(self.receiver, MessageReceiver):
            return []
        read = self.receiver.on_message
        return [read(m.sysid, m.compid, m.fields, now_s) for m in messages if m.name in self.messages]


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
        options=ranging.options,
        **{key: value for key, value in optional.items() if value is not None},
    )
