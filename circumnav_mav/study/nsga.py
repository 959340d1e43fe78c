"""The one door to optuna: NSGA-II over positive numbers, several wishes and limits at once, the same for a seed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np
import optuna
from scipy.stats import qmc

from circumnav_mav.study.tune_spaces import Space

GENERATION = 16

Judged = tuple[tuple[float, ...], Mapping[str, float]]
"""What is to be small, and by how much each limit is passed (0 or less: it holds)."""


def search(
    judge: Callable[[Mapping[str, float]], Judged], space: Space, wishes: int, evaluations: int, seed: int
) -> None:
    """Have `judge` judge so many points of the space, in logarithms of its axes, by so many wishes.

    The first generation is spread evenly (a Latin hypercube), NSGA-II makes the others. A point that passes a limit
    gives way to any that does so less.
    """
    size = min(GENERATION, evaluations)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # Its defaults, swapped genes and mutants drawn anew from the whole range, are a random search in few dimensions.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.NSGAIISampler(
            population_size=size,
            crossover=optuna.samplers.nsgaii.SBXCrossover(),
            mutation=optuna.samplers.nsgaii.PolynomialMutation(),
            seed=seed,
        )
    study = optuna.create_study(directions=["minimize"] * wishes, sampler=sampler)
    for row in qmc.LatinHypercube(len(space), rng=np.random.default_rng(seed)).random(size):
        shares = zip(space.items(), row, strict=True)
        study.enqueue_trial({name: low * (high / low) ** float(share) for (name, (low, high)), share in shares})
    for _ in range(evaluations):
        trial = study.ask()
        point = {name: trial.suggest_float(name, *limits, log=True) for name, limits in space.items()}
        values, limits_passed = judge(point)
        for name, excess in limits_passed.items():
            trial.set_constraint(name, excess)
        study.tell(trial, values)
