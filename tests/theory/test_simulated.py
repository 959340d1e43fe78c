"""What the theory promises, flown: recurrence times, drift, the unstable inner orbit, the orbit's shift in wind."""

import math
from math import cos, pi, sin, tau

import numpy as np
import pytest

from circumnav_mav.guidance import feasibility as theory
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import paper_core, paper_run, setwise, setwise_figure
from circumnav_mav.study.noise import normals

LAW = LAWS["hashemi2013"].turn_rate


def plain(kappa, state, steps, hold_s, noise=None, wind=(0.0, 0.0), r_a=10.0):
    """Fly the plain core and return (x, y, psi) and r at every step."""
    one = paper_run.case("hashemi2013", {"kappa": kappa}, paper_run.Plant(r_a_m=r_a))
    rows, u = [], 0.0
    for n in range(steps):
        here = state
        nu = 0.0 if noise is None else float(noise[n])
        state, r, _, u = paper_core.plain_step(LAW, one.parameters, state, nu, u, (1.0, hold_s, *wind, r_a))
        rows.append((*here, r))
    return np.array(rows)


@pytest.mark.parametrize("kappa", [2.3, 3.0, 5.0, 12.0])
@pytest.mark.parametrize("sigma", [0.0, 0.35, 1.0])
def test_mean_recurrence_times_stay_below_the_bound(kappa, sigma):
    for eps_share, start in ((0.3, (30.0, 2.0)), (0.7, (18.0, 5.5)), (0.7, (6.0, 0.4))):
        trial = setwise.Trial(kappa, sigma, eps_share, duration_s=500.0, hold_s=0.05)
        if trial.target.contains(*start):
            continue
        visits = setwise.try_out(trial, [start] * 24, seed=4).visits
        bound = theory.recurrence_bound_s(*start, trial.r_a_m, kappa, trial.V_m_s, trial.target.eps)
        assert np.all(np.isfinite(visits["hit_s"]))
        assert visits["hit_s"].mean() <= bound


@pytest.mark.parametrize("kappa", [1.5, 5.0])
def test_the_mean_of_the_lyapunov_function_drifts_as_computed(kappa):
    """One short step of the SDE from many states, each noise flown with both signs so that its first order cancels."""
    rng = np.random.default_rng(8)
    hold_s, sigma, r_a = 1e-4, 0.4, 10.0
    for r, theta in zip(rng.uniform(0.8, 40.0, 60), rng.uniform(0.4, tau - 0.4, 60), strict=True):
        if abs(r - theory.inner_radius(r_a, kappa)) < 0.05:
            continue
        start = (-r, 0.0, theta)
        changes = []
        for nu in rng.normal(0.0, sigma / math.sqrt(hold_s), 20):
            for signed in (nu, -nu):
                [_, (x, y, psi, after)] = plain(kappa, start, 2, hold_s, [signed, 0.0])
                bearing = (pi - math.atan2(y, x) + psi) % tau
                changes.append(
                    theory.lyapunov(after, bearing, r_a, kappa, 1.0) - theory.lyapunov(r, theta, r_a, kappa, 1.0)
                )
        assert np.mean(changes) / hold_s == pytest.approx(theory.lyapunov_drift(r, theta, r_a, kappa), abs=0.01)


def test_the_inner_orbit_is_held_only_until_it_is_touched():
    r_i, _ = theory.inner_orbits(10.0, 10.0)
    still = plain(10.0, (-r_i, 0.0, 1.5 * pi), 200, 0.01)
    assert np.ptp(still[:, 3]) < 1e-6
    touched = plain(10.0, (-r_i, 0.0, 1.5 * pi + 1e-3), 6000, 0.02)
    assert touched[-1000:, 3] == pytest.approx(10.0, abs=0.01)


def fitted_centre(rows):
    """Return the centre of the circle fitted over angle: the first harmonic of r, each angle weighing the same."""
    angle = np.arctan2(rows[:, 1], rows[:, 0])
    bins = ((angle % tau) / tau * 180).astype(int)
    r = np.array([rows[bins == b, 3].mean() for b in range(180)])
    mid = (np.arange(180) + 0.5) * tau / 180
    return 2 * np.mean(r * np.cos(mid)), 2 * np.mean(r * np.sin(mid))


