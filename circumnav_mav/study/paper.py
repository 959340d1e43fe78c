"""`circumnav study`: the paper's simulations with more runs than it had, confidence intervals, a JSON summary.

Conditions are those of section V: V = 1, r_a = 10, sigma = 0.5 on r_dot, control held for 0.5 s, 350 s, 20 gains from
0.1 in steps of 0.15, and the same in a wind of V/4 towards pi/4. The paper gives neither its initial conditions nor its
averaging window: here every run starts at (-20, 0) heading 0, and means are taken over the whole run and over its tail.
"""

from __future__ import annotations

import json
import math
import time
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.special import stdtrit

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import paper_run
from circumnav_mav.study.paper_run import Case, Plant, Progress, Table

LAW = "hashemi2013"
SWEPT = tuple(name for name, law in LAWS.items() if "kappa" in law.options)
"""The laws with a gain kappa = k r_a."""

AIRS = ("calm", "wind")
FIELDS = ("mse_all", "mse_tail", "rdot2_all", "rdot2_tail", "u2_tail", "bias_tail")
GAINS = tuple(round(0.1 + 0.15 * n, 2) for n in range(20))
START_MAX_M = 1e6
"""A run goes 350 m: it would see nothing of the target from there, and far beyond, squares of metres overflow."""
GAIN_MAX_RAD_M = 1e6
"""From k = 2 pi on the vehicle may turn right round within a hold; squares of far larger ones overflow."""

WIND_SHARE, WIND_TOWARDS_RAD = 0.25, math.pi / 4


@dataclass(frozen=True, slots=True)
class Options:
    """What a user may change; the defaults are the study of the documentation."""

    runs: int = 500  # trajectories for each gain and wind
    seed: int = 1
    start_m: tuple[float, float] = (-20.0, 0.0)
    heading_rad: float = 0.0
    window: float = 0.5  # share of the run, at its end, that counts as its tail
    gains_rad_m: tuple[float, ...] = GAINS
    workers: int | None = None  # None: one a core
    law: str = LAW  # one with a gain kappa
    estimator: str | None = None  # None: the truth, with noise on r_dot

    @property
    def as_the_paper(self) -> bool:
        """The paper's law, told what the paper tells it."""
        return self.law == LAW and self.estimator is None

    def flown(self, law: str | None = None) -> str:
        """Return in words what flies: a law, these options' own unless named, and what tells it where it is."""
        told = "the true range and a noisy range rate" if self.estimator is None else f"estimator {self.estimator}"
        return f"{law or self.law} on {told}"

    def plant(self, air: str) -> Plant:
        """Return the paper's plant in calm air or in its wind. Raises ValueError in words for nonsense."""
        if self.runs < 2:
            raise ValueError("a confidence interval needs at least 2 runs")
        if not math.hypot(*self.start_m) <= START_MAX_M:
            raise ValueError(f"start within {START_MAX_M:g} m of the target, not at {self.start_m}")
        calm = Plant(x_m=self.start_m[0], y_m=self.start_m[1], heading_rad=self.heading_rad, tail=self.window)
        if air == "calm":
            return calm
        wind = WIND_SHARE * calm.V_m_s
        return replace(calm, wind_x_m_s=wind * math.cos(WIND_TOWARDS_RAD), wind_y_m_s=wind * math.sin(WIND_TOWARDS_RAD))

    def cases(self) -> list[Case]:
        """Return a case for each air and gain, each in noise of its own. Raises ValueError in words."""
        for name, known in ((self.law, SWEPT), (self.estimator, [None, *ESTIMATORS])):
            if name not in known:
                raise ValueError(f"{name!r} cannot be swept over a gain; there are: {', '.join(filter(None, known))}")
        if max(self.gains_rad_m) > GAIN_MAX_RAD_M:
            raise ValueError(f"gains k up to {GAIN_MAX_RAD_M:g} rad/m are flown, not {max(self.gains_rad_m):g}")
        pairs = [(air, k) for air in AIRS for k in self.gains_rad_m]
        return [self.case(self.law, k, self.plant(air), stream) for stream, (air, k) in enumerate(pairs)]

    def case(self, law: str, k: float, plant: Plant, stream: int = 0) -> Case:
        """Return a case of a law at a gain k [rad/m], on the estimator of these options."""
        return paper_run.case(law, {"kappa": k * plant.r_a_m}, plant, stream, self.estimator)


