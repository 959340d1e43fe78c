"""Does the orbit's neighbourhood hold what it caught? Evidence on the paper's open question, by simulation of its SDE.

The paper shows recurrence to U_k,eps and leaves set-wise stability open. Here the SDE (me-sde) is flown in short holds,
and each run tells when it first reached U, how long it then stayed in and out at a time, and how far out it went.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from circumnav_mav.guidance import feasibility
from circumnav_mav.guidance.feasibility import RecurrentSet
from circumnav_mav.guidance.kernel import Estimate
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import paper_core as core
from circumnav_mav.study import paper_run
from circumnav_mav.study.noise import generator, normals
from circumnav_mav.study.paper import LAW as PAPER_LAW
from circumnav_mav.study.paper_core import LAW, advance
from circumnav_mav.study.paper_run import Plant, Table

VISITS = np.dtype(
    [
        ("hit_s", np.float64),  # first time in U; infinite if never
        ("inside", np.float64),  # share of the second half of the run spent in U
        ("in_s", np.float64),  # time in U since it was first reached, also of a stay that the end of the run cut off
        ("exits", np.int64),  # stays in U that ended
        ("out_s", np.float64),  # time out of U since it was first reached, also of an excursion that was cut off
        ("returns", np.int64),  # excursions that ended
        ("longest_s", np.float64),  # longest excursion, also one that had not ended
        ("d2", np.float64),  # mean squared distance to U's annulus over the second half, m^2
        ("furthest_m", np.float64),  # greatest distance to the annulus once it had been reached
    ]
)

BIN_S, BINS = 0.25, 1200
"""How lengths of excursions are counted; the last bin holds all longer ones."""

FEW = 10
"""Fewer ends of stays than this tell no mean length."""


def visit(
    par: Any,
    plant: tuple[float, float, float, float, float],
    start: core.Floats,  # x, y, cos psi, sin psi
    noise: core.Floats,  # (steps,), m/s
    edges: tuple[float, float, float],  # r_i-,eps, r_i+,eps, r_a,eps
    distances2: core.Floats,  # (steps,) in and out: d^2 is added
    lengths: core.Floats,  # in and out: completed excursions are counted, in bins of BIN_S
) -> tuple[float, float, float, int, float, int, float, float, float]:
    """Fly one run and return its VISITS row."""
    V, hold_s, wx, wy, _ = plant
    x, y, c, s = start[0], start[1], start[2], start[3]
    u, since, inside, caught = 0.0, 0, False, False
    hit, held, exits, returns, steps, half = -1, 0, 0, 0, len(noise), len(noise) // 2
    longest = late_in = late_d2 = furthest = 0.0
    for n in range(steps):
        r = math.sqrt(x * x + y * y)
        r_dot = (x * (V * c + wx) + y * (V * s + wy)) / r
        clockwise = x * s - y * c < 0.0  # sin(theta) > 0
        d = max(edges[1] - r, r - edges[2], 0.0)
        now = d == 0.0 or (r < edges[0] and not clockwise)
        if now and hit < 0:
            hit, since = n, n
        elif hit >= 0 and now != inside:
            if now:
                returns += 1
                lengths[min(int((n - since) * hold_s / BIN_S), len(lengths) - 1)] += 1.0
                longest = max(longest, float(n - since))
            else:
                exits += 1
            since = n
        inside = now
        held += 1 if now else 0
        caught = caught or d == 0.0
        if caught:
            furthest = max(furthest, d)
        if n >= half:
            late_in += 1.0 if now else 0.0
            late_d2 += d * d
        distances2[n] += d * d
        u = LAW(Estimate(r, r_dot + noise[n], V, u, math.nan, math.nan, -x, -y, wx, wy), par)
        x, y, c, s = advance(x, y, c, s, u, V, hold_s, wx, wy)
    if hit >= 0 and not inside:
        longest = max(longest, float(steps - since))
    late = max(1, steps - half)
    return (
        hit * hold_s if hit >= 0 else math.inf,
        late_in / late,
        held * hold_s,
        exits,
        (steps - hit - held) * hold_s if hit >= 0 else 0.0,
        returns,
        longest * hold_s,
        late_d2 / late,
        furthest,
    )


@dataclass(frozen=True, slots=True)
class Trial:
    """One gain and noise of the SDE, and the set that is watched."""

    kappa: float
    sigma: float  # of the SDE, m/sqrt(s)
    eps_share: float = 0.5  # of eps_max
    r_a_m: float = 10.0
    V_m_s: float = 1.0
    duration_s: float = 350.0
    hold_s: float = 0.02
    stream: int = 0

    @property
    def target(self) -> RecurrentSet:
        """The set U_k,eps. Raises ValueError where the theorem gives none."""
        eps = self.eps_share * (feasibility.eps_max(self.r_a_m, self.kappa) or 0.0)
        found = feasibility.recurrent_set(self.r_a_m, self.kappa, eps)
        if found is None:
            raise ValueError(f"kappa {self.kappa:g} has no recurrent set: it needs more than sqrt(5)")
        return found


@dataclass(frozen=True, slots=True)
class Outcome:
    trial: Trial
    visits: Table  # VISITS rows, one a run
    d2: core.Floats  # mean over the runs of the squared distance to the annulus, m^2, against time
    lengths: core.Floats  # completed excursions of all runs, counted in bins of BIN_S


def mean_length(outcome: Outcome, time: str, ends: str) -> tuple[float, bool]:
    """Return the mean length [s] of a stay ("in_s", "exits") or excursion ("out_s", "returns"), and if it is a bound.

    It is the time of all runs divided by the ends seen in them, so that stays which the end of a run cut off count
    too: the mean of completed ones would be short, and never longer than a run. Fewer than FEW ends tell no mean; then
    it is what the true one is likely above, namely the time divided by FEW (as if so many had been seen).
    """
    total_s, seen = float(outcome.visits[time].sum()), int(outcome.visits[ends].sum())
    return total_s / max(seen, FEW), seen < FEW


def start_at(r: float, theta: float) -> tuple[float, float, float, float]:
    """Return (x, y, cos psi, sin psi) of (r [m], theta [rad]), placed on the negative x axis where psi = theta."""
    return (-r, 0.0, math.cos(theta), math.sin(theta))


def try_out(trial: Trial, starts: Sequence[tuple[float, float]], seed: int) -> Outcome:
    """Fly one run from each (r [m], theta [rad]) and return what was seen."""
    plant = Plant(
        V_m_s=trial.V_m_s, r_a_m=trial.r_a_m, hold_s=trial.hold_s, duration_s=trial.duration_s, sigma_m_s=math.nan
    )
    one = paper_run.case(PAPER_LAW, {"kappa": trial.kappa}, plant)
    fly = core.program(visit, LAWS[PAPER_LAW].turn_rate)
    edges = (trial.target.core_m, trial.target.inside_m, trial.target.outside_m)
    rows, d2, lengths = np.empty(len(starts), VISITS), np.zeros(plant.steps), np.zeros(BINS)
    sigma = paper_run.sde_sigma(trial.sigma, trial.hold_s)
    for run, (r, theta) in enumerate(starts):
        noise = sigma * normals(seed, trial.stream, run, 1, plant.steps)[0]
        rows[run] = fly(one.parameters, plant.kernel, np.array(start_at(r, theta)), noise, edges, d2, lengths)
    return Outcome(trial, rows, d2 / len(starts), lengths)


def spread_starts(count: int, seed: int, r_max_m: float = 40.0) -> list[tuple[float, float]]:
    """Return starts (r [m], theta [rad]) uniform in radius and angle: the same for every trial."""
    rng = generator(seed, 0x5E7)
    return list(zip(rng.uniform(0.3, r_max_m, count).tolist(), rng.uniform(0.0, math.tau, count).tolist(), strict=True))


def study(trials: Sequence[Trial], runs: int, seed: int, workers: int = 2) -> list[Outcome]:
    """Return an outcome for each trial, from the same spread starts."""
    starts = spread_starts(runs, seed)
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda trial: try_out(trial, starts, seed), trials))


def recurrence_ratio(outcome: Outcome, starts: Sequence[tuple[float, float]]) -> float:
    """Return the mean of (time to reach U) / (the paper's bound from that start) over the starts outside U."""
    trial, shares = outcome.trial, []
    for (r, theta), row in zip(starts, outcome.visits, strict=True):
        bound = feasibility.recurrence_bound_s(r, theta, trial.r_a_m, trial.kappa, trial.V_m_s, trial.target.eps)
        if bound:
            shares.append(row["hit_s"] / bound)
    return float(np.mean(shares))
