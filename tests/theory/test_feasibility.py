"""The theory against closed forms, against the law itself, and against brute force over the whole plane."""

from math import cos, isclose, nan, pi, sin, sqrt, tau

import numpy as np
import pytest

from circumnav_mav.guidance import feasibility as theory
from circumnav_mav.guidance.kernel import Estimate
from circumnav_mav.guidance.laws.hashemi2013 import Parameters, inner_radius, turn_rate

GAINS = (2.3, 2.5, 3.0, 5.0, 8.0, 13.0, 20.0)
RADII = (0.7, 10.0, 250.0)


def u_of(r, theta, r_a, kappa, V):
    par = Parameters(kappa / r_a, inner_radius(r_a, kappa))
    return turn_rate(Estimate(r=r, r_dot=-V * cos(theta), V=V), par)


@pytest.mark.parametrize("r_a", RADII)
@pytest.mark.parametrize("kappa", (1.0, 1.5, *GAINS))
def test_the_orbit_wanted_is_an_equilibrium_of_the_law(r_a, kappa):
    assert isclose(u_of(r_a, pi / 2, r_a, kappa, 3.0), -3.0 / r_a, rel_tol=1e-9)


@pytest.mark.parametrize("r_a", RADII)
@pytest.mark.parametrize("kappa", GAINS)
def test_inner_orbits_are_equilibria_flown_the_wrong_way_round(r_a, kappa):
    for r in theory.inner_orbits(r_a, kappa):
        assert 0 < r < inner_radius(r_a, kappa)
        theta_dot = 3.0 * sin(1.5 * pi) / r + u_of(r, 1.5 * pi, r_a, kappa, 3.0)
        assert abs(theta_dot) * r_a / 3.0 < 1e-8


@pytest.mark.parametrize("kappa", (1.0, 1.2, 2.0, 2.236))
def test_no_inner_orbit_below_root_five(kappa):
    assert theory.inner_orbits(10.0, kappa) is None
    assert theory.eps_max(10.0, kappa) is None
    assert theory.recurrent_set(10.0, kappa, 1e-6) is None
    assert theory.recurrence_bound_s(30.0, 1.0, 10.0, kappa, 1.0, 1e-6) is None
    if kappa > 1.0:  # and g stays positive, by looking at it
        r_s = inner_radius(10.0, kappa)
        assert min(theory.inner_drift(r, 10.0, kappa) for r in np.linspace(1e-3, r_s, 20001)[:-1]) > 0


def test_the_values_computed_in_the_notes():
    edges = theory.inner_edges(10.0, 5.0, 0.05)
    assert edges == pytest.approx((2.293, 9.299), abs=5e-4)
    assert theory.inner_orbits(10.0, 5.0) == pytest.approx((2.045, 9.582), abs=5e-4)


@pytest.mark.parametrize("r_a", RADII)
@pytest.mark.parametrize("kappa", GAINS)
@pytest.mark.parametrize("share", (0.01, 0.3, 0.9, 0.999))
def test_edges_are_the_roots_of_the_corrected_quartic(r_a, kappa, share):
    eps = share * theory.eps_max(r_a, kappa)
    k, r_s = kappa / r_a, inner_radius(r_a, kappa)
    c = (r_s / k) ** 2
    roots = np.roots([1.0, 0.0, c * (eps**2 - k**2), 2 * eps * c, c])
    inside = sorted(z.real for z in roots if abs(z.imag) < 1e-6 * r_a and 0 < z.real < r_s)
    assert theory.inner_edges(r_a, kappa, eps) == pytest.approx(inside, rel=1e-5)
    low, high = theory.inner_orbits(r_a, kappa)
    assert low < theory.inner_edges(r_a, kappa, eps)[0] < theory.inner_edges(r_a, kappa, eps)[1] < high


@pytest.mark.parametrize("r_a", RADII)
@pytest.mark.parametrize("kappa", (1.0, 1.5, *GAINS))
def test_the_outer_edge_is_where_the_worst_drift_is_minus_eps(r_a, kappa):
    assert theory.outer_edge(r_a, kappa, 0.0) == pytest.approx(r_a)
    for eps in (0.1 * kappa / r_a, 0.9 * kappa / r_a):
        edge = theory.outer_edge(r_a, kappa, eps)
        assert theory.lyapunov_drift(edge, pi / 2, r_a, kappa) == pytest.approx(-eps, rel=1e-6)
    assert theory.outer_edge(r_a, kappa, kappa / r_a) is None


