"""Recorded ranges: lines of t_s, range_m [, range_rate_m_s [, sigma_m [, beacon_id]]], an empty cell being unknown.

`row` writes what `parse` reads. `schedule` says when each line is due, so that a replay can be fed at its own pace.
"""

from __future__ import annotations

import math

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import FARTHEST_M, NAN, ByteSource, Reading, finite
from circumnav_mav.types import RangeSample, Rejected

HEADER = "t_s,range_m,range_rate_m_s,sigma_m,beacon_id"


def row(sample: RangeSample) -> str:
    """Return one line (without its end) for a sample, to the last bit."""
    beacon = "" if sample.beacon_id is None else str(sample.beacon_id)
    values = (sample.t_s, sample.range_m, sample.range_rate_m_s, sample.sigma_m)
    return ",".join(["" if math.isnan(value) else repr(value) for value in values] + [beacon])


def parse(line: str, now_s: float) -> list[Reading | Rejected]:
    """Read one line; comments (#), the header and a byte order mark are passed over."""
    line = line.removeprefix("\ufeff")
    if line.startswith(("#", "t_s")):
        return []
    cells = [cell.strip() for cell in line.split(",")]
    if not 2 <= len(cells) <= 5 or not cells[0] or not cells[1]:
        return [not_understood(line, now_s)]
    t_s, range_m, rate, sigma, beacon = cells + [""] * (5 - len(cells))
    try:
        return [
            Reading(
                range_m=finite(range_m),
                range_rate_m_s=finite(rate) if rate else NAN,
                sigma_m=finite(sigma) if sigma else NAN,
                beacon_id=_id(beacon) if beacon else None,
                stamp_s=finite(t_s),
            )
        ]
    except ValueError:
        return [not_understood(line, now_s)]


def _id(text: str) -> int:
    """Return a beacon's number. Spreadsheets and pandas write 1.0 in a column with gaps. ValueError: not whole."""
    number = finite(text)
    if not number.is_integer():
        raise ValueError(text)
    return int(number)


def schedule(text: str) -> list[tuple[float, bytes]]:
    """Return (seconds after the first line's time, line as bytes) for every line; an undated one goes with the last.

    Lines are due in the order of the file: a time that steps back is due at once, and the gate sees it do so.
    """
    due: list[tuple[float, bytes]] = []
    start_s, last_s = NAN, 0.0
    for line in text.splitlines():
        for reading in parse(line.strip(), 0.0):
            if isinstance(reading, Reading):
                start_s = reading.stamp_s if math.isnan(start_s) else start_s
                last_s = max(last_s, reading.stamp_s - start_s)
        due.append((last_s, line.encode() + b"\n"))
    return due


SOURCE = ByteSource(
    name="replay",
    summary="a file of recorded ranges: t_s, range_m [, range_rate_m_s [, sigma_m [, beacon_id]]]",
    decoder=lambda options: LineDecoder(parse),
    lines=True,
    resolution_m=0.01,
    carries=frozenset({"beacon_id", "stamp_s"}),
    most_m=FARTHEST_M,
    has_rate=True,
)
