"""Frames: split a stream by looking at the message id first, check the CRC, decode only what is subscribed; and pack.

Any bytes give frames or counts, never an exception. MAVLink 2 throughout; MAVLink 1 frames are read, not written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from struct import Struct
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx

from circumnav_mav.mavlink.dialect import CRC_EXTRA, Layout, by_name, layout, quick
from circumnav_mav.mavlink.signing import Signer

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
HEADER_1, HEADER_2 = 6, 10
CHECKSUM, SIGNATURE = 2, 13
SIGNED = 0x01
NOISE_BYTES = 100


class Frame(NamedTuple):
    """One whole frame. checked: its checksum was looked at, and is right."""

    msgid: int
    sysid: int
    compid: int
    seq: int
    raw: bytes
    checked: bool

    @property
    def signed(self) -> bool:
        """Whether it carries a signature, right or wrong."""
        return self.raw[0] == MAGIC_2 and bool(self.raw[2] & SIGNED)


class Message(NamedTuple):
    """A decoded message: where it came from and its fields (a named tuple, MAVLink's own field names and units)."""

    name: str
    sysid: int
    compid: int
    seq: int
    fields: Any


_frame: Callable[[tuple[int, int, int, int, bytes, bool]], Frame] = quick(Frame)
_message: Callable[[tuple[str, int, int, int, Any]], Message] = quick(Message)
_HEADER_1, _HEADER_2 = Struct("<6B"), Struct("<7BHB")


@dataclass(slots=True)
class LinkCounts:
    """What came in, for the report: nothing on a link is dropped without being counted."""

    frames: int = 0
    decoded: int = 0
    unknown: int = 0
    bad_crc: int = 0
    rubbish_bytes: int = 0

    def since(self, before: LinkCounts) -> LinkCounts:
        """Return what came in after these counts were `before`."""
        return LinkCounts(*(getattr(self, f.name) - getattr(before, f.name) for f in fields(self)))

    @property
    def understood(self) -> int:
        """Frames whose checksum proves them; one of an unknown id may be noise."""
        return self.frames - self.unknown

    @property
    def noise(self) -> bool:
        """Whether what comes is not MAVLink at all (a wrong baud rate, another protocol).

        Of the places in noise that look like a frame, one in 65,536 has the right checksum.
        """
        return self.rubbish_bytes > NOISE_BYTES * (1 + self.understood)


class Splitter:
    """Cuts a byte stream, or datagrams, into frames.

    checked: names of the messages whose checksum matters because somebody reads them; None = all. Of the others, and of
    ids that the dialect does not know, the length is believed only where a frame or nothing follows.
    """

    def __init__(self, checked: Iterable[str] | None = None) -> None:
        names = None if checked is None else {by_name(name).msgid for name in checked}
        self._extra = {i: extra for i, extra in CRC_EXTRA.items() if names is None or i in names}
        self.counts = LinkCounts()
        self._tail = b""

    def feed(self, data: bytes, *, whole: bool) -> list[Frame]:
        """Return the frames in `data`. `whole`: a datagram, which no frame outlives; else the rest is kept.

        One loop on purpose: this is the hot path, and a call a frame would cost as much as the frame.
        """
        buf = self._tail + data if self._tail else data
        frames: list[Frame] = []
        at, size = 0, len(buf)
        counts, crc_extra = self.counts, self._extra
        while at < size:
            magic = buf[at]
            if magic == MAGIC_2 and at + HEADER_2 <= size:
                header = HEADER_2
                _, length, flags, _, seq, sysid, compid, low, high = _HEADER_2.unpack_from(buf, at)
                msgid = low | high << 16
                end = at + HEADER_2 + length + CHECKSUM
                if flags:
                    if flags != SIGNED:  # the standard: a frame with unknown flags must not be understood
                        at = self._skip(buf, at)
                        continue
                    end += SIGNATURE
            elif magic == MAGIC_1 and at + HEADER_1 <= size:
                header = HEADER_1
                _, length, seq, sysid, compid, msgid = _HEADER_1.unpack_from(buf, at)
                end = at + HEADER_1 + length + CHECKSUM
            elif magic in (MAGIC_1, MAGIC_2) and not whole:
                break
            else:
                at = self._skip(buf, at)
                continue
            if end > size:
                if not whole:
                    break
                at = self._skip(buf, at)
                continue
            extra = crc_extra.get(msgid)
            if extra is not None:
                body_end = at + header + length
                crc = mcrf4xx(extra, mcrf4xx(buf[at + 1 : body_end]))
                if crc != buf[body_end] | buf[body_end + 1] << 8:
                    counts.bad_crc += 1
                    at = self._skip(buf, at)
                    continue
            elif end < size and buf[end] != MAGIC_2 and buf[end] != MAGIC_1:
                at = self._skip(buf, at)
                continue
            elif msgid not in CRC_EXTRA:
                counts.unknown += 1
            frames.append(_frame((msgid, sysid, compid, seq, buf[at:end], extra is not None)))
            at = end
        self._tail = b"" if whole else buf[at:]
        counts.frames += len(frames)
        return frames

    def _skip(self, buf: bytes, at: int) -> int:
        """Return the next place after `at` where a frame may begin."""
        two, one = buf.find(MAGIC_2, at + 1), buf.find(MAGIC_1, at + 1)
        follow = min((p for p in (two, one) if p >= 0), default=len(buf))
        self.counts.rubbish_bytes += follow - at
        return follow


class Decoder:
    """Turns the frames of subscribed ids into messages; all others cost a set look-up."""

    def __init__(self, names: Iterable[str]) -> None:
        self._layouts: dict[int, Layout] = {by_name(name).msgid: by_name(name) for name in names}
        self.decoded = 0

    def decode(self, frame: Frame) -> Message | None:
        """Return the message, or None where its id is not subscribed."""
        msgid, sysid, compid, seq, raw, _ = frame
        shape = self._layouts.get(msgid)
        if shape is None:
            return None
        self.decoded += 1
        header = HEADER_2 if raw[0] == MAGIC_2 else HEADER_1
        return _message((shape.name, sysid, compid, seq, shape.unpack(raw, header, raw[1])))


class Packer:
    """Packs messages under one identity with its own sequence number."""

    def __init__(self, sysid: int, compid: int, signer: Signer | None = None) -> None:
        self.sysid = sysid
        self.compid = compid
        self._signer = signer
        self._seq = 0

    def pack(self, name: str, /, **fields: Any) -> bytes:
        """Return the frame of message `name`. Raises KeyError for a missing or unknown field."""
        shape = by_name(name)
        payload = shape.pack(fields)
        msgid = shape.msgid
        flags = SIGNED if self._signer else 0
        body = bytes(
            (len(payload), flags, 0, self._seq, self.sysid, self.compid, msgid & 0xFF, msgid >> 8 & 0xFF, msgid >> 16)
        )
        self._seq = (self._seq + 1) & 0xFF
        body += payload
        crc = mcrf4xx(CRC_EXTRA[msgid], mcrf4xx(body))
        frame = b"\xfd" + body + crc.to_bytes(2, "little")
        return frame + self._signer.sign(frame) if self._signer else frame


def name_of(msgid: int) -> str:
    """Return the name of a message id, for people."""
    shape = layout(msgid)
    return shape.name if shape else f"message {msgid}"
