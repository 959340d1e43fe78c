"""The one door to pymavlink, typed: message layouts of dialect `all`, the only one with RANGING_BEACON and RANGEFINDER.

pymavlink's own decoder rebuilds each message field by field (5-10 us); its generated classes also carry the struct
layout, from which a frame becomes a named tuple in under 1 us. Nothing here does framing: that is codec.py.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from struct import Struct
from typing import Any

from pymavlink.dialects.v20 import all as _all

enums = _all
"""The dialect's constants (MAV_..., MAVLINK_MSG_ID_...), as pymavlink names them."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How one message lies in a frame."""

    msgid: int
    name: str
    crc_extra: int
    struct: Struct
    fields: tuple[str, ...]  # in wire order
    lengths: tuple[int, ...]  # elements of each field on the wire, 1 for scalars and strings
    size: int  # of the whole payload, bytes
    scalar: bool  # no field has more than one element
    make: Callable[[tuple[Any, ...]], Any]  # values in wire order -> named tuple

    def unpack(self, raw: bytes, start: int, length: int) -> Any:
        """Return the fields of the payload raw[start : start + length]; bytes that MAVLink 2 cut off count as zero."""
        if length >= self.size:
            values = self.struct.unpack_from(raw, start)
        else:
            values = self.struct.unpack(raw[start : start + length].ljust(self.size, b"\0"))
        if self.scalar:
            return self.make(values)
        grouped: list[Any] = []
        at = 0
        for length in self.lengths:
            grouped.append(values[at] if length == 1 else values[at : at + length])
            at += length
        return self.make(tuple(grouped))

    def pack(self, fields: dict[str, Any]) -> bytes:
        """Return the payload, trailing zeros cut off as MAVLink 2 wants it. Raises KeyError for a missing field."""
        if len(fields) != len(self.fields):
            unknown = set(fields).symmetric_difference(self.fields)
            raise KeyError(f"{self.name}: fields missing or unknown: {', '.join(sorted(unknown))}")
        flat: list[Any] = []
        for name, length in zip(self.fields, self.lengths, strict=True):
            if length == 1:
                flat.append(fields[name])
            else:
                flat.extend(fields[name])
        return self.struct.pack(*flat).rstrip(b"\0") or b"\0"


def quick(record: type[Any]) -> Callable[[tuple[Any, ...]], Any]:
    """Return what makes a named tuple of a tuple of the right length, at a third of the cost of its `_make`."""
    return partial(tuple.__new__, record)


@cache
def layout(msgid: int) -> Layout | None:
    """Return the layout of a message id, None where the dialect does not know it."""
    cls = _all.mavlink_map.get(msgid)
    if cls is None:
        return None
    names = tuple(cls.ordered_fieldnames)
    # pymavlink counts a string as its number of characters; struct holds it as one value.
    strings = [kind == "char" for kind in _wire_types(cls)]
    lengths = tuple(1 if text else length for text, length in zip(strings, cls.lengths, strict=True))
    record = namedtuple(cls.msgname, names)  # type: ignore[misc]
    return Layout(
        msgid,
        cls.msgname,
        cls.crc_extra,
        cls.unpacker,
        names,
        lengths,
        cls.unpacker.size,
        max(lengths) == 1,
        quick(record),
    )


def _wire_types(cls: Any) -> list[str]:
    kinds = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    return [kinds[name] for name in cls.ordered_fieldnames]


@cache
def by_name(name: str) -> Layout:
    """Return the layout of a message by its name. Raises KeyError for a name that the dialect does not know."""
    found = layout(getattr(_all, f"MAVLINK_MSG_ID_{name}", -1))
    if found is None:
        raise KeyError(name)
    return found


CRC_EXTRA: dict[int, bytes] = {msgid: bytes([cls.crc_extra]) for msgid, cls in _all.mavlink_map.items()}
"""The byte that every checksum ends with, by message id; an id not in here is unknown."""
