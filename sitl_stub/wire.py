"""MAVLink frames, fast: the one module of the stub that touches pymavlink.

Only the dialect's field tables are used; packing and unpacking are precompiled structs (about a microsecond a frame,
a fifth of what pymavlink's own objects cost). Values are given and returned in the order of the XML's field
declaration, as in the MAVLink documentation; the order on the wire is this module's business.
"""

from __future__ import annotations

import struct
from collections import namedtuple
from collections.abc import Iterator, Sequence
from functools import cache
from operator import itemgetter
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import all as dialect

V1_MAGIC, V2_MAGIC = 0xFE, 0xFD
SIGNED = 0x01  # incompat flag
SIGNATURE_LENGTH = 13

# PX4 sends these, and pymavlink's dialects do not know them: (name, fields in wire order, format, CRC extra).
_EXTRA: dict[int, tuple[str, str, str, int]] = {
    8: (
        "LINK_NODE_STATUS",
        "timestamp tx_rate rx_rate messages_sent messages_received messages_lost rx_parse_err tx_overflows "
        "rx_overflows tx_buf rx_buf",
        "<QIIIIIHHHBB",
        117,
    ),
    300: (
        "PROTOCOL_VERSION",
        "version min_version max_version spec_version_hash library_version_hash",
        "<HHH8s8s",
        217,
    ),
    380: (
        "TIME_ESTIMATE_TO_TARGET",
        "safe_return land mission_next_item mission_end commanded_action",
        "<iiiii",
        232,
    ),
    410: (
        "EVENT",
        "id event_time_boot_ms sequence destination_component destination_system log_levels arguments",
        "<IIHBBB40s",
        160,
    ),
    411: ("CURRENT_EVENT_SEQUENCE", "sequence flags", "<HB", 106),
}


class Message(NamedTuple):
    """One received frame: who sent it, and its fields as a named tuple."""

    sysid: int
    compid: int
    msgid: int
    fields: Any


class Spec:
    """How one message is laid out."""

    def __init__(self, name: str, declared: list[str], wire: list[str], layout: struct.Struct, crc_extra: int) -> None:
        self.name, self.declared, self.layout, self.crc_extra = name, declared, layout, crc_extra
        self.tuple_type = _tuple_type(name, declared)
        self.arrays: list[int] = []  # numeric array lengths in wire order, 0 = scalar; empty if there are none
        self._to_wire = _permutation([declared.index(n) for n in wire])
        self._to_declared = _permutation([wire.index(n) for n in declared])
        self.system_index = declared.index("target_system") if "target_system" in declared else -1
        self.component_index = declared.index("target_component") if "target_component" in declared else -1

    def pack(self, values: Sequence[Any]) -> bytes:
        """Return the payload of `values` (declaration order), trailing zeros cut as MAVLink 2 does."""
        ordered = self._to_wire(values)
        if self.arrays:
            flat: list[Any] = []
            for length, value in zip(self.arrays, ordered, strict=True):
                if length:
                    flat.extend(value)
                else:
                    flat.append(value)
            ordered = flat
        return self.layout.pack(*ordered).rstrip(b"\0") or b"\0"

    def unpack(self, payload: bytes) -> Any:
        """Return the named tuple of a payload, a truncated one filled up with zeros."""
        size = self.layout.size
        if len(payload) != size:
            payload = payload.ljust(size, b"\0")[:size]
        values: Sequence[Any] = self.layout.unpack(payload)
        if self.arrays:
            grouped: list[Any] = []
            at = 0
            for length in self.arrays:
                grouped.append(list(values[at : at + length]) if length else values[at])
                at += length or 1
            values = grouped
        return self.tuple_type._make(self._to_declared(values))


def _tuple_type(name: str, declared: list[str]) -> Any:
    return namedtuple(name, declared)


def _permutation(order: list[int]) -> Any:
    if len(order) == 1:
        return lambda values: (values[order[0]],)
    return itemgetter(*order)


@cache
def spec(msgid: int) -> Spec | None:
    """Return the layout of a message id, None if nobody knows it."""
    if msgid in _EXTRA:
        name, fields, layout, crc_extra = _EXTRA[msgid]
        return Spec(name, fields.split(), fields.split(), struct.Struct(layout), crc_extra)
    known = dialect.mavlink_map.get(msgid)
    if known is None:
        return None
    wire = list(known.ordered_fieldnames)
    found = Spec(known.msgname, list(known.fieldnames), wire, known.unpacker, known.crc_extra)
    # pymavlink keeps array lengths in wire order, types in declaration order.
    types = dict(zip(known.fieldnames, known.fieldtypes, strict=True))
    lengths = [0 if types[n] == "char" else length for n, length in zip(wire, known.array_lengths, strict=True)]
    found.arrays = lengths if any(lengths) else []
    return found


def pack(msgid: int, values: Sequence[Any]) -> bytes:
    """Return the payload bytes of a message of this dialect."""
    found = spec(msgid)
    assert found is not None, f"no message {msgid}"
    return found.pack(values)


