"""What a ranging sensor is doing right now, for people: rate, age, jitter, noise and rejections. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from math import nan, sqrt
from statistics import fmean, median

from circumnav_mav.ranging.counts import Counts
from circumnav_mav.types import RangeSample, Rejected

WINDOW_S = 10.0
MOST_KEPT = 4096


@dataclass(frozen=True, slots=True)
class Status:
    """The last WINDOW_S in figures; NaN: not known yet.

    age_s: since the last range was true; delay_s: mean age of a range when it arrives, NaN where nothing tells (no
    stamps and no latency_s); delay_name: what to call that; jitter_s: standard deviation of the time between arrivals;
    longest_gap_s: the longest time without one, the current one included; noise_m: standard deviation of one range that
    its neighbours do not explain; accepted, rejected, details: since the start.
    """

    rate_hz: float
    age_s: float
    delay_s: float
    delay_name: str
    jitter_s: float
    longest_gap_s: float
    noise_m: float
    last: RangeSample | None
    accepted: int
    rejected: dict[str, int]
    details: dict[str, str]


class Monitor:
    """Watches the results of one receiver; `counts` is that receiver's."""

    def __init__(self, counts: Counts, start_s: float) -> None:
        self.whole_delay = True
        """Whether delay_s is all of the delay: False where a line finds it, which sees only what of it varies."""
        self._counts = counts
        self._start_s = start_s
        self._recent: deque[tuple[float, RangeSample]] = deque(maxlen=MOST_KEPT)  # (arrival, sample)
        self._last: RangeSample | None = None

    def add(self, result: RangeSample | Rejected, now_s: float) -> None:
        if isinstance(result, RangeSample):
            self._last = result
            self._recent.append((now_s, result))

    def status(self, now_s: float) -> Status:
        last = self._last
        while self._recent and now_s - self._recent[0][0] > WINDOW_S:
            self._recent.popleft()
        arrivals = [at_s for at_s, _ in self._recent]
        gaps = [b - a for a, b in pairwise(arrivals)]
        watched_s = min(WINDOW_S, now_s - self._start_s)
        return Status(
            rate_hz=len(arrivals) / watched_s if watched_s > 0.0 else nan,
            age_s=now_s - last.t_s if last else nan,
            # Exactly 0 is no delay that was measured: without stamps a range is dated by its arrival.
            delay_s=(fmean(at_s - sample.t_s for at_s, sample in self._recent) or nan) if self._recent else nan,
            delay_name="delay" if self.whole_delay else "delay, varying part",
            jitter_s=_deviation(gaps),
            longest_gap_s=max([*gaps, now_s - arrivals[-1]]) if arrivals else watched_s,
            noise_m=_noise([sample.range_m for _, sample in self._recent]),
            last=last,
            accepted=self._counts.accepted,
            rejected=dict(self._counts.rejected),
            details=dict(self._counts.last_detail),
        )


def _deviation(values: list[float]) -> float:
    if len(values) < 2:
        return nan
    mean = fmean(values)
    return sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))


def _noise(ranges_m: list[float]) -> float:
    """Return the standard deviation of white noise on a smooth range, from second differences and robust to outliers.

    A second difference of white noise has 6 times its variance, and a median of |x| is 0.6745 sigma for a normal x.
    """
    if len(ranges_m) < 10:
        return nan
    second = [abs(a - 2.0 * b + c) for a, b, c in zip(ranges_m, ranges_m[1:], ranges_m[2:], strict=False)]
    return median(second) / (0.6745 * sqrt(6.0))
