"""What an estimator costs in plain Python, as it flies: for `make bench`.

The same flight is flown several times, and each step counts with its least time: what else the machine does is no cost
of the estimator.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from dataclasses import dataclass, replace

from circumnav_mav.guidance.estimators import ESTIMATORS, make
from circumnav_mav.guidance.height_choice import HeightChoice
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext, Motion
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.noise import draw
from circumnav_mav.study.plant import fly, range_and_rate
from circumnav_mav.study.scenarios import SCENARIOS, Scenario
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


OPEN = 6
"""A bank of `drift` with more hypotheses than this is not settled yet: three kinds of air, of two places at most."""
HIGH_M = 100.0


@dataclass(frozen=True, slots=True)
class EntryCost:
    """What updates cost on the way to the circle, where the turns of the flight decide what is known."""

    name: str
    open_s: tuple[float, float, float]  # least, median and most time with a bank of more than OPEN, over the entries
    open_us: float  # median update meanwhile
    worst_us: float  # 99 % of the updates are quicker


def entry_costs(entries: int = 12, repeats: int = 4) -> list[EntryCost]:
    """Return the cost of `tangent` on `drift` in R_wind5, from anywhere and from far, and of two filters (auto)."""
    near = replace(SCENARIOS["R_wind5"], duration_s=75.0)
    far = replace(near, start_m=(1500.0, 2000.0), duration_s=150.0)
    rows = ("drift", near, False), ("drift, from 1.5 to 2 km", far, False), ("drift, target_height_m: auto", near, True)
    return [_entry_cost(name, scenario, auto, entries, repeats) for name, scenario, auto in rows]


def _entry_cost(name: str, scenario: Scenario, auto: bool, entries: int, repeats: int) -> EntryCost:
    took_us, times_s = [], []
    for index in range(entries):
        flights = [_entry(scenario, index, auto) for _ in range(repeats)]
        updates = [(min(us for us, _ in step), step[0][1]) for step in zip(*flights, strict=True)]
        took_us += [us for us, size in updates if size > OPEN]
        times_s.append(sum(size > OPEN for _, size in updates) * scenario.range_every * scenario.control_s)
    took_us.sort()
    open_s = min(times_s), statistics.median(times_s), max(times_s)
    return EntryCost(name, open_s, statistics.median(took_us), took_us[int(0.99 * len(took_us))])


def _entry(scenario: Scenario, index: int, auto: bool) -> list[tuple[float, int]]:
    """Fly run `index` of seed 1 in plain Python; return what every update took, us, and how many hypotheses it left."""
    chance, law = draw(scenario, 1, index), LAWS["tangent"]
    context = EstimatorContext(scenario.r_a_m, scenario.V_m_s, scenario.limit_rad_s)
    par = law.parameters({}, LawContext(scenario.r_a_m, scenario.V_m_s, scenario.limit_rad_s, scenario.lag_s))
    choice = HeightChoice(lambda: make("drift", {}, context))
    errors_m = chance.range_error_m.tolist()  # arithmetic on numpy's own floats costs thrice as much; no app hears them
    alone, world, updates = make("drift", {}, context), chance.start, []
    for n in range(round(scenario.duration_s / scenario.control_s)):
        motion = Motion(scenario.V_m_s, world.u, world.psi)
        (choice if auto else alone).advance(world.t, motion)
        if n % scenario.range_every == 0:
            r = range_and_rate(world, chance.plant)[0] + errors_m[n // scenario.range_every]
            sample = RangeSample(world.t, math.hypot(r, HIGH_M) if auto else r, math.nan, scenario.sigma_r_m)
            start = time.perf_counter_ns()
            if auto:
                choice.on_sample(sample, motion, HIGH_M, 0.0)
            else:
                alone.on_sample(sample, motion)
            took = time.perf_counter_ns() - start
            updates.append(
                (took / 1e3, max(len(one._bank) for one in ([*choice._tried.values()] if auto else [alone])))
            )
        flown = choice.flown if auto else alone
        est, rivals = flown.at(world.t, motion), flown.rivals(world.t, motion)
        u = 0.0 if est is None else law.escape(law.turn_rate(est, par), est, rivals, par)
        world = fly(world, u, chance.plant, 0.0, 0.0)
    return updates


if __name__ == "__main__":
    for cost in estimator_costs():
        print(cost)
    for entry in entry_costs():
        print(entry)
