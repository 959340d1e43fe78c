"""Many trajectories of the paper's plant on all cores: what a case is, the sweep, and results on disk.

A case flies a law on the truth with noise on the range rate, as the paper does, or on an estimator. A run is the same
for a seed whatever the number of workers and whichever machine flies it: its noise is keyed by the seed, the case and
the run (noise.py), and its arithmetic does not depend on its neighbours.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import drive, plant, simulate
from circumnav_mav.study import paper_core as core
from circumnav_mav.study.noise import normals

RESULT = np.dtype(
    [(f"{what}_{when}", np.float64) for when in ("all", "tail") for what in ("bias", "mse", "rdot2", "u2")]
)
"""One row a run: means over the control instants of r - r_a [m], its square, r_dot^2 [m^2/s^2] and u^2 [rad^2/s^2]."""

SAMPLE = np.dtype([(name, np.float64) for name in ("t_s", "x_m", "y_m", "psi_rad", "r_m", "r_dot_m_s", "u_rad_s")])
"""One row a control instant of a single recorded run."""

Table = NDArray[np.void]
Progress = Callable[[int, int], None]

KNOWN = frozenset(("r", "r_dot", "V", "u", "px", "py", "wx", "wy"))
"""What the plant tells a law without an estimator: the truth, with noise on r_dot."""

CHUNK, FAR_CHUNK = 128, 1024
"""Runs flown in one task: by a thread of this process, and by an executor, whose tasks cost a millisecond each."""


@dataclass(frozen=True, slots=True)
class Plant:
    """The paper's section V, and what can be changed about it."""

    V_m_s: float = 1.0
    r_a_m: float = 10.0
    hold_s: float = 0.5
    duration_s: float = 350.0
    sigma_m_s: float = 0.5  # standard deviation of the noise on r_dot, drawn anew at each control instant
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0
    sigma_r_m: float = 0.1  # the same on r, for an estimator; without one a law is told the true r, as in the paper
    delay_s: float = 0.0  # measurement to turn, beyond the hold; rounded to whole holds
    x_m: float = -20.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    tail: float = 0.5  # share of the run, at its end, over which *_tail is taken

    @property
    def steps(self) -> int:
        return round(self.duration_s / self.hold_s)

    @property
    def kernel(self) -> tuple[float, float, float, float, float]:
        return (self.V_m_s, self.hold_s, self.wind_x_m_s, self.wind_y_m_s, self.r_a_m)


@dataclass(frozen=True, slots=True)
class Case:
    """One cell of a sweep: it can be sent to another process or machine."""

    law: str  # a name in the registry
    parameters: Any  # the law's NamedTuple
    plant: Plant
    stream: int = 0  # cases with the same stream are flown in the same noise
    estimator: str | None = None  # a name in the registry; None: the truth, with noise on r_dot
    estimator_parameters: Any = None  # the estimator's NamedTuple


def case(
    law: str,
    options: dict[str, float],
    plant: Plant,
    stream: int = 0,
    estimator: str | None = None,
    estimator_options: Mapping[str, float] | None = None,
) -> Case:
    """Return a case from the options of the `law:` and `estimator:` sections.

    Raises ValueError in words for what cannot be flown.
    """
    entry = LAWS[law]
    missing = set(entry.needs) - (KNOWN if estimator is None else ESTIMATORS[estimator].gives)
    if missing:
        who = "the paper's plant" if estimator is None else f"estimator {estimator}"
        raise ValueError(f"law {law} needs {', '.join(sorted(missing))}, which {who} does not tell")
    if plant.x_m == 0.0 and plant.y_m == 0.0:
        raise ValueError("start somewhere else than on the target itself: there is no range rate there")
    if plant.steps < 1 or not 0.0 < plant.tail <= 1.0:
        raise ValueError("the run must last at least one hold, and the tail be a share above 0 and up to 1")
    if estimator is None:
        return Case(law, entry.parameters(options, law_context(plant)), plant, stream)
    limit = simulate.UNLIMITED_TURN / plant.hold_s
    told = replace(law_context(plant), turn_rate_limit=limit)
    parameters = ESTIMATORS[estimator].parameters(
        {**ESTIMATORS[estimator].options, **(estimator_options or {})},
        EstimatorContext(plant.r_a_m, plant.V_m_s, limit),
    )
    return Case(law, entry.parameters({**entry.options, **options}, told), plant, stream, estimator, parameters)


