"""The gate at sample level: what no ranging device may say, whatever the vehicle does. Pure.

It judges one channel (one beacon of one sensor). Whether a range fits the vehicle's motion, the estimators say.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from circumnav_mav.ranging.plug import NAN, Reading, Reason
from circumnav_mav.types import RangeSample, Rejected

STUCK_LEAST_REPEATS = 5
STUCK_S, STUCK_MOST_S = 3.0, 60.0
"""How long a value may stand in flight, at least and at most, where stuck_s is not given."""
STANDS, TIMES_LONGER = 20, 10.0
"""It may stand this many times longer than any of so many values before it."""
MOST_RATE_M_S = 1000.0
"""A range rate beyond this is no measurement, whatever flies."""


@dataclass(frozen=True, slots=True)
class Limits:
    """min_m, max_m, min_quality_pct: NaN = no limit; stuck_s: None = by the values before, 0 = never judged.

    most_m: the source's own bound, which a max_m that is given takes the place of.
    """

    max_age_s: float = 1.0
    min_m: float = NAN
    max_m: float = NAN
    most_m: float = NAN
    min_quality_pct: float = NAN
    stuck_s: float | None = None


class Gate:
    """`judge` returns None for a sample to fly on, else why not."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._last_s = -math.inf
        self._last_identity: tuple[float, int | None, float] | None = None
        self._last_sequence: int | None = None
        self._same_m = NAN
        self._same_since_s = NAN
        self._same_count = 0
        self._stuck = False
        self._stood_s: deque[float] = deque(maxlen=STANDS)

    def judge(self, reading: Reading, sample: RangeSample, now_s: float, *, moving: bool = True) -> Rejected | None:
        """Judge `sample`, made of `reading` and arrived at `now_s` [s]; `moving`: the vehicle may be taken to move."""
        return (
            self._judge_value(reading, sample, now_s)
            or self._judge_time(reading, sample, now_s)
            or self._judge_stuck(reading, now_s, moving)
        )

    def _judge_value(self, reading: Reading, sample: RangeSample, now_s: float) -> Rejected | None:
        r_m, limits = sample.range_m, self._limits
        if not math.isfinite(r_m) or math.isinf(sample.range_rate_m_s):
            return Rejected(now_s, Reason.NOT_FINITE, f"range {r_m} m, rate {sample.range_rate_m_s} m/s")
        if reading.quality_pct <= 0.0:
            return Rejected(now_s, Reason.INVALID_QUALITY, "the sensor calls this range invalid")
        if reading.quality_pct < limits.min_quality_pct:
            return Rejected(
                now_s,
                Reason.INVALID_QUALITY,
                f"quality {reading.quality_pct:.0f} % is below min_quality_pct {limits.min_quality_pct:.0f} %",
            )
        if reading.range_m < reading.least_m or reading.range_m > reading.most_m:
            return Rejected(
                now_s,
                Reason.OUT_OF_RANGE,
                f"{reading.range_m:.2f} m is outside the sensor's own {reading.least_m:.2f} to {reading.most_m:.2f} m",
            )
        if r_m <= 0.0 or r_m < limits.min_m or r_m > limits.max_m:
            return Rejected(now_s, Reason.OUT_OF_RANGE, f"{r_m:.6g} m is outside the configured limits or not positive")
        return self._judge_possible(sample, now_s)

    def _judge_possible(self, sample: RangeSample, now_s: float) -> Rejected | None:
        """Reject what no device can have measured: a garbled or sentinel number is finite as often as not."""
        limits = self._limits
        most_m = limits.most_m if math.isnan(limits.max_m) else limits.max_m
        if sample.range_m > most_m:
            text = (
                f"{sample.range_m:.4g} m is farther than such a sensor ranges ({most_m:g} m): set ranging.max_m if not"
            )
        elif sample.sigma_m > most_m:
            text = f"a claimed sigma of {sample.sigma_m:.4g} m, over {most_m:g} m, says that nothing was measured"
        elif abs(sample.range_rate_m_s) > MOST_RATE_M_S:
            text = f"a range rate of {sample.range_rate_m_s:.4g} m/s is no measurement"
        else:
            return None
        return Rejected(now_s, Reason.OUT_OF_RANGE, text)

    def _judge_time(self, reading: Reading, sample: RangeSample, now_s: float) -> Rejected | None:
        age_s = now_s - sample.t_s
        if not age_s <= self._limits.max_age_s:
            return Rejected(
                now_s, Reason.STALE, f"{age_s:.2f} s old on arrival, max_age_s is {self._limits.max_age_s:g}"
            )
        if sample.t_s < self._last_s:
            return Rejected(
                now_s, Reason.TIME_BACKWARDS, f"{self._last_s - sample.t_s:.3f} s before the sample before it"
            )
        last_sequence, self._last_sequence = self._last_sequence, reading.sequence
        identity = _identity(reading)
        if identity is not None and identity == self._last_identity:
            return Rejected(now_s, Reason.DUPLICATE, "the same stamp, sequence and range as the sample before it")
        if reading.sequence is not None and last_sequence is not None:
            behind = (last_sequence - reading.sequence) % 256
            if 0 < behind < 128:
                return Rejected(now_s, Reason.TIME_BACKWARDS, f"{behind} behind the newest sequence number")
        self._last_identity = identity
        self._last_s = sample.t_s
        return None

    def _judge_stuck(self, reading: Reading, now_s: float, moving: bool) -> Rejected | None:
        """Judge a value that does not change. What is stuck stays so until it does: standing still mends no sensor."""
        if reading.range_m != self._same_m:
            if not self._stuck and not math.isnan(self._same_m):
                self._stood_s.append(now_s - self._same_since_s)
            self._stuck = False
            self._same_m = reading.range_m
        elif moving or self._stuck:
            self._same_count += 1
            same_for_s = now_s - self._same_since_s
            self._stuck = self._stuck or (
                0.0 < self.may_stand_s < same_for_s and self._same_count >= STUCK_LEAST_REPEATS
            )
            if not self._stuck:
                return None
            return Rejected(now_s, Reason.STUCK, f"{reading.range_m:.3f} m, unchanged for {same_for_s:.1f} s")
        self._same_since_s, self._same_count = now_s, 0
        return None

    @property
    def may_stand_s(self) -> float:
        """How long a value may stand in flight before it is stuck [s]; 0 = for ever.

        Noise changes the range of a radio with every measurement, and motion that of any sensor, so that a value which
        stands is a fault within seconds. Only a circle flown well keeps the range of a sensor whose noise is less than
        its steps; and it comes to that by and by, each value standing a little longer than the one before.
        """
        if self._limits.stuck_s is not None:
            return self._limits.stuck_s
        return min(max(STUCK_S, TIMES_LONGER * max(self._stood_s, default=0.0)), STUCK_MOST_S)


def _identity(reading: Reading) -> tuple[float, int | None, float] | None:
    """What makes two readings one measurement; None where the device gives nothing to tell by."""
    if math.isnan(reading.stamp_s):
        return None if reading.sequence is None else (0.0, reading.sequence, reading.range_m)
    return (reading.stamp_s, reading.sequence, reading.range_m)
