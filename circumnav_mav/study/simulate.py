"""Runs a scenario many times, on every core. The same numbers for a seed, whatever the number of workers."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import drive, kernels
from circumnav_mav.study.noise import Floats, draw
from circumnav_mav.study.scenarios import PLANNED_LAG_S, Scenario

CHUNK = 10
"""Runs that a worker takes at a time."""

UNLIMITED_TURN = math.pi / 4.0
"""What laws and estimators are told that one command turns at most, rad, where no limit is: more is not steering."""

Outcomes = NDArray[np.void]
"""A structured array with the fields of drive.Outcome, one row a run."""

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Pilot:
    """A law on an estimator, with the options that differ from the defaults."""

    law: str
    estimator: str
    law_options: Mapping[str, float] = field(default_factory=dict)
    estimator_options: Mapping[str, float] = field(default_factory=dict)

    def parameters(self, scenario: Scenario) -> tuple[Any, Any]:
        """Return what the kernels of estimator and law take in this scenario."""
        limit = scenario.limit_rad_s
        if math.isinf(limit):
            limit = UNLIMITED_TURN / scenario.control_s
        est = EstimatorContext(scenario.r_a_m, scenario.V_m_s, limit)
        law = LawContext(scenario.r_a_m, scenario.V_m_s, limit, PLANNED_LAG_S[scenario.name[0]])
        return (
            ESTIMATORS[self.estimator].parameters(self.estimator_options, est),
            LAWS[self.law].parameters(self.law_options, law),
        )


@cache
def program(law: str, estimator: str) -> Callable[..., Any]:
    """Return `drive` bound to a law and an estimator, compiled where numba is."""
    return kernels.compiled(drive.drive, bound(law, estimator))


def bound(law: str, estimator: str) -> dict[str, Callable[..., Any]]:
    """Return the kernels of a law and an estimator by the names that `drive` calls them by."""
    e, flown = ESTIMATORS[estimator], LAWS[law]
    return {
        "BEGIN": e.begin,
        "OBSERVE": e.observe,
        "CARRY": e.carry,
        "RIVALS": e.rivals,
        "LAW": flown.turn_rate,
        "ESCAPE": flown.escape,
    }


def setup(scenario: Scenario) -> drive.Setup:
    """Return the scenario as the driver takes it."""
    return drive.Setup(
        steps=round(scenario.duration_s / scenario.control_s),
        range_every=scenario.range_every,
        latency=scenario.latency_steps,
        r_a=scenario.r_a_m,
        sigma_r=scenario.sigma_r_m,
        believed=scenario.believed_speed,
        heading_error=math.radians(scenario.heading_error_deg),
        heading_drift=math.radians(scenario.heading_drift_deg_s),
        band=max(0.05 * scenario.r_a_m, 3.0 * scenario.sigma_r_m),
    )


def fly_one(scenario: Scenario, pilot: Pilot, seed: int, index: int, trace: bool = False) -> tuple[Any, Floats]:
    """Fly run `index` and return (drive.Outcome, trace)."""
    chance = draw(scenario, seed, index)
    est_par, law_par = pilot.parameters(scenario)
    s = setup(scenario)
    path = np.zeros((s.steps if trace else 0, 8))
    gaps = np.array(scenario.gaps_s, dtype=float).reshape(-1, 2)
    noise = (chance.range_error_m, chance.rate_error_m_s, chance.gust_x, chance.gust_y)
    fly = program(pilot.law, pilot.estimator)
    return fly(s, chance.plant, chance.start, *noise, gaps, est_par, law_par, path), path


def fly_chunk(scenario: Scenario, pilot: Pilot, seed: int, first: int, last: int) -> list[Any]:
    """Return the outcomes of runs first ... last - 1: what one worker does at a time, here or on another machine."""
    return [fly_one(scenario, pilot, seed, index)[0] for index in range(first, last)]


def simulate(
    scenario: Scenario,
    pilot: Pilot,
    runs: int,
    seed: int,
    progress: Progress | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
) -> Outcomes:
    """Return the outcomes of the runs.

    progress is told the number of runs that each finished chunk adds. workers: default, one a core. executor: takes the
    chunks elsewhere, in place of them.
    """
    outcomes: list[Any] = []
    if executor is None:
        outcomes += fly_chunk(scenario, pilot, seed, 0, min(1, runs))  # compiles before the workers start
        if progress:
            progress(len(outcomes))
    chunks = [(first, min(first + CHUNK, runs)) for first in range(len(outcomes), runs, CHUNK)]
    with nullcontext(executor) if executor else _pool(workers or len(os.sched_getaffinity(0))) as pool:
        futures = [pool.submit(fly_chunk, scenario, pilot, seed, *chunk) for chunk in chunks]
        try:
            for future in futures:
                flown = future.result()
                outcomes += flown
                if progress:
                    progress(len(flown))
        except BaseException:  # Ctrl-C: what has not begun is not flown, or leaving would take as long as staying
            for future in futures:
                future.cancel()
            raise
    dtype = [(name, float) for name in drive.Outcome._fields]
    return np.array([tuple(outcome) for outcome in outcomes], dtype=dtype)


def _pool(workers: int) -> Executor:
    """Return threads for compiled kernels, which let go of the interpreter; processes for plain Python."""
    if kernels.available():
        return ThreadPoolExecutor(workers)
    ignored = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to every process of a terminal: the parent answers it
    return ProcessPoolExecutor(workers, initializer=signal.signal, initargs=ignored)
