"""OmniPreSense OPS241 / OPS243 radar in JSON mode (OJ): range and Doppler speed are objects of their own, a line each.

    {"unit":"mps", "time":105, "tick":135, "speed":0.58, "direction":"inbound"}     {"unit":"m", "range":6.3}

A range is given the speed of the last PAIR_S seconds. Inbound is closing (range rate < 0); without a direction the sign
tells: the radar's positive is inbound. Where several objects are reported the first (the strongest) is taken; whether
speed and range are of the same object the radar does not say. Keys: OPS242 and OPS243 user manuals, "Data Output".
"""

from __future__ import annotations

import json
import math
from typing import Any

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import NAN, ByteSource, Reading, finite
from circumnav_mav.ranging.units import LENGTH, SPEED
from circumnav_mav.types import Rejected

PAIR_S = 0.25
SPEED_UNITS = {"mps": "m/s", "cmps": "cm/s", "fps": "ft/s", "kmph": "km/h", "mph": "mph"}


class _Parser:
    def __init__(self) -> None:
        self._rate_m_s, self._rate_at_s = NAN, -math.inf

    def __call__(self, line: str, now_s: float) -> list[Reading | Rejected]:
        try:
            report = json.loads(line)
        except (ValueError, RecursionError):
            return [not_understood(line, now_s)]
        if not isinstance(report, dict):
            return [not_understood(line, now_s)]
        try:
            if "speed" in report:
                self._rate_m_s, self._rate_at_s = _range_rate(report), now_s
            if "range" not in report:
                return []  # a setting or an answer to a query
            fresh = 0.0 <= now_s - self._rate_at_s <= PAIR_S
            range_m = (
                finite(_first(report["range"])) * LENGTH[report.get("unit", "m") if "speed" not in report else "m"]
            )
            return [Reading(range_m, self._rate_m_s if fresh else NAN, stamp_s=_stamp(report))]
        except (KeyError, TypeError, ValueError):
            return [not_understood(line, now_s)]


def _first(value: Any) -> Any:
    return value[0] if isinstance(value, list) and value else value


def _range_rate(report: dict[str, Any]) -> float:
    speed = finite(_first(report["speed"])) * SPEED[SPEED_UNITS[report.get("unit", "mps")]]
    direction = _first(report.get("direction"))
    if direction == "outbound":
        return abs(speed)
    if direction == "inbound":
        return -abs(speed)
    return -speed


def _stamp(report: dict[str, Any]) -> float:
    """Return the radar's time [s]; whole seconds without the milliseconds of `tick` are too coarse to use."""
    time, tick = report.get("time"), report.get("tick")
    if tick is not None:
        return finite(time) + finite(tick) * 1e-3
    return finite(time) if isinstance(time, float) or "." in str(time) else NAN


SOURCE = ByteSource(
    name="omnipresense",
    summary="OmniPreSense OPS241/OPS243 radar, JSON lines: range and Doppler speed",
    decoder=lambda options: LineDecoder(_Parser()),
    lines=True,
    resolution_m=0.01,
    baud=19_200,  # of its UART (UM-003-A); over USB any is right
    most_m=1_000.0,
    has_rate=True,
    carries=frozenset({"stamp_s"}),
    start=((0.0, b"OJ"),),
)
