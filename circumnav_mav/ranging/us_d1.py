"""Ainstein (Aerotenna) US-D1 radar: 6 bytes FE 02, range in cm (low byte first), signal-to-noise ratio, checksum.

Packet and checksum: US-D1 user manual, table "UART Data Packet Definition": (version + low + high + SNR) & 0xFF.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from circumnav_mav.ranging.framing import NEED_MORE, NO_FRAME, FrameScanner
from circumnav_mav.ranging.plug import ByteSource, Reading, Reason, number
from circumnav_mav.types import Rejected

HEAD, VERSION, LENGTH = 0xFE, 0x02, 6
MOST_CM = 0xFFFF


def _probe(candidate: memoryview) -> int:
    if len(candidate) > 1 and candidate[1] != VERSION:
        return NO_FRAME
    if len(candidate) < LENGTH:
        return NEED_MORE
    return LENGTH if sum(candidate[1:5]) & 0xFF == candidate[5] else NO_FRAME


class Decoder:
    def __init__(self, options: Mapping[str, Any]) -> None:
        self._min_snr = number(options, "min_snr", 0.0, least=0.0)
        self._scanner = FrameScanner(HEAD, LENGTH, _probe)

    def feed(self, data: bytes, now_s: float) -> list[Reading | Rejected]:
        return [
            frame if isinstance(frame, Rejected) else self._read(frame, now_s)
            for frame in self._scanner.feed(data, now_s)
        ]

    def _read(self, frame: bytes, now_s: float) -> Reading | Rejected:
        range_cm, snr = int.from_bytes(frame[2:4], "little"), frame[4]
        if range_cm in (0, MOST_CM):  # the manual names no word for "nothing"; no radar ranges to a full field
            return Rejected(now_s, Reason.NO_READING, f"range {range_cm} cm, SNR {snr}")
        if snr < self._min_snr:
            return Rejected(now_s, Reason.INVALID_QUALITY, f"SNR {snr} is below min_snr {self._min_snr:g}")
        return Reading(range_m=range_cm / 100.0)


SOURCE = ByteSource(
    name="us_d1",
    summary="Ainstein US-D1 radar: centimetres",
    decoder=Decoder,
    resolution_m=0.01,
    most_m=655.36,
    options={"min_snr": "reject ranges with a smaller signal-to-noise byte, 0 as delivered"},
)
