"""What an estimator costs in plain Python, as it flies: for `make bench`.

The same flight is flown several times, and each step counts with its least time: what else the machine does is no cost
of the estimator.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from dataclasses import dataclass

from circumnav_mav.guidance.estimators import ESTIMATORS, make
from circumnav_mav.guidance.kernel import EstimatorContext, Motion
from circumnav_mav.types import RangeSample

V_M_S, R_A_M, RATE_HZ, TICKS_A_RANGE = 15.0, 80.0, 50.0, 5
FULL_RANGES = 5
"""Ranges after the first one during which a ring is surely full."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Medians over the steps of a flight, microseconds."""

    estimator: str
    full_us: float  # an update while the ring of hypotheses is full
    update_us: float  # an update once the target is known
    tick_us: float  # advance + at, likewise


def estimator_costs(flight_s: float = 30.0, repeats: int = 8) -> list[Cost]:
    """Return the cost of every estimator over the same circle flown at 50 Hz with ranges at 10 Hz."""
    return [_cost(name, flight_s, repeats) for name in ESTIMATORS]


def _cost(name: str, flight_s: float, repeats: int) -> Cost:
    flights = [_flight(name, flight_s) for _ in range(repeats)]
    updates, ticks = ([min(step) for step in zip(*times, strict=True)] for times in zip(*flights, strict=True))
    median = statistics.median
    return Cost(
        name,
        median(updates[1 : FULL_RANGES + 1]) / 1e3,
        median(updates[len(updates) // 2 :]) / 1e3,
        median(ticks[len(ticks) // 2 :]) / 1e3,
    )


def _flight(name: str, flight_s: float) -> tuple[list[int], list[int]]:
    """Return what every update and every tick took, ns."""
    est = make(name, {}, EstimatorContext(R_A_M, V_M_S, 0.46))
    draw = random.Random(1)
    updates, ticks = [], []
    for n in range(int(flight_s * RATE_HZ)):
        t = n / RATE_HZ
        psi = -V_M_S / R_A_M * t
        motion = Motion(V_M_S, -V_M_S / R_A_M, math.remainder(psi, 2.0 * math.pi))
        r = math.hypot(R_A_M * math.sin(-psi) + 5.0, R_A_M * math.cos(psi))  # a circle beside the target
        start = time.perf_counter_ns()
        est.advance(t, motion)
        est.at(t, motion)
        ticks.append(time.perf_counter_ns() - start)
        if n % TICKS_A_RANGE == 0:
            sample = RangeSample(t, r + draw.gauss(0.0, 1.0), math.nan, 1.0)
            start = time.perf_counter_ns()
            est.on_sample(sample, motion)
            updates.append(time.perf_counter_ns() - start)
    return updates, ticks


if __name__ == "__main__":
    for cost in estimator_costs():
        print(cost)