@pytest.mark.parametrize("r_a", RADII)
@pytest.mark.parametrize("kappa", GAINS)
def test_the_steepest_radius_is_where_a_fine_search_finds_the_least_drift(r_a, kappa):
    r_s = inner_radius(r_a, kappa)
    grid = np.linspace(1e-4 * r_s, r_s, 200_001)[:-1]
    least = 1 / grid - kappa / r_a / r_s * np.sqrt(r_s**2 - grid**2)
    best = theory.steepest_radius(r_a, kappa)
    assert best == pytest.approx(grid[np.argmin(least)], rel=2e-3)
    assert theory.inner_drift(best, r_a, kappa) <= least.min()
    assert theory.eps_max(r_a, kappa) == pytest.approx(min(-least.min(), 1 / r_a), rel=1e-6)


@pytest.mark.parametrize("kappa", GAINS)
@pytest.mark.parametrize("share", (0.02, 0.5, 0.98))
def test_no_point_outside_the_corrected_set_drifts_above_minus_eps(kappa, share):
    """The theorem itself, searched by brute force to 40 radii out; the drift is written anew from the law."""
    r_a = 10.0
    k, r_s = kappa / r_a, sqrt(r_a**2 - (r_a / kappa) ** 2)
    eps = share * theory.eps_max(r_a, kappa)
    target = theory.recurrent_set(r_a, kappa, eps)
    radii = np.concatenate([np.geomspace(1e-3, 400.0, 1500), np.linspace(0.9 * r_s, 1.1 * r_a, 1500)])
    r, theta = np.meshgrid(radii, np.linspace(0.0, tau, 361), indexing="ij")
    side = np.where(r > r_s, 1.0, -1.0)
    u = k * np.cos(theta) - side * k * np.sqrt(np.abs(1 - (np.minimum(r, r_s) / np.maximum(r, r_s)) ** 2))
    drift = side * (-k * np.cos(theta) + np.sin(theta) / r + u)
    bad = np.argwhere(drift > -eps + 1e-12)
    assert len(bad) > 0  # the set is not empty, so the search must find something to excuse
    for i, j in bad[:: max(1, len(bad) // 20_000)]:
        assert target.contains(float(r[i, j]), float(theta[i, j])), (r[i, j], theta[i, j], drift[i, j])


def test_the_set_as_printed_leaves_out_points_that_drift_upwards():
    """The slip: between r_i+ and r_s at theta = 3 pi/2 the drift is positive, so the annulus must hold every theta."""
    _low, high = theory.inner_orbits(10.0, 5.0)
    r = 0.5 * (high + inner_radius(10.0, 5.0))
    assert theory.lyapunov_drift(r, 1.5 * pi, 10.0, 5.0) > 0.02
    assert theory.recurrent_set(10.0, 5.0, 0.0).contains(r, 1.5 * pi)


@pytest.mark.parametrize("kappa", (1.5, 5.0))
def test_the_drift_is_the_rate_of_the_lyapunov_function_along_the_flow(kappa):
    rng = np.random.default_rng(3)
    V, r_a, dt = 2.0, 10.0, 1e-6
    for r, theta in zip(rng.uniform(0.5, 40, 300), rng.uniform(0.01, tau - 0.01, 300), strict=True):
        if abs(r - inner_radius(r_a, kappa)) < 1e-3:
            continue
        r_dot, theta_dot = -V * cos(theta), V * sin(theta) / r + u_of(r, theta, r_a, kappa, V)
        ahead = theory.lyapunov(r + r_dot * dt, theta + theta_dot * dt, r_a, kappa, V)
        back = theory.lyapunov(r - r_dot * dt, theta - theta_dot * dt, r_a, kappa, V)
        assert (ahead - back) / (2 * dt) == pytest.approx(theory.lyapunov_drift(r, theta, r_a, kappa), abs=1e-6)


def test_the_recurrence_bound_is_the_lyapunov_function_over_eps():
    eps = 0.05
    k, r_s = 0.5, sqrt(100 - 4)
    assert theory.recurrence_bound_s(30.0, 1.0, 10.0, 5.0, 2.0, eps) == pytest.approx(
        (k * (30 - r_s) + 1.0 + tau) / (2.0 * eps)
    )
    inside = (k * (r_s - 5.0) - 1.0 + tau) / (2.0 * eps)  # the sign of r - r_s goes with theta
    assert theory.recurrence_bound_s(5.0, 1.0, 10.0, 5.0, 2.0, eps) == pytest.approx(inside)
    assert theory.recurrence_bound_s(10.0, 4.0, 10.0, 5.0, 2.0, eps) == 0.0
    assert theory.recurrence_bound_s(30.0, 1.0, 10.0, 5.0, 2.0, 0.2) is None  # beyond eps_max = 0.1


def test_greatest_turn_rate_is_met_and_never_passed():
    r_a, kappa, V = 10.0, 3.0, 2.0
    asked = [abs(u_of(r, t, r_a, kappa, V)) for r in np.geomspace(1e-6, 1e7, 200) for t in np.linspace(0, tau, 73)]
    assert max(asked) <= theory.greatest_turn_rate(r_a, kappa, V)
    assert max(asked) == pytest.approx(theory.greatest_turn_rate(r_a, kappa, V), rel=1e-3)
    assert theory.least_turn_radius(r_a, kappa) * theory.greatest_turn_rate(r_a, kappa, V) == pytest.approx(V)
    assert theory.unsaturated_kappa(r_a, V, theory.greatest_turn_rate(r_a, kappa, V)) == pytest.approx(kappa)


def test_least_orbit_radius_balances_weight_and_lift():
    bank = 0.6
    radius = theory.least_orbit_radius(15.0, bank)
    assert 15.0**2 / radius / 9.80665 == pytest.approx(sin(bank) / cos(bank))
    assert theory.least_orbit_radius(15.0, bank, wind=5.0) == pytest.approx(radius * (20 / 15) ** 2)
    assert theory.lap_time_s(10.0, 2.0) == pytest.approx(10 * pi)


@pytest.mark.parametrize(("r_a", "kappa"), [(0.0, 2.0), (-1.0, 2.0), (nan, 2.0), (10.0, 0.99), (10.0, nan)])
def test_nonsense_is_refused_in_words(r_a, kappa):
    with pytest.raises(ValueError, match=r"radius|kappa"):
        theory.eps_max(r_a, kappa)


def loop_radius(number, first_order):
    """Return the spectral radius of the linearised loop, in units of k V, with a lag; an independent simulation."""
    steps = 400
    dt = number / steps if number else 1.0 / steps
    past = [0.0] * (0 if first_order else steps)
    rho, delta, flown, peak_early, peak_late = 1.0, 0.0, 0.0, 0.0, 0.0
    end = int(120 / dt)
    for n in range(end):
        asked = -delta - rho
        if first_order:
            flown += dt * (asked - flown) / number
        else:
            past.append(asked)
            flown = past.pop(0)
        delta += dt * flown
        rho += dt * delta
        if end // 3 < n < 2 * end // 3:
            peak_early = max(peak_early, abs(rho))
        elif n > 2 * end // 3:
            peak_late = max(peak_late, abs(rho))
    return peak_late / peak_early


def test_the_dead_time_that_the_loop_bears():
    assert loop_radius(0.97 * theory.LAG_UNSTABLE, False) < 1.0 < loop_radius(1.03 * theory.LAG_UNSTABLE, False)
    assert loop_radius(0.97, True) < 1.0 < loop_radius(1.03, True)


def test_the_hold_that_the_sampled_loop_bears():
    """The exact step of the linearised loop under a held control, by its eigenvalues."""
    for a, stable in ((0.99 * theory.HOLD_UNSTABLE, True), (1.01 * theory.HOLD_UNSTABLE, False)):
        step = np.array([[1 - a * a / 2, a - a * a / 2], [-a, 1 - a]])
        assert bool(np.max(np.abs(np.linalg.eigvals(step))) < 1.0) is stable
