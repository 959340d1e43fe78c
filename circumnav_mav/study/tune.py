"""`circumnav tune`: gains of law and estimator for one aircraft, found by flying it in the study's simulation.

Several things are wanted at once: little error in calm and in the worst wind, little effort, quick settling, none lost.
Differential evolution (scipy) minimises one score of them; every candidate that it flew is kept, and the Pareto front
of error against effort is drawn from them all. Candidates fly in the same noise; the verdict is given on fresh noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from circumnav_mav.config import Config
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.from_log import Seen
from circumnav_mav.study.scenarios import Scenario
from circumnav_mav.study.simulate import Pilot, fly_one

Progress = Callable[[int, int], None]

CONTROL_S = 0.05
"""The simulation holds a command for so long, or for the loop's own period where that is longer."""

WIND_SHARE = 0.2
"""The strongest wind, as a share of the speed, where none is given."""

BELIEVED_SPEED = 1.05
"""Believed over true speed in one of the situations."""

SPACES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "hashemi2013": {"kappa": (1.0, 20.0)},
    "tangent": {"reach_s": (0.5, 8.0), "gain_per_s": (0.2, 4.0)},
    "direct": {"accel_m_s2": (0.02, 20.0)},
    "polar": {"drift_share": (0.001, 0.3), "turn_share": (0.003, 0.5)},
    "drift": {"wander_share": (3e-4, 0.03), "gust_share": (1e-3, 0.1)},
}
"""What is searched of each law and estimator, in logarithms. Other options stay as the configuration has them."""