def law_context(plant: Plant) -> LawContext:
    """Return what a law may know of this plant: it turns at once and as sharply as asked."""
    return LawContext(r_a=plant.r_a_m, V=plant.V_m_s, turn_rate_limit=math.inf, turn_lag_s=0.0)


def sde_sigma(sigma: float, hold_s: float) -> float:
    """Return the noise [m/s] at one control instant that makes the SDE of diffusion -k sigma, for short holds."""
    return sigma / math.sqrt(hold_s)


def fly(one: Case, seed: int, first: int, count: int) -> Table:
    """Return RESULT rows of the runs first ... first + count - 1 of a case."""
    if one.estimator is not None:
        return _estimated(one, seed, first, count)
    plant = one.plant
    noise = normals(seed, one.stream, first, count, plant.steps)
    noise *= plant.sigma_m_s
    heading = (math.cos(plant.heading_rad), math.sin(plant.heading_rad))
    start = np.repeat(np.array([[plant.x_m], [plant.y_m], [heading[0]], [heading[1]]]), count, axis=1)
    return fly_in(one, start, noise)


def fly_in(one: Case, start: core.Floats, noise: core.Floats) -> Table:
    """Return RESULT rows of runs from given starts (4, n) in given noise (n, steps) [m/s]."""
    plant, steps = one.plant, noise.shape[1]
    tail_from = steps - max(1, round(plant.tail * steps))
    rows, fill = np.empty(len(noise), RESULT), -len(noise) % core.LANES
    if fill:
        start, noise = np.pad(start, ((0, 0), (0, fill)), mode="edge"), np.pad(noise, ((0, fill), (0, 0)), mode="edge")
    sums = np.empty((2, len(core.SUMS), len(noise)))
    batch = core.program(core.batch, LAWS[one.law].turn_rate)
    delay = round(plant.delay_s / plant.hold_s)
    batch(one.parameters, plant.kernel, start, noise, delay, tail_from, sums)
    for what, early, late in zip(("bias", "mse", "rdot2", "u2"), sums[0], sums[1], strict=True):
        rows[f"{what}_all"] = (early + late)[: len(rows)] / steps
        rows[f"{what}_tail"] = late[: len(rows)] / (steps - tail_from)
    return rows


def _estimated(one: Case, seed: int, first: int, count: int) -> Table:
    """Return RESULT rows of runs on an estimator, from their traces."""
    steps = one.plant.steps
    rows, tail = np.empty(count, RESULT), slice(steps - max(1, round(one.plant.tail * steps)), None)
    for run in range(count):
        flown = trace(one, seed, first + run)
        error = flown["r_m"] - one.plant.r_a_m
        told = {"bias": error, "mse": error**2, "rdot2": flown["r_dot_m_s"] ** 2, "u2": flown["u_rad_s"] ** 2}
        for what, values in told.items():
            rows[f"{what}_all"][run], rows[f"{what}_tail"][run] = values.mean(), values[tail].mean()
    return rows


