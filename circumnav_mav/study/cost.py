"""What an estimator costs in plain Python, as it flies: for `make bench`."""

from __future__ import annotations

import math
import random
import statistics
import time
from dataclasses import dataclass

from circumnav_mav.guidance.estimators import ESTIMATORS, make
from circumnav_mav.guidance.kernel import EstimatorContext, Motion
from circumnav_mav.types import RangeSample


@dataclass(frozen=True, slots=True)
class Cost:
    """Microseconds. `first`: an update while the ring is full; `update`, `tick`: once the target is known.

    Medians, and of the update also the fifth percentile: what it takes where nothing else wants the core.
    """

    estimator: str
    first_us: float
    update_us: float
    update_p5_us: float
    tick_us: float  # advance + at


def estimator_costs(flight_s: float = 60.0, rate_hz: float = 50.0) -> list[Cost]:
    """Return the cost of every estimator over the same circle flown at 50 Hz with ranges at 10 Hz."""
    return [_cost(name, flight_s, rate_hz) for name in ESTIMATORS]


def _cost(name: str, flight_s: float, rate_hz: float) -> Cost:
    V, r_a = 15.0, 80.0
    est = make(name, {}, EstimatorContext(r_a, V, 0.46))
    draw = random.Random(1)
    first: list[int] = []
    updates: list[int] = []
    ticks: list[int] = []
    for n in range(int(flight_s * rate_hz)):
        t = n / rate_hz
        psi = -V / r_a * t
        motion = Motion(V, -V / r_a, math.remainder(psi, 2.0 * math.pi))
        r = math.hypot(r_a * math.sin(-psi) + 5.0, r_a * math.cos(psi))  # a circle beside the target
        start = time.perf_counter_ns()
        est.advance(t, motion)
        est.at(t, motion)
        ticks.append(time.perf_counter_ns() - start)
        if n % 5 == 0:
            sample = RangeSample(t, r + draw.gauss(0.0, 1.0), math.nan, 1.0)
            start = time.perf_counter_ns()
            est.on_sample(sample, motion)
            (first if 1 <= n // 5 <= 5 else updates).append(time.perf_counter_ns() - start)
    half = len(updates) // 2
    median = statistics.median
    known = sorted(updates[half:])
    p5 = known[len(known) // 20]
    return Cost(name, median(first) / 1e3, median(known) / 1e3, p5 / 1e3, median(ticks[len(ticks) // 2 :]) / 1e3)


if __name__ == "__main__":
    print("estimator  update, us  (5 %)  tick, us  ring full, us")
    for c in estimator_costs():
        print(f"{c.estimator:9}  {c.update_us:10.0f}  {c.update_p5_us:5.0f}  {c.tick_us:8.0f}  {c.first_us:13.0f}")
