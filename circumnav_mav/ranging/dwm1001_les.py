"""Qorvo (Decawave) DWM1001 with PANS: the lines of its shell command `les`, one anchor a word: ID[x,y,z]=metres.

Example and format: PANS documentation, shell API, `les`. The module starts in binary mode: two carriage returns within
a second open the shell, then `les` starts the lines, and `les` again stops them. It keeps on with them when nobody
reads, so a module that was started before is listened to first, and `les` is only sent to one that says nothing.
An anchor's hexadecimal id is the beacon_id.
"""

from __future__ import annotations

import re

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import TWO_BYTES, ByteSource, Reading
from circumnav_mav.types import Rejected

ANCHOR = re.compile(r"([0-9A-Fa-f]{4})\[[-0-9.,]*\]=(\d{1,4}\.\d\d)")
NO_RANGE = re.compile(r"le_us=\d+|est\[[-0-9.,]*\]|dwm>|les")

LISTEN_S = 2.0
"""A tag ranges 10 times a second as delivered; one slower than this at rest is stopped, and started again."""


def parse(line: str, now_s: float) -> list[Reading | Rejected]:
    """Each word stands for itself: one that was damaged on the way does not cost the others."""
    found: list[Reading | Rejected] = []
    for word in line.split():
        anchor = ANCHOR.fullmatch(word)
        if anchor:
            found.append(Reading(range_m=float(anchor[2]), beacon_id=int(anchor[1], 16)))
        elif not NO_RANGE.fullmatch(word):
            found.append(not_understood(word, now_s))
    return found


SOURCE = ByteSource(
    name="dwm1001_les",
    summary="DWM1001 (PANS shell, command les): centimetres, several anchors by hexadecimal id",
    decoder=lambda options: LineDecoder(parse),
    lines=True,
    resolution_m=0.01,
    carries=frozenset({"beacon_id"}),
    most_beacon_id=TWO_BYTES,
    most_m=1_000.0,
    start=((LISTEN_S, b"\r\r"), (1.0, b"les\r")),
)