@dataclass(frozen=True, slots=True)
class StudyResult:
    options: Options
    rows: Table  # RESULT rows (air, gain, run)
    elapsed_s: float
    steps: int  # trajectory-steps flown

    @property
    def rate_hz(self) -> float:
        """Trajectory-steps a second."""
        return self.steps / self.elapsed_s

    def mean(self, air: str, field: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the mean over the runs for each gain."""
        means: np.ndarray[Any, np.dtype[np.float64]] = self.rows[AIRS.index(air)][field].mean(axis=1)
        return means

    def ci95(self, air: str, field: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return half the width of the 95 % confidence interval of that mean (Student's t; runs are independent)."""
        values = self.rows[AIRS.index(air)][field]
        quantile = float(stdtrit(values.shape[1] - 1, 0.975))
        half: np.ndarray[Any, np.dtype[np.float64]] = quantile * values.std(axis=1, ddof=1) / math.sqrt(values.shape[1])
        return half

    def summary(self) -> dict[str, Any]:
        """Return what `--json` writes: for wind and calm, lists over k, and `_ci95` half-widths beside them."""
        out: dict[str, Any] = {
            "options": asdict(self.options),
            "elapsed_s": self.elapsed_s,
            "steps_per_s": self.rate_hz,
        }
        for air in AIRS:
            lists = {"k": list(self.options.gains_rad_m)}
            for field in FIELDS:
                lists[field] = self.mean(air, field).tolist()
                lists[f"{field}_ci95"] = self.ci95(air, field).tolist()
            out[air] = lists
        return out

    def table(self, air: str) -> list[list[str]]:
        """Return the paper's statistics as text, a header row first: mean +- half the 95 % interval."""
        fields = ("mse_all", "mse_tail", "rdot2_all", "rdot2_tail")
        table = [["k rad/m", *(f"{TITLES[field]}" for field in fields)]]
        means, halves = ([f(air, field) for field in fields] for f in (self.mean, self.ci95))
        for n, k in enumerate(self.options.gains_rad_m):
            cells = [f"{mean[n]:.4f} ± {half[n]:.4f}" for mean, half in zip(means, halves, strict=True)]
            table.append([f"{k:g}", *cells])
        return table


TITLES = {
    "mse_all": "(r-r_a)² m², whole run",
    "mse_tail": "(r-r_a)² m², tail",
    "rdot2_all": "r_dot² m²/s², whole run",
    "rdot2_tail": "r_dot² m²/s², tail",
}


def run(options: Options, progress: Progress | None = None, executor: Executor | None = None) -> StudyResult:
    """Fly the whole study. The compiler runs before the clock of `elapsed_s` starts, but not that of an executor's."""
    cases = options.cases()
    if executor is None:
        paper_run.sweep(cases[:1], 1, options.seed, workers=1)
    begun_s = time.perf_counter()
    rows = paper_run.sweep(
        cases, options.runs, options.seed, workers=options.workers, executor=executor, progress=progress
    )
    elapsed_s = time.perf_counter() - begun_s
    steps = len(cases) * options.runs * cases[0].plant.steps
    return StudyResult(options, rows.reshape(len(AIRS), len(options.gains_rad_m), options.runs), elapsed_s, steps)


def write_json(result: StudyResult, file: Path) -> None:
    """Write the summary. Raises ValueError in words where a figure is no number: JSON knows none such."""
    try:
        text = json.dumps(result.summary(), indent=1, allow_nan=False)
    except ValueError:
        raise ValueError(f"{file} is not written: some means of these runs are not finite numbers") from None
    file.write_text(text + "\n", encoding="utf-8")


def save(result: StudyResult, file: Path) -> None:
    """Write every run's statistics; `load` gives the result back."""
    about = {"options": asdict(result.options), "elapsed_s": result.elapsed_s, "steps": result.steps}
    paper_run.save(file, result.rows, about)


def load(file: Path) -> StudyResult:
    """Return a result that `save` wrote. Raises ValueError in words for any other file."""
    try:
        rows, about = paper_run.load(file)
        fields: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in about["options"].items()
        }
        return StudyResult(Options(**fields), rows, about["elapsed_s"], about["steps"])
    except (ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
        raise ValueError(f"{file} is not a file that `circumnav study --save` wrote") from error
