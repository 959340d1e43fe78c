"""Cutting a byte stream into lines or frames, however it arrives: bounded memory, and noise is counted, not swallowed.

What comes out does not depend on how the bytes were chunked.
"""

from __future__ import annotations

from collections.abc import Callable

from circumnav_mav.ranging.plug import Reading, Reason
from circumnav_mav.types import Rejected

LONGEST_LINE = 512
NOISE_REPORT_BYTES = 256

NEED_MORE, NO_FRAME = 0, -1
"""What a frame probe answers besides the length of a whole and valid frame."""


class LineDecoder:
    """Feeds lines of ASCII to `parse(line, now_s)`; lines end with CR, LF or both, and empty ones are skipped."""

    def __init__(self, parse: Callable[[str, float], list[Reading | Rejected]]) -> None:
        self._parse = parse
        self._partial = bytearray()
        self._overlong = False

    def feed(self, data: bytes, now_s: float) -> list[Reading | Rejected]:
        found: list[Reading | Rejected] = []
        *whole, rest = data.replace(b"\r", b"\n").split(b"\n")
        for line in whole:
            self._partial += line[: LONGEST_LINE + 1]
            found += self._end_line(now_s)
        self._partial += rest[: LONGEST_LINE + 1]
        if len(self._partial) > LONGEST_LINE:
            self._overlong = True
            del self._partial[1:]
        return found

    def _end_line(self, now_s: float) -> list[Reading | Rejected]:
        line, overlong = bytes(self._partial), self._overlong or len(self._partial) > LONGEST_LINE
        self._partial.clear()
        self._overlong = False
        if overlong:
            return [
                Rejected(now_s, Reason.BAD_FRAME, f"a line longer than {LONGEST_LINE} bytes: wrong device or baud?")
            ]
        text = line.decode("ascii", "replace").strip()
        return self._parse(text, now_s) if text else []


def not_understood(line: str, now_s: float) -> Rejected:
    return Rejected(now_s, Reason.BAD_FRAME, f"line not understood: {line[:60]!r}")


class FrameScanner:
    """Cuts frames that begin with the byte `head` out of a stream.

    `probe(candidate)` is asked at each `head`: it returns the length of a whole, valid frame at the start of
    `candidate`, NEED_MORE, or NO_FRAME; it may ask for `longest` bytes at most. Bytes that belong to no frame are
    reported as one bad_frame before the next frame, or every NOISE_REPORT_BYTES.
    """

    def __init__(self, head: int, longest: int, probe: Callable[[memoryview], int]) -> None:
        self._head = head
        self._longest = longest
        self._probe = probe
        self._buffer = bytearray()
        self._noise = 0

    def feed(self, data: bytes, now_s: float) -> list[bytes | Rejected]:
        found: list[bytes | Rejected] = []
        self._buffer += data
        with memoryview(self._buffer) as view:
            used = self._scan(view, now_s, found)
        del self._buffer[:used]
        return found

    def _scan(self, view: memoryview, now_s: float, found: list[bytes | Rejected]) -> int:
        """Add to `found` what the buffer holds; return how many of its bytes are done with."""
        at = 0
        while True:
            start = self._buffer.find(self._head, at)
            start = len(view) if start < 0 else start
            found += self._add_noise(start - at, now_s)
            at = start
            if at == len(view):
                return at
            length = self._probe(view[at : at + self._longest])
            if length == NEED_MORE:
                return at
            if length == NO_FRAME:
                found += self._add_noise(1, now_s)
                at += 1
            else:
                found += self._end_noise(now_s)
                found.append(bytes(view[at : at + length]))
                at += length

    def _add_noise(self, count: int, now_s: float) -> list[Rejected]:
        reports: list[Rejected] = []
        while self._noise + count >= NOISE_REPORT_BYTES:
            count -= NOISE_REPORT_BYTES - self._noise
            self._noise = NOISE_REPORT_BYTES
            reports += self._end_noise(now_s)
        self._noise += count
        return reports

    def _end_noise(self, now_s: float) -> list[Rejected]:
        if not self._noise:
            return []
        count, self._noise = self._noise, 0
        return [Rejected(now_s, Reason.BAD_FRAME, f"{count} bytes that belong to no frame")]
