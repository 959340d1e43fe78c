"""`circumnav tune`: gains of law and estimator for one aircraft, found by flying it in the study's simulation.

Four things are wanted at once: little error in calm air, little in the worst of wind and speed error, quick settling,
little effort. NSGA-II (optuna) searches for the set of gains that no others beat in all four; the answer is the one of
them that a stated preference likes best, judged by noise that the search had not seen.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from circumnav_mav.config import Config
from circumnav_mav.study.aircraft import Aircraft, Gains, fresh_gains, gains_of
from circumnav_mav.study.simulate import fly_chunk, fly_one
from circumnav_mav.study.tune_spaces import SPACES, Space

Progress = Callable[[int, int], None]

BEST_PAIR = ("tangent", "drift")
"""Tried beside the configured pair."""

EFFORT_ROOM = 2.0
"""The search goes up to so many times the present effort: further out is no trade that anyone makes."""

FINALISTS, AGAIN = 6, 3
"""So many of the preferred candidates are flown again, in so many times the runs and in other noise: the luckiest of a
search is not the best of it."""

TASK_RUNS = 4
"""Runs that a worker takes at a time."""

FRESH, FINAL = 1_000_003, 2_000_003
"""Added to the seed for the noise of the verdict and of the finalists."""


Flown = Sequence[tuple["Gains", "Score"]]
"""Candidates and how they flew, the present gains first."""


class Score(NamedTuple):
    """How a candidate flew. Errors are over the tail; a run counts with at most 2 r_a."""

    rms_calm_m: float
    rms_worst_m: float  # in the worst of the three situations
    effort: float  # mean u^2 over (V / r_a)^2: the circle alone costs 1
    settle_s: float  # mean; a run that never settled counts with its whole length
    lost: float  # share of runs whose tail's rms is above r_a / 4

    @property
    def objectives(self) -> tuple[float, float, float, float]:
        """The logarithms of error, effort, settling and robustness, each to be small: ratios are what counts.

        Effort below the circle's own is no saving: the circle is then not flown.
        """
        return (
            math.log(self.rms_calm_m),
            math.log(max(1.0, self.effort)),
            math.log(1.0 + self.settle_s),
            math.log(self.rms_worst_m),
        )

    def value(self, most_effort: float) -> float:
        """Return what the preference makes small: relative changes of the four, weighed against each other."""
        calm, effort, settle, worst = self.objectives
        wish = 0.7 * worst + 0.3 * calm + 0.5 * settle + 0.2 * effort
        return wish + 20.0 * max(0.0, effort - math.log(most_effort)) + 10.0 * self.lost


OBJECTIVES = ("error in calm", "effort", "settling", "error at worst")
"""What Score.objectives holds, in its order."""


@dataclass(frozen=True, slots=True)
class Tuned:
    aircraft: Aircraft
    present: Gains
    best: Gains  # of the search
    flown: Flown  # the present gains, then every candidate of the search in order
    before: Score  # of the present gains, on fresh noise
    after: Score  # of the best ones, on the same
    fresh_runs: int

    @property
    def won(self) -> bool:
        """Whether the best of the search does better on the fresh runs too, by the same preference."""
        limit = max(1.0, self.before.effort)
        return self.after.value(limit) < self.before.value(limit)


def judge(gains: Gains, runs: int, seed: int, pool: Executor) -> Score:
    """Fly `runs` runs in each of the aircraft's situations and return their score; the noise hangs on the seed only."""
    assert gains.aircraft is not None
    r_a, scenarios = gains.aircraft.r_a_m, gains.aircraft.scenarios()
    tasks = [
        pool.submit(fly_chunk, scenario, gains, seed, first, min(first + TASK_RUNS, runs))
        for scenario in scenarios
        for first in range(0, runs, TASK_RUNS)
    ]
    outcomes = [outcome for task in tasks for outcome in task.result()]

    def table(name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([getattr(o, name) for o in outcomes]).reshape(len(scenarios), runs)

    squares, settle = table("tail_ms"), table("settle_s")
    rms = np.sqrt(np.minimum(squares, (2.0 * r_a) ** 2).mean(axis=1))
    return Score(
        rms_calm_m=float(rms[0]),
        rms_worst_m=float(rms.max()),
        effort=float(table("tail_u2").mean() / (gains.aircraft.V_m_s / r_a) ** 2),
        settle_s=float(np.where(np.isnan(settle), scenarios[0].duration_s, settle).mean()),
        lost=float((np.sqrt(squares) > 0.25 * r_a).mean()),
    )


def tune(
    config: Config,
    aircraft: Aircraft,
    *,
    seed: int = 1,
    evaluations: int = 96,
    runs: int = 12,
    fresh_runs: int = 100,
    keep_pair: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Tuned:
    """Search the gains, `evaluations` a pair, and judge the best against the present ones on fresh noise.

    Effort beyond that of the present gains (or the circle's own, where they fall short of it) is a soft limit: each
    per cent more weighs as much as a third more error at worst, so the answer may ask for a little more, not for much.
    The same numbers for a seed, whatever the workers (default: one a core). executor: takes the flights elsewhere, in
    place of threads.
    """
    present = gains_of(config, aircraft)
    pairs = [present]
    if not keep_pair and (present.law, present.estimator) != BEST_PAIR:
        pairs.append(fresh_gains(*BEST_PAIR, aircraft))
    total = 1 + len(pairs) * evaluations + FINALISTS + 2

    def tell(done: int) -> None:
        if progress is not None:
            progress(done, total)

    if executor is None:
        for base in pairs:
            fly_one(aircraft.scenarios()[0], base, seed, 0)  # compiles before the workers start
    with nullcontext(executor) if executor else ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        flown = _candidates(pairs, evaluations, seed, lambda gains: judge(gains, runs, seed, pool), tell)
        best = _best(flown, lambda gains: judge(gains, AGAIN * runs, seed + FINAL, pool))
        tell(total - 2)
        before, after = (judge(gains, fresh_runs, seed + FRESH, pool) for gains in (present, best))
        tell(total)
    return Tuned(aircraft, present, best, flown, before, after, fresh_runs)


def _candidates(
    pairs: Sequence[Gains], evaluations: int, seed: int, fly: Callable[[Gains], Score], tell: Callable[[int], None]
) -> Flown:
    """Return the present gains, the first of the pairs, and all that the search tries of each pair."""
    from circumnav_mav.study.nsga import Judged, search  # optuna is needed by nothing else

    flown = [(pairs[0], fly(pairs[0]))]
    tell(1)
    dearest = math.log(EFFORT_ROOM * most_effort(flown))
    for base in pairs:

        def flown_at(point: Mapping[str, float], base: Gains = base) -> Judged:
            gains = _at(base, point)
            score = fly(gains)
            flown.append((gains, score))
            tell(len(flown))
            return score.objectives, {"lost": score.lost, "effort": math.log(max(1.0, score.effort)) - dearest}

        search(flown_at, space_of(base), len(OBJECTIVES), evaluations, seed)
    return flown


def most_effort(flown: Flown) -> float:
    """Return the effort that the answer may ask for: that of the first, the present gains, or the circle's own."""
    return max(1.0, flown[0][1].effort)


def _best(flown: Flown, fly: Callable[[Gains], Score]) -> Gains:
    """Return the candidate of the Pareto set that the preference likes best, by a second round of the likeliest."""
    limit = most_effort(flown)
    liked = sorted(pareto(flown), key=lambda one: one[1].value(limit))[:FINALISTS]
    again = [(fly(gains).value(limit), n) for n, (gains, _) in enumerate(liked)]
    return liked[min(again)[1]][0]


def space_of(gains: Gains) -> Space:
    """Return what is searched, `law.option` or `estimator.option`. ValueError, in words, where that is nothing."""
    kinds = (("law", gains.law), ("estimator", gains.estimator))
    space = {f"{kind}.{option}": at for kind, name in kinds for option, at in SPACES.get(name, {}).items()}
    if not space:
        raise ValueError(f"nothing to tune in {gains.pair}")
    return space


def _at(base: Gains, point: Mapping[str, float]) -> Gains:
    """Return the gains at a point of the search, to three digits: they are to be read and written by people."""
    found: dict[str, dict[str, float]] = {"law": {}, "estimator": {}}
    for axis, (least, greatest) in space_of(base).items():
        kind, option = axis.split(".")
        found[kind][option] = min(max(float(f"{point[axis]:.3g}"), least), greatest)
    law = {name: value for name, value in base.law_options.items() if name != "k" or "kappa" not in found["law"]}
    return replace(
        base,
        law_options={**law, **found["law"]},
        estimator_options={**base.estimator_options, **found["estimator"]},
    )


def pareto(flown: Flown) -> list[tuple[Gains, Score]]:
    """Return the candidates that no other beats in all four objectives and in runs lost, by rising effort.

    Only those that lose no more runs than the first, the present gains, count: a vehicle that flies away turns little.
    """
    kept = [one for one in flown if one[1].lost <= flown[0][1].lost]
    wishes = np.array([(*score.objectives, score.lost) for _, score in kept])
    front: dict[Score, tuple[Gains, Score]] = {}
    for one, wish in zip(kept, wishes, strict=True):
        beaten = (wishes <= wish).all(axis=1) & (wishes < wish).any(axis=1)
        if not beaten.any():
            front.setdefault(one[1], one)
    return sorted(front.values(), key=lambda pair: (pair[1].effort, pair[1].rms_worst_m))