BEST_PAIR = ("tangent", "drift")
"""Tried beside the configured pair."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """What the search needs to know of the vehicle and its ranging, beyond the gains."""

    V_m_s: float
    r_a_m: float
    turn_rate_limit_rad_s: float
    lag_s: float  # of the turn rate
    sigma_r_m: float
    range_rate_hz: float
    latency_s: float
    wind_m_s: float  # the strongest to be flown in, or the speed of a target that moves: to the guidance they are one
    control_s: float

    @staticmethod
    def of(config: Config, wind_m_s: float | None = None, range_rate_hz: float = 10.0) -> Aircraft:
        """Return the aircraft of a configuration; no wind given: WIND_SHARE of its speed. ValueError in words."""
        context = config.law_context()
        wind_m_s = WIND_SHARE * context.V if wind_m_s is None else wind_m_s
        if not 0.0 <= wind_m_s < context.V:
            raise ValueError(f"the wind must be 0 or more and below the speed of {context.V:g} m/s, not {wind_m_s:g}")
        if not range_rate_hz > 0.0:
            raise ValueError(f"the ranges need a rate above 0 Hz, not {range_rate_hz:g}")
        return Aircraft(
            V_m_s=context.V,
            r_a_m=context.r_a,
            turn_rate_limit_rad_s=context.turn_rate_limit,
            lag_s=context.turn_lag_s,
            sigma_r_m=config.ranging.sigma_m,
            range_rate_hz=range_rate_hz,
            latency_s=config.ranging.latency_s,
            wind_m_s=wind_m_s,
            control_s=max(CONTROL_S, 1.0 / config.loop.rate_hz),
        )

    def as_seen(self, seen: Seen) -> Aircraft:
        """Return the aircraft with what a flight showed in place of what was assumed. Raises ValueError in words."""
        shown = {
            "sigma_r_m": seen.sigma_r_m,
            "range_rate_hz": seen.range_rate_hz,
            "lag_s": seen.lag_s,
            "wind_m_s": seen.wind_m_s,
        }
        if seen.wind_m_s is not None and seen.wind_m_s >= self.V_m_s:
            raise ValueError(f"the record shows a wind of {seen.wind_m_s:.3g} m/s, the vehicle flies {self.V_m_s:g}")
        return replace(self, **{name: value for name, value in shown.items() if value is not None})

    def scenarios(self) -> list[Scenario]:
        """Return calm air, half the wind with a wrong airspeed, and all of it.

        Long enough to come from far and fly three laps of tail. In calm air with everything known, the laziest gains
        look best, and the first wind or a radius of a few per cent too much would show them up.
        """
        lap_s, far = math.tau * self.r_a_m / self.V_m_s, 6.0 * self.r_a_m
        entry_s = far / (self.V_m_s - self.wind_m_s)
        calm = Scenario(
            name="R_tune",
            V_m_s=self.V_m_s,
            r_a_m=self.r_a_m,
            duration_s=2.0 * max(3.0 * lap_s, entry_s),
            control_s=self.control_s,
            range_every=max(1, round(1.0 / (self.range_rate_hz * self.control_s))),
            sigma_r_m=self.sigma_r_m,
            lag_s=self.lag_s,
            limit_rad_s=self.turn_rate_limit_rad_s,
            start_m=(1.5 * self.r_a_m, far),
            latency_steps=round(self.latency_s / self.control_s),
        )
        half = replace(calm, wind_m_s=0.5 * self.wind_m_s, believed_speed=BELIEVED_SPEED)
        return [calm, half, replace(calm, wind_m_s=self.wind_m_s)]


@dataclass(frozen=True)
class Gains(Pilot):
    """A law and an estimator with all their options, made for an aircraft just as the flying app makes them."""

    aircraft: Aircraft | None = None

    def parameters(self, scenario: Scenario) -> tuple[Any, Any]:
        """Return what the kernels of estimator and law take."""
        assert self.aircraft is not None
        a = self.aircraft
        est = EstimatorContext(a.r_a_m, a.V_m_s, a.turn_rate_limit_rad_s)
        law = LawContext(a.r_a_m, a.V_m_s, a.turn_rate_limit_rad_s, a.lag_s)
        return (
            ESTIMATORS[self.estimator].parameters(
                {**ESTIMATORS[self.estimator].options, **self.estimator_options}, est
            ),
            LAWS[self.law].parameters({**LAWS[self.law].options, **self.law_options}, law),
        )

    @property
    def pair(self) -> str:
        return f"{self.law} on {self.estimator}"


class Score(NamedTuple):
    """How a candidate flew. Errors are over the tail; a run counts with at most 2 r_a."""

    rms_calm_m: float
    rms_worst_m: float  # in the worst of the three situations
    effort: float  # mean u^2 over (V / r_a)^2: the circle alone costs 1
    settle_s: float  # mean; a run that never settled counts with its whole length
    lost: float  # share of runs whose tail's rms is above r_a / 4

    def value(self, most_effort: float) -> float:
        """Return the number that the search makes small: relative changes of each wish, weighed against each other."""
        effort = math.log(max(1.0, self.effort))  # below the circle's own, nothing is saved: it is not flown
        error = 0.7 * math.log(self.rms_worst_m) + 0.3 * math.log(self.rms_calm_m)
        wish = error + 0.5 * math.log(1.0 + self.settle_s) + 0.2 * effort
        return wish + 20.0 * max(0.0, effort - math.log(most_effort)) + 10.0 * self.lost


@dataclass(frozen=True, slots=True)
class Tuned:
    aircraft: Aircraft
    present: Gains
    best: Gains
    flown: list[tuple[Gains, Score]]  # every candidate of the search, in order
    before: Score  # of the present gains, on fresh noise
    after: Score  # of the best ones, on the same
    fresh_runs: int


def judge(gains: Gains, runs: int, seed: int, pool: ThreadPoolExecutor) -> Score:
    """Fly `runs` runs in each of the aircraft's situations and return their score; the noise hangs on the seed only."""
    assert gains.aircraft is not None
    r_a, scenarios = gains.aircraft.r_a_m, gains.aircraft.scenarios()
    jobs = [(scenario, index) for scenario in scenarios for index in range(runs)]
    outcomes = list(pool.map(lambda job: fly_one(job[0], gains, seed, job[1])[0], jobs))

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


def gains_of(config: Config, aircraft: Aircraft) -> Gains:
    """Return the present gains of a configuration."""
    return Gains(config.law.name, config.estimator.name, config.law.options, config.estimator.options, aircraft)