@pytest.mark.parametrize("kappa", [1.0, 1.5, 2.5, 5.0])
@pytest.mark.parametrize("towards", [pi / 4, 2.5])
def test_the_orbit_shifts_in_wind_as_predicted(kappa, towards):
    """First order in W / V: at 1 % the prediction must hold to 2 % of the shift, in size and direction."""
    wind = 0.01
    rows = plain(kappa, (10.0, 0.0, -pi / 2), 20_000, 0.02, wind=(wind * cos(towards), wind * sin(towards)))
    predicted = theory.orbit_shift(10.0, kappa, wind)
    assert fitted_centre(rows[-6283:]) == pytest.approx(predicted.centre(towards), abs=0.02 * predicted.size_m + 1e-4)


def test_the_prediction_is_straight_downwind_for_the_least_gain_and_to_the_left_for_a_large_one():
    assert theory.orbit_shift(10.0, 1.0, 0.25).centre(pi / 4) == pytest.approx((5 * cos(pi / 4), 5 * sin(pi / 4)))
    assert theory.orbit_shift(10.0, 1e3, 0.25).from_wind == pytest.approx(pi / 2, abs=2e-3)


def test_visits_are_counted_as_a_plain_count_does():
    trial = setwise.Trial(5.0, 0.5, duration_s=120.0, hold_s=0.05)
    starts = [(25.0, 1.0), (0.8, 4.5), (10.0, 1.6)]
    outcome = setwise.try_out(trial, starts, seed=6)
    steps, squares, returns = 2400, np.zeros(2400), 0
    for run, (r0, theta0) in enumerate(starts):
        noise = 0.5 / math.sqrt(0.05) * normals(6, 0, run, 1, steps)[0]
        rows = plain(5.0, (-r0, 0.0, theta0), steps, 0.05, noise)
        bearing = pi - np.arctan2(rows[:, 1], rows[:, 0]) + rows[:, 2]
        inside = np.array([trial.target.contains(r, t) for r, t in zip(rows[:, 3], bearing, strict=True)])
        gap = np.maximum(np.maximum(trial.target.inside_m - rows[:, 3], rows[:, 3] - trial.target.outside_m), 0.0)
        squares += gap**2
        hit = int(np.argmax(inside))
        lengths = np.diff(np.flatnonzero(np.diff(inside[hit:].astype(int), prepend=-1, append=-1)))
        stays, away = lengths[0::2], lengths[1::2]
        kept = stays[:-1] if inside[-1] else stays
        total_in, total_out = stays.sum(), away.sum()
        gone = away if inside[-1] else away[:-1]
        returns += len(gone)
        row = outcome.visits[run]
        assert row["hit_s"] == pytest.approx(hit * 0.05)
        assert row["inside"] == pytest.approx(inside[1200:].mean())
        assert row["exits"] == len(kept)
        assert row["returns"] == len(gone)
        assert row["in_s"] == pytest.approx(0.05 * total_in)
        assert row["out_s"] == pytest.approx(0.05 * total_out)
        assert row["longest_s"] == pytest.approx(0.05 * away.max())
        assert row["d2"] == pytest.approx((gap[1200:] ** 2).mean(), rel=1e-6)
        first = int(np.argmax(gap == 0.0))
        assert row["furthest_m"] == pytest.approx(gap[first:].max(), rel=1e-6)
    assert outcome.d2 == pytest.approx(squares / 3, rel=1e-6, abs=1e-9)
    assert outcome.lengths.sum() == returns


@pytest.mark.parametrize(("true_s", "runs"), [(20.0, 200), (900.0, 200)])
def test_mean_lengths_are_not_cut_short_by_the_end_of_the_run(true_s, runs):
    """Stays drawn from an exponential law whose mean is known, longer than the runs too."""
    rng, rows = np.random.default_rng(7), np.zeros(runs, setwise.VISITS)
    for row in rows:
        left = 350.0
        while (stay := rng.exponential(true_s)) < left:
            row["in_s"], row["exits"], left = row["in_s"] + stay, row["exits"] + 1, left - stay
        row["in_s"] += left
    outcome = setwise.Outcome(setwise.Trial(5.0, 0.5), rows, np.zeros(1), np.zeros(1))
    length_s, bound = setwise.mean_length(outcome, "in_s", "exits")
    assert not bound
    assert length_s == pytest.approx(true_s, rel=4.0 / math.sqrt(rows["exits"].sum()))


def test_a_mean_length_of_few_ends_is_told_as_a_bound():
    rows = np.zeros(2, setwise.VISITS)
    rows["in_s"], rows["exits"] = 300.0, (2, 1)
    outcome = setwise.Outcome(setwise.Trial(5.0, 0.5), rows, np.zeros(1), np.zeros(1))
    assert setwise.mean_length(outcome, "in_s", "exits") == (60.0, True)
    assert "> 60.0" in setwise_figure.table([outcome], 2, 1)[1]
