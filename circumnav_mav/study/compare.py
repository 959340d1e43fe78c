"""`circumnav compare`: laws and estimators over the named scenarios, one row each, as a table or as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass

import numpy as np

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.scenarios import SCENARIOS, Scenario
from circumnav_mav.study.simulate import Pilot, simulate

BEST = ("tangent", "drift")
"""The law and the estimator that planes fly by default."""

LOST_SHARE = 0.25
"""A run is lost when the rms of its tail is above this share of r_a."""

Progress = Callable[[str, int, int], None]
"""(what runs, runs done, runs in all)"""


@dataclass(frozen=True, slots=True)
class Row:
    """What a law on an estimator does in a scenario. Shares are of the runs; tail = the second half of a run."""

    scenario: str
    law: str
    estimator: str
    runs: int
    settled: float  # share inside max(5 % of r_a, 3 sigma_r) for good before the end
    lost: float  # share whose tail rms is above r_a / 4
    settle_time_s: float | None  # median over the settled ones; None when there are none
    tail_ms_m2: float  # mean (r - r_a)^2 over the tails of all runs
    tail_rms_m: float  # its root
    tail_bias_m: float  # mean r - r_a
    worst_rms_m: float  # of the worst run's tail
    u2_ratio: float  # mean u^2 of the tails over (V / r_a)^2, u = the command as limited
    least_range_m: float  # over all runs, from the start on


def row(
    scenario: Scenario,
    pilot: Pilot,
    runs: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
) -> Row:
    """Fly a scenario `runs` times and return its row."""
    flown = simulate(scenario, pilot, runs, seed, progress, workers, executor)
    rms = np.sqrt(flown["tail_ms"])
    settled = np.isfinite(flown["settle_s"])
    ms = float(flown["tail_ms"].mean())
    return Row(
        scenario=scenario.name,
        law=pilot.law,
        estimator=pilot.estimator,
        runs=runs,
        settled=float(settled.mean()),
        lost=float((~(rms <= LOST_SHARE * scenario.r_a_m)).mean()),
        settle_time_s=float(np.median(flown["settle_s"][settled])) if settled.any() else None,
        tail_ms_m2=ms,
        tail_rms_m=math.sqrt(ms),
        tail_bias_m=float(flown["tail_bias"].mean()),
        worst_rms_m=float(rms.max()),
        u2_ratio=float(flown["tail_u2"].mean()) / scenario.turn_rate_on_the_circle**2,
        least_range_m=float(flown["least_range"].min()),
    )


def flies_on(law: str, estimator: str) -> bool:
    """Return whether the estimator gives what the law needs."""
    return set(LAWS[law].needs) <= ESTIMATORS[estimator].gives


def pairs(laws: Sequence[str], estimators: Sequence[str]) -> list[tuple[str, str]]:
    """Return the combinations that can fly."""
    return [(law, estimator) for law in laws for estimator in estimators if flies_on(law, estimator)]


def left_out(laws: Sequence[str], estimators: Sequence[str]) -> list[str]:
    """Return a line for each combination of what is known that cannot fly, saying what the estimate lacks."""
    lines = []
    for law in (name for name in laws if name in LAWS):
        for estimator in (name for name in estimators if name in ESTIMATORS):
            missing = sorted(set(LAWS[law].needs) - ESTIMATORS[estimator].gives)
            if missing:
                lines.append(f"left out: {law} cannot fly on {estimator}, which does not give {', '.join(missing)}")
    return lines


def compare(
    scenarios: Iterable[str],
    laws: Sequence[str] = (BEST[0],),
    estimators: Sequence[str] = (BEST[1],),
    runs: int = 100,
    seed: int = 1,
    progress: Progress | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    keep: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Return a row for every scenario and every combination that can fly; keep is told each as soon as it is flown.

    ValueError, with the names that exist, for one that does not, and when nothing can fly.
    """
    names = list(scenarios)
    for given, known, what in (
        (names, SCENARIOS, "scenario"),
        (laws, LAWS, "law"),
        (estimators, ESTIMATORS, "estimator"),
    ):
        for name in given:
            if name not in known:
                raise ValueError(f"no {what} is called {name!r}; there are {', '.join(known)}")
    if runs < 1:
        raise ValueError(f"runs must be 1 or more, not {runs}")
    flown = pairs(laws, estimators)
    if not flown:
        raise ValueError(
            f"{', '.join(laws)} cannot fly on {', '.join(estimators)}: the estimate lacks what the law needs"
        )
    rows = []
    jobs = [(name, law, estimator) for law, estimator in flown for name in names]
    for n, (name, law, estimator) in enumerate(jobs):
        tell = _teller(progress, f"{name} {law} {estimator}", n * runs, runs, len(jobs) * runs)
        rows.append(row(SCENARIOS[name], Pilot(law, estimator), runs, seed, tell, workers, executor))
        if keep:
            keep(rows[-1])
    return rows


def _teller(progress: Progress | None, title: str, before: int, runs: int, whole: int) -> Callable[[int], None]:
    done = 0

    def tell(more: int) -> None:
        nonlocal done
        done += more
        if progress:
            progress(title, before + min(done, runs), whole)

    return tell


COLUMNS = (
    ("scenario", 15, None),
    ("law", 17, None),
    ("estimator", 9, None),
    ("runs", 5, 0),
    ("settled", 7, 3),
    ("lost", 5, 3),
    ("settle_time_s", 6, 1),
    ("tail_ms_m2", 8, 5),
    ("tail_rms_m", 7, 3),
    ("tail_bias_m", 7, 3),
    ("worst_rms_m", 7, 3),
    ("u2_ratio", 7, 3),
    ("least_range_m", 7, 1),
)
"""Name, width, and decimals where it is a number: 120 characters with the blanks between them."""


def header() -> str:
    """Return the names of the columns; one that is wider than its figures stands on two lines."""
    above, below = [], []
    for name, width, decimals in COLUMNS:
        first, _, rest = name.partition("_") if len(name) > width else ("", "", name)
        above.append(_aligned(first, width, decimals))
        below.append(_aligned(rest, width, decimals))
    return "\n".join(" ".join(names).rstrip() for names in (above, below))


def line(row: Row) -> str:
    """Return a row as plain text."""
    return " ".join(_cell(getattr(row, name), width, decimals) for name, width, decimals in COLUMNS)


def _cell(value: str | float | None, width: int, decimals: int | None) -> str:
    if isinstance(value, str):
        return _aligned(value, width, decimals)
    number, places = math.nan if value is None else value, decimals or 0
    texts = [f"{number:{width}.{n}f}" for n in range(places, -1, -1)]
    return next((text for text in texts if len(text) <= width), texts[-1])  # fewer decimals rather than a wider table


def _aligned(text: str, width: int, decimals: int | None) -> str:
    return text.ljust(width) if decimals is None else text.rjust(width)


def to_json(rows: Iterable[Row]) -> str:
    """Return the rows as a JSON list; a number that does not exist is null."""
    return json.dumps([{k: finite(v) for k, v in asdict(one).items()} for one in rows], indent=1)


def finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value
