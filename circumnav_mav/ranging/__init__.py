"""SANS-IO: bytes or messages in, RangeSample or Rejected out. A new source is one file and one line here."""

from __future__ import annotations

from circumnav_mav.ranging import (
    distance_sensor,
    dwm1001_les,
    landing_target,
    lightware,
    lines,
    linktrack,
    omnipresense,
    rangefinder,
    ranging_beacon,
    replay,
    us_d1,
)
from circumnav_mav.ranging.plug import ByteSource, MessageSource, Settings, Source, carried
from circumnav_mav.ranging.receiver import ByteReceiver, MessageReceiver, check_options

SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        distance_sensor.SOURCE,
        ranging_beacon.SOURCE,
        landing_target.SOURCE,
        rangefinder.SOURCE,
        linktrack.SOURCE,
        dwm1001_les.SOURCE,
        lightware.SOURCE,
        us_d1.SOURCE,
        omnipresense.SOURCE,
        lines.SOURCE,
        replay.SOURCE,
    )
}


def open_receiver(name: str, settings: Settings) -> MessageReceiver | ByteReceiver:
    """Return the receiver of the source called `name`. Raises ValueError, in words, for a bad name or options."""
    source = SOURCES.get(name)
    if source is None:
        raise ValueError(f"no ranging source is called {name!r}; there are: {', '.join(sorted(SOURCES))}")
    check_options(source, settings.options)
    if isinstance(source, MessageSource):
        return MessageReceiver(source, settings)
    return ByteReceiver(source, settings)


__all__ = [
    "SOURCES",
    "ByteReceiver",
    "ByteSource",
    "MessageReceiver",
    "MessageSource",
    "Settings",
    "carried",
    "open_receiver",
]
