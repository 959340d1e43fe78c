"""SANS-IO: bytes or messages in, RangeSample or Rejected out. A new source is one file and one line here."""

from __future__ import annotations

from circumnav_mav.ranging import distance_sensor, landing_target, rangefinder, ranging_beacon
from circumnav_mav.ranging.plug import ByteSource, MessageSource, Settings, Source
from circumnav_mav.ranging.receiver import ByteReceiver, MessageReceiver

SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        distance_sensor.SOURCE,
        ranging_beacon.SOURCE,
        landing_target.SOURCE,
        rangefinder.SOURCE,
    )
}


def open_receiver(name: str, settings: Settings) -> MessageReceiver | ByteReceiver:
    """Return the receiver of the source called `name`. Raises ValueError, in words, for a bad name or options."""
    source = SOURCES.get(name)
    if source is None:
        raise ValueError(f"no ranging source is called {name!r}; there are: {', '.join(sorted(SOURCES))}")
    if isinstance(source, MessageSource):
        return MessageReceiver(source, settings)
    return ByteReceiver(source, settings)


__all__ = ["SOURCES", "ByteReceiver", "ByteSource", "MessageReceiver", "MessageSource", "Settings", "open_receiver"]