def frame(msgid: int, payload: bytes, seq: int, sysid: int, compid: int, flags: int = 0) -> bytes:
    """Return a MAVLink 2 frame; with `flags` SIGNED its signature is still to be added."""
    found = spec(msgid)
    assert found is not None
    body = _BODY_V2(len(payload), flags, 0, seq, sysid, compid, msgid & 0xFFFF, msgid >> 16) + payload
    crc: int = mcrf4xx(body + _BYTE[found.crc_extra])
    return b"\xfd" + body + _TWO_BYTES(crc)


def frame_v1(msgid: int, payload: bytes, seq: int, sysid: int, compid: int) -> bytes:
    """Return a MAVLink 1 frame: no extension fields, no truncation. Message ids above 255 have none."""
    found = spec(msgid)
    assert found is not None and msgid < 256
    full = payload.ljust(found.layout.size, b"\0")[: v1_length(msgid)]
    head = struct.pack("<BBBBBB", V1_MAGIC, len(full), seq, sysid, compid, msgid) + full
    crc: int = mcrf4xx(head[1:] + _BYTE[found.crc_extra])
    return head + crc.to_bytes(2, "little")


@cache
def v1_length(msgid: int) -> int:
    """Return the payload length in MAVLink 1, which has no extension fields (they come last on the wire)."""
    from pymavlink.dialects.v10 import all as v1  # only for links that speak MAVLink 1

    known = v1.mavlink_map.get(msgid)
    if known is not None:
        return int(known.unpacker.size)
    found = spec(msgid)
    assert found is not None
    return found.layout.size


_BODY_V2, _TWO_BYTES = struct.Struct("<BBBBBBHB").pack, struct.Struct("<H").pack  # what follows the magic byte
_BYTE = [bytes((i,)) for i in range(256)]


class Splitter:
    """Cuts a byte stream into checked frames. Rubbish, unknown ids and bad checksums are counted in `bad`."""

    def __init__(self) -> None:
        self._rest = b""
        self.bad = 0

    @property
    def idle(self) -> bool:
        """Whether nothing unfinished is kept."""
        return not self._rest

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield every complete frame with a right checksum; keep an unfinished tail for the next call."""
        buffer = self._rest + data if self._rest else data
        self._rest = b""
        at, end = 0, len(buffer)
        while at < end:
            magic = buffer[at]
            if magic != V2_MAGIC and magic != V1_MAGIC:
                self.bad += 1
                at = _next_magic(buffer, at + 1)
                continue
            if end - at < 8:
                break
            size = frame_length(buffer, at)
            if end - at < size:
                break
            raw = buffer[at : at + size]
            if checked(raw):
                at += size
                yield raw
            else:
                self.bad += 1
                at = _next_magic(buffer, at + 1)
        self._rest = buffer[at:]


def frame_length(buffer: bytes, at: int = 0) -> int:
    """Return the length of the frame that begins at `at`, 0 if none begins there."""
    if buffer[at] == V2_MAGIC:
        return 12 + buffer[at + 1] + (SIGNATURE_LENGTH if buffer[at + 2] & SIGNED else 0)
    return 8 + buffer[at + 1] if buffer[at] == V1_MAGIC else 0


def _next_magic(buffer: bytes, at: int) -> int:
    places = [p for p in (buffer.find(V2_MAGIC, at), buffer.find(V1_MAGIC, at)) if p >= 0]
    return min(places, default=len(buffer))


def msgid_of(raw: bytes) -> int:
    """Return the message id of a whole frame."""
    return raw[7] | raw[8] << 8 | raw[9] << 16 if raw[0] == V2_MAGIC else raw[5]


def checked(raw: bytes) -> bool:
    """Say whether a whole frame has a known id and the right checksum."""
    found = spec(msgid_of(raw))
    if found is None or (raw[0] == V2_MAGIC and raw[2] & ~SIGNED):
        return False
    end = (10 if raw[0] == V2_MAGIC else 6) + raw[1]
    return bool(mcrf4xx(raw[1:end] + _BYTE[found.crc_extra]) == raw[end] | raw[end + 1] << 8)


def whole(raw: bytes) -> bool:
    """Say whether these bytes are exactly one frame with the right checksum."""
    return len(raw) >= 8 and frame_length(raw) == len(raw) and checked(raw)


def decode(raw: bytes) -> Message:
    """Return the fields of a checked frame."""
    msgid = msgid_of(raw)
    found = spec(msgid)
    assert found is not None
    if raw[0] == V2_MAGIC:
        return Message(raw[5], raw[6], msgid, found.unpack(raw[10 : 10 + raw[1]]))
    return Message(raw[3], raw[4], msgid, found.unpack(raw[6 : 6 + raw[1]]))


def target_of(raw: bytes) -> tuple[int, int]:
    """Return (target system, target component) of a frame, 0 where it has none."""
    found = spec(msgid_of(raw))
    if found is None or found.system_index < 0:
        return 0, 0
    fields = decode(raw).fields
    return fields[found.system_index], fields[found.component_index] if found.component_index >= 0 else 0