def tune(
    config: Config,
    aircraft: Aircraft,
    *,
    seed: int = 1,
    evaluations: int = 96,
    runs: int = 12,
    fresh_runs: int = 100,
    keep_pair: bool = False,
    workers: int = 2,
    progress: Progress | None = None,
) -> Tuned:
    """Search the gains, and judge the best against the present ones on fresh noise.

    More effort than the present gains ask for is punished, unless they fall short of the circle's own. The same numbers
    for a seed, whatever the workers.
    """
    present = gains_of(config, aircraft)
    pairs = [(present.law, present.estimator)]
    if not keep_pair and BEST_PAIR not in pairs:
        pairs.append(BEST_PAIR)
    flown: list[tuple[Gains, Score]] = []
    with ThreadPoolExecutor(workers) as pool:
        fly_one(aircraft.scenarios()[0], present, seed, 0)  # compiles before the workers start
        most_effort = max(1.0, judge(present, runs, seed, pool).effort)
        total = _generations(evaluations) * _size(evaluations) * len(pairs)
        for law, estimator in pairs:
            own = (law, estimator) == (present.law, present.estimator)
            base = present if own else Gains(law, estimator, {}, {}, aircraft)
            fly_one(aircraft.scenarios()[0], base, seed, 0)

            def cost(point: Sequence[float], base: Gains = base) -> float:
                gains = _at(base, point)
                score = judge(gains, runs, seed, pool)
                flown.append((gains, score))
                if progress is not None:
                    progress(len(flown), total)
                return score.value(most_effort)

            _search(cost, base, evaluations, seed)
        best = min(flown, key=lambda one: one[1].value(most_effort))[0]
        fresh = [judge(gains, fresh_runs, seed + 1_000_003, pool) for gains in (present, best)]
    return Tuned(aircraft, present, best, flown, fresh[0], fresh[1], fresh_runs)


def _axes(gains: Gains) -> list[tuple[str, str, float, float]]:
    """Return (kind, option, least, greatest) of everything that is searched."""
    law, estimator = SPACES.get(gains.law, {}), SPACES.get(gains.estimator, {})
    return [("law", name, *limits) for name, limits in law.items()] + [
        ("estimator", name, *limits) for name, limits in estimator.items()
    ]


def _at(base: Gains, point: Sequence[float]) -> Gains:
    """Return the gains at a point of the search, to three digits: they are to be read and written by people."""
    found: dict[str, dict[str, float]] = {"law": {}, "estimator": {}}
    for (kind, name, least, greatest), value in zip(_axes(base), point, strict=True):
        found[kind][name] = float(f"{min(max(math.exp(value), least), greatest):.3g}")
    law = {name: value for name, value in base.law_options.items() if name != "k" or "kappa" not in found["law"]}
    return replace(
        base,
        law_options={**law, **found["law"]},
        estimator_options={**base.estimator_options, **found["estimator"]},
    )


def _size(evaluations: int) -> int:
    """Return how many candidates a generation has."""
    return min(16, evaluations)


def _generations(evaluations: int) -> int:
    return evaluations // _size(evaluations)


def _search(cost: Callable[[Sequence[float]], float], base: Gains, evaluations: int, seed: int) -> None:
    """Call `cost` for whole generations: the first is spread evenly, differential evolution makes the others."""
    axes = _axes(base)
    if not axes:
        raise ValueError(f"nothing to tune in {base.pair}")
    bounds = [(math.log(least), math.log(greatest)) for _, _, least, greatest in axes]
    size, generations = _size(evaluations), _generations(evaluations)
    spread = qmc.LatinHypercube(len(axes), rng=np.random.default_rng(seed)).random(size)
    first = qmc.scale(spread, *np.array(bounds).T)
    differential_evolution(
        cost,
        bounds,
        init=first,
        maxiter=generations - 1,
        polish=False,
        tol=0.0,
        atol=0.0,
        rng=np.random.default_rng(seed),
    )


def pareto(flown: Sequence[tuple[Gains, Score]]) -> list[tuple[Gains, Score]]:
    """Return the candidates that no other beats in both worst error and effort, by rising effort.

    Only those that lost the fewest runs count: a vehicle that flies away turns little.
    """
    fewest = min(score.lost for _, score in flown)
    front: list[tuple[Gains, Score]] = []
    for one in sorted(flown, key=lambda pair: (pair[1].effort, pair[1].rms_worst_m)):
        if one[1].lost == fewest and (not front or one[1].rms_worst_m < front[-1][1].rms_worst_m):
            front.append(one)
    return front
