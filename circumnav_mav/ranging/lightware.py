"""LightWare laser range finders (SF02, SF10, SF11, LW20 ...): ASCII lines such as `98.67`, or `?LD 98.67` when asked.

The unit (`98.67 m`, `98.67m`) may follow. Format: SF11 product manual, appendix "Command set". A lost signal is sent as
130.00 (SF11) or as a negative number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import ByteDecoder, ByteSource, Reading, Reason, number
from circumnav_mav.types import Rejected

LINE = re.compile(r"(?:\?LD[ !]?)?(-?\d{1,4}\.\d{1,3})(?: ?m)?")
LOST = re.compile(r"-+\.-+(?: ?m)?")
HALF_STEP_M = 0.005


def decoder(options: Mapping[str, Any]) -> ByteDecoder:
    lost_m = number(options, "lost_m", 130.0)

    def parse(line: str, now_s: float) -> list[Reading | Rejected]:
        match = LINE.fullmatch(line)
        if match is None:
            lost = LOST.fullmatch(line)
            return [Rejected(now_s, Reason.NO_READING, "signal lost") if lost else not_understood(line, now_s)]
        range_m = float(match[1])
        if range_m < 0.0 or abs(range_m - lost_m) < HALF_STEP_M:
            return [Rejected(now_s, Reason.NO_READING, f"{range_m:.2f} m stands for a lost signal")]
        return [Reading(range_m=range_m)]

    return LineDecoder(parse)


SOURCE = ByteSource(
    name="lightware",
    summary="LightWare laser range finder, ASCII lines: centimetres (older models: 9600 baud)",
    decoder=decoder,
    lines=True,
    resolution_m=0.01,
    most_m=10_000.0,
    options={"lost_m": "the range that stands for a lost signal, 130.00 as delivered"},
)