def sweep(
    cases: Sequence[Case],
    runs: int,
    seed: int,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Table:
    """Return RESULT rows (cases, runs). `executor` takes the tasks elsewhere; else threads, by default one a core."""
    rows = np.empty((len(cases), runs), RESULT)
    own = ThreadPoolExecutor(workers or os.cpu_count() or 1) if executor is None else None
    pool, chunk = own or executor, CHUNK if executor is None else FAR_CHUNK
    assert pool is not None
    try:
        tasks = {
            pool.submit(fly, one, seed, first, min(chunk, runs - first)): (index, first)
            for index, one in enumerate(cases)
            for first in range(0, runs, chunk)
        }
        for done, future in enumerate(as_completed(tasks), start=1):
            index, first = tasks[future]
            some = future.result()
            rows[index, first : first + len(some)] = some
            if progress is not None:
                progress(done, len(tasks))
    finally:
        if own is not None:
            own.shutdown(cancel_futures=True)
    return rows


def trace(one: Case, seed: int, run: int = 0) -> Table:
    """Return SAMPLE rows of one run in the noise of `fly`; without an estimator by the plain core.

    Raises ValueError for a delay without an estimator: the plain core flies none.
    """
    plant = one.plant
    if one.estimator is None and round(plant.delay_s / plant.hold_s) > 0:
        raise ValueError(f"a trace without an estimator has no delay, and {plant.delay_s:g} s was asked for; use fly")
    noise = plant.sigma_m_s * normals(seed, one.stream, run, 1, plant.steps)[0]
    if one.estimator is not None:
        return _estimated_trace(one, seed, run, noise)
    law, state, u = LAWS[one.law].turn_rate, (plant.x_m, plant.y_m, plant.heading_rad), 0.0
    rows = np.empty(plant.steps, SAMPLE)
    for n, nu in enumerate(noise):
        here = state
        state, r, r_dot, u = core.plain_step(law, one.parameters, state, float(nu), u, plant.kernel)
        rows[n] = (n * plant.hold_s, *here, r, r_dot, u)
    return rows


def _estimated_trace(one: Case, seed: int, run: int, rate_noise: core.Floats) -> Table:
    """Fly one run by the study's driver: every hold brings a range and a range rate, with noise on both."""
    assert one.estimator is not None
    p, none = one.plant, np.zeros(0)
    setup = drive.Setup(
        p.steps, 1, round(p.delay_s / p.hold_s), p.r_a_m, p.sigma_r_m, 1.0, 0.0, 0.0, band=0.05 * p.r_a_m
    )
    air = plant.Plant(p.V_m_s, p.hold_s, 0.0, math.inf, p.wind_x_m_s, p.wind_y_m_s, 0.0, 0.0, 1.0, 0.0, math.inf)
    start = plant.World(0.0, p.x_m, p.y_m, p.heading_rad, *(0.0,) * 7)
    range_noise = p.sigma_r_m * normals(seed, one.stream, run, 1, p.steps, channel=1)[0]
    path = np.zeros((p.steps, 8))
    fly = simulate.program(one.law, one.estimator)
    fly(
        setup,
        air,
        start,
        range_noise,
        rate_noise,
        none,
        none,
        np.zeros((0, 2)),
        one.estimator_parameters,
        one.parameters,
        path,
    )
    t, x, y, _, _, _, psi, u = path.T
    r = np.hypot(x, y)
    r_dot = (x * (p.V_m_s * np.cos(psi) + p.wind_x_m_s) + y * (p.V_m_s * np.sin(psi) + p.wind_y_m_s)) / r
    rows = np.empty(p.steps, SAMPLE)
    for name, values in zip(SAMPLE.names or (), (t, x, y, psi, r, r_dot, u), strict=True):
        rows[name] = values
    return rows


def save(file: Path, rows: Table, about: dict[str, Any]) -> None:
    """Write structured results and what they are about; `load` reads them back, bit for bit."""
    with file.open("wb") as out:
        np.savez_compressed(out, rows=rows, about=np.array(json.dumps(about)))


def load(file: Path) -> tuple[Table, dict[str, Any]]:
    """Return what `save` wrote."""
    with np.load(file, allow_pickle=False) as data:
        return data["rows"], json.loads(str(data["about"]))
