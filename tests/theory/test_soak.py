"""Long searches for a counterexample to the theory, at random gains; SOAK_SHARE scales them, SOAK_SEED moves them."""

import math
import os

import numpy as np
import pytest

from circumnav_mav.guidance import feasibility as theory
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import paper_core, paper_run, setwise

SHARE, SEED = float(os.environ.get("SOAK_SHARE", "1")), int(os.environ.get("SOAK_SEED", "1"))


def times(count):
    return max(1, round(count * SHARE))


@pytest.mark.soak
def test_no_point_outside_the_corrected_set_drifts_above_minus_eps_at_random_gains():
    rng = np.random.default_rng(SEED)
    for _ in range(times(400)):
        r_a = math.exp(rng.uniform(-2, 7))
        kappa = math.sqrt(5) + math.exp(rng.uniform(-5, 4))
        eps = rng.uniform(0.001, 0.999) * theory.eps_max(r_a, kappa)
        k, r_s = kappa / r_a, theory.inner_radius(r_a, kappa)
        target = theory.recurrent_set(r_a, kappa, eps)
        radii = np.concatenate([np.geomspace(1e-4, 50, 800) * r_a, rng.normal(r_s, 0.1 / k, 400)])
        r, theta = np.meshgrid(radii[radii > 0], np.linspace(0, math.tau, 181), indexing="ij")
        side = np.where(r > r_s, 1.0, -1.0)
        drift = side * np.sin(theta) / r - k * np.sqrt(np.abs(1 - (np.minimum(r, r_s) / np.maximum(r, r_s)) ** 2))
        for i, j in np.argwhere(drift > -eps + 1e-9 / r_a):
            assert target.contains(float(r[i, j]), float(theta[i, j])), (SEED, r_a, kappa, eps, r[i, j], theta[i, j])


@pytest.mark.soak
def test_mean_recurrence_times_stay_below_the_bound_at_random_gains():
    rng = np.random.default_rng([SEED, 1])
    for _ in range(times(60)):
        trial = setwise.Trial(
            kappa=math.sqrt(5) + math.exp(rng.uniform(-3, 3)),
            sigma=rng.uniform(0.0, 1.0),
            eps_share=rng.uniform(0.2, 0.95),
            duration_s=1500.0,
            hold_s=0.05,
        )
        start = (float(rng.uniform(0.5, 40.0)), float(rng.uniform(0.0, math.tau)))
        if trial.target.contains(*start):
            continue
        visits = setwise.try_out(trial, [start] * 20, seed=SEED).visits
        bound = theory.recurrence_bound_s(*start, trial.r_a_m, trial.kappa, trial.V_m_s, trial.target.eps)
        # A run that has not come within its time counts with that time: too little, so that the test stays fair.
        assert np.minimum(visits["hit_s"], trial.duration_s).mean() <= bound, (SEED, trial, start)


@pytest.mark.soak
def test_the_batch_flies_what_the_plain_core_flies_in_random_plants():
    """A nanometre at the start shows how far rounding may carry the two apart."""
    rng, chaotic = np.random.default_rng([SEED, 2]), 0
    for _ in range(times(60)):
        plant = paper_run.Plant(
            V_m_s=math.exp(rng.uniform(-1, 3)),
            r_a_m=math.exp(rng.uniform(1, 5)),
            hold_s=rng.uniform(0.01, 1.0),
            sigma_m_s=0.0,
            x_m=float(rng.uniform(-80, -5)),
            y_m=float(rng.uniform(-80, 80)),
            heading_rad=float(rng.uniform(-7, 7)),
        )
        plant = paper_run.Plant(
            **{name: getattr(plant, name) for name in plant.__slots__}
            | {"duration_s": 40 * plant.hold_s, "wind_x_m_s": 0.3 * plant.V_m_s * float(rng.uniform(-1, 1))}
        )
        one = paper_run.case("hashemi2013", {"kappa": 1.0 + math.exp(rng.uniform(-4, 3))}, plant)
        noise = rng.normal(0.0, 0.3 * plant.V_m_s, 40)
        expected = flown_plainly(one, noise)
        changed = max(abs(flown_plainly(one, noise, by_m) - expected) for by_m in (-1e-9, 1e-9))
        if changed > 1e-3 * expected:  # a gain of 20 held for half a second: chaos, in which rounding decides
            chaotic += 1
            continue
        start = np.array([[plant.x_m], [plant.y_m], [math.cos(plant.heading_rad)], [math.sin(plant.heading_rad)]])
        [row] = paper_run.fly_in(one, start, noise[None, :])
        assert row["mse_all"] == pytest.approx(expected, rel=1e-9, abs=changed), (SEED, one)
    assert chaotic <= max(1, 0.2 * times(60)), (SEED, chaotic)


def flown_plainly(one, noise, moved_m=0.0):
    """Return the mean square orbit error [m^2] of a case flown by the plain core, its start moved to the east."""
    plant, errors = one.plant, []
    state, u = (plant.x_m + moved_m, plant.y_m, plant.heading_rad), 0.0
    for nu in noise:
        state, r, _, u = paper_core.plain_step(
            LAWS["hashemi2013"].turn_rate, one.parameters, state, float(nu), u, plant.kernel
        )
        errors.append(r - plant.r_a_m)
    return float(np.mean(np.square(errors)))
