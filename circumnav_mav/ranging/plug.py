"""What a ranging source is made of: a device's Reading, the settings of the `ranging:` section, and the two plugs.

A source is one file that knows one device and nothing else: it turns a decoded MAVLink message or bytes into Readings.
What every source has in common (whose range it is, bias, limits, time) is done once, in receiver.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, TypeAlias

from circumnav_mav.types import Rejected

NAN = math.nan
BYTE, TWO_BYTES = 0xFF, 0xFFFF
"""Greatest numbers of the fields that carry ids."""


FARTHEST_M = 100_000.0
"""For a source that can be any radio: past the horizon of anything that flies low."""


class Reason(StrEnum):
    """Why a range is not flown on; the word that is counted, logged and shown."""

    BAD_FRAME = "bad_frame"  # bytes or a line that break the device's own format or checksum
    NO_READING = "no_reading"  # the device says that it has no range
    WRONG_SOURCE = "wrong_source"  # another component, or the autopilot itself
    WRONG_SENSOR = "wrong_sensor"  # another sensor_id of the right component
    WRONG_BEACON = "wrong_beacon"  # another beacon in the same stream
    DECOY_ORIENTATION = "decoy_orientation"  # looks elsewhere: a downward range finder, or not the configured one
    INVALID_QUALITY = "invalid_quality"  # the device calls it invalid, or its quality is below the least
    NOT_FINITE = "not_finite"
    OUT_OF_RANGE = "out_of_range"  # outside the device's own limits, the configured ones, or what can be at all
    STALE = "stale"  # older than max_age_s when it arrived
    TIME_BACKWARDS = "time_backwards"  # older than the sample before it
    DUPLICATE = "duplicate"  # the same measurement again
    STUCK = "stuck"  # the same value for longer than a moving vehicle allows


@dataclass(frozen=True, slots=True)
class Reading:
    """What one device said at one moment, in SI units and before any judgement. NaN or None: it has no such thing.

    range_m [m]; range_rate_m_s [m/s, + opening]; sigma_m [m, one standard deviation]; orientation:
    MAV_SENSOR_ORIENTATION; quality_pct: 0 invalid to 100 perfect; least_m, most_m [m]: the device's own limits;
    stamp_s: the device's clock [s, any origin]; sequence: its 8-bit counter.
    """

    range_m: float
    range_rate_m_s: float = NAN
    sigma_m: float = NAN
    beacon_id: int | None = None
    sensor_id: int | None = None
    orientation: int | None = None
    quality_pct: float = NAN
    least_m: float = NAN
    most_m: float = NAN
    stamp_s: float = NAN
    sequence: int | None = None


@dataclass(frozen=True, slots=True)
class Settings:
    """The `ranging:` section as the decoders and the receiver need it; None or NaN: not given.

    from_: (system, component) of the sender, None = any component but an autopilot; orientation: None = any but down.
    latency_s: fixed delay from the measurement to its arrival [s]. use_stamps: take out link delay by the device's own
    timestamps. stamped_by: whose clock these show, "sender" or "autopilot". stuck_s: None = by the values before
    (gate.py), 0 = never. options: keys that one source alone understands.
    """

    from_: tuple[int, int] | None = None
    sensor_id: int | None = None
    beacon_id: int | None = None
    orientation: int | None = None
    bias_m: float = 0.0
    min_m: float = NAN
    max_m: float = NAN
    min_quality_pct: float = NAN
    max_age_s: float = 1.0
    latency_s: float = 0.0
    use_stamps: bool = True
    stamped_by: str = "sender"
    stuck_s: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


CARRIED = ("beacon_id", "sensor_id", "orientation", "quality_pct", "stamp_s")
"""Fields of a Reading that keys of the `ranging:` section choose or judge by, and that not every source has."""
NOTHING: frozenset[str] = frozenset()


class ByteDecoder(Protocol):
    """Turns one device's byte stream into Readings: any bytes, in any pieces, never an exception, bounded memory."""

    def feed(self, data: bytes, now_s: float) -> list[Reading | Rejected]: ...


@dataclass(frozen=True, slots=True)
class MessageSource:
    """Ranges that come as MAVLink messages: the ids to subscribe to, and how one decoded message is read."""

    name: str
    summary: str
    message_ids: tuple[int, ...]
    read: Callable[[Any, float], Reading | Rejected]  # (object with the message's fields, now_s)
    resolution_m: float  # least step of the range
    most_m: float  # farther than any device of its kind ranges: what counts as no range where max_m is not given
    has_rate: bool = False
    carries: frozenset[str] = NOTHING  # which of CARRIED its readings may have
    most_beacon_id: float = math.inf


@dataclass(frozen=True, slots=True)
class ByteSource:
    """Ranges that come as bytes over a serial line, UDP or a file; `decoder` raises ValueError, in words."""

    name: str
    summary: str
    decoder: Callable[[Mapping[str, Any]], ByteDecoder]  # options of the `ranging:` section -> a fresh decoder
    resolution_m: float
    most_m: float
    baud: int = 115_200
    lines: bool = False  # whether it speaks in lines of text
    has_rate: bool = False
    carries: frozenset[str] = NOTHING  # which of CARRIED its readings may have
    most_beacon_id: float = math.inf
    named: Callable[[Mapping[str, Any]], frozenset[str]] | None = None  # options -> those of `carries` that they name
    options: Mapping[str, str] = field(default_factory=dict)  # every key it understands, with what it means
    start: tuple[tuple[float, bytes], ...] = ()  # (wait s, send) steps that make a silent device talk


Source: TypeAlias = MessageSource | ByteSource


def carried(source: Source, options: Mapping[str, Any]) -> frozenset[str]:
    """Return which of CARRIED the source's readings may have with these options, which are valid ones."""
    named = source.named if isinstance(source, ByteSource) else None
    return source.carries if named is None else source.carries & named(options)


class Faults(ValueError):
    """All that is wrong with the options of a source, each in words that begin with `ranging.KEY` or `ranging:`."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(self.faults))


def refuse(faults: Iterable[str]) -> None:
    """Raise Faults where there are any."""
    if found := tuple(faults):
        raise Faults(found)


def check_all(*builds: Callable[[], object]) -> None:
    """Build everything from the options, so that one fault does not hide another. Raises Faults."""
    found: list[str] = []
    for build in builds:
        try:
            build()
        except ValueError as error:
            found += error.faults if isinstance(error, Faults) else (str(error),)
    refuse(found)


def number(options: Mapping[str, Any], key: str, default: float, least: float = -math.inf) -> float:
    """Return the option `key` as a finite number of at least `least`. Raises ValueError, in words."""
    if key not in options:
        return default
    value = options[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        wanted = "a number" if least == -math.inf else f"a number of at least {least:g}"
        raise ValueError(f"ranging.{key} is {value!r}, but must be {wanted}")
    return float(value)


def finite(value: Any) -> float:
    """Return a device's number, which may come as text. Raises ValueError for what is none or not finite."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{value!r} is not a number")
    try:
        result = float(value)
    except OverflowError as error:
        raise ValueError("too great a number") from error
    if not math.isfinite(result):
        raise ValueError(f"{value!r} is not finite")
    return result
