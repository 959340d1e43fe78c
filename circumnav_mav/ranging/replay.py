"""Recorded ranges: lines of t_s, range_m [, range_rate_m_s [, sigma_m [, beacon_id]]], an empty cell being unknown.

`row` writes what `parse` reads. `read` says when each line of a file is due, so that a replay can be fed at its own
pace, and which lines are no ranges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import FARTHEST_M, NAN, ByteSource, Reading, finite
from circumnav_mav.types import RangeSample, Rejected

HEADER = "t_s,range_m,range_rate_m_s,sigma_m,beacon_id"
FORM = f"{HEADER} (the last three may be left out), as in 12.5,80.25"
"""What a line must look like, for people."""


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


class Recording(NamedTuple):
    """What a file of ranges holds."""

    due: list[tuple[float, bytes]]  # seconds after the first range's time, and the line
    ranges: int
    broken: list[tuple[int, str]]  # number and text of each line that is no range

    def complaint(self) -> str:
        """Return in words what is wrong with the file; empty where nothing is."""
        faults = [] if self.ranges else ["it holds no ranges"]
        if self.broken:
            number, line = self.broken[0]
            others = len(self.broken) - 1
            more = f" (nor {'is' if others == 1 else 'are'} {others} more)" if others else ""
            faults.append(f"line {number} is no range{more}: {line[:60]!r}")
        return f"{'; '.join(faults)}; a line is {FORM}" if faults else ""


def read(text: str) -> Recording:
    """Return what a file's text holds. An undated line is due with the one before it.

    Lines are due in the order of the file: a time that steps back is due at once, and the gate sees it do so.
    """
    found = Recording([], 0, [])
    start_s, last_s, ranges = NAN, 0.0, 0
    for number, line in enumerate(text.splitlines(), 1):
        for reading in parse(line.strip(), 0.0) if line.strip() else ():
            if isinstance(reading, Reading):
                ranges += 1
                start_s = reading.stamp_s if math.isnan(start_s) else start_s
                last_s = max(last_s, reading.stamp_s - start_s)
            else:
                found.broken.append((number, line.strip()))
        found.due.append((last_s, line.encode() + b"\n"))
    return found._replace(ranges=ranges)


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
