"""The equations of docs/guidance_law.md and docs/estimation.md, taken again from the code or from plain geometry."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from circumnav_mav.guidance.estimators import direct
from circumnav_mav.guidance.kernel import Estimate, EstimatorContext, LawContext, Memory, Moved, Reading
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.tangent import run_in

V, R_A, LIMIT, KAPPA = 15.0, 80.0, 0.458, 3.0
K = KAPPA / R_A


def law_of(name, **options):
    law = LAWS[name]
    par = law.parameters({**law.options, **options}, LawContext(R_A, V, LIMIT, 0.0))
    return lambda r, r_dot: law.turn_rate(Estimate(r, r_dot, V), par)


def characteristic(name, **options):
    """(a, b) of e'' + a e' + b e = 0 at the circle, by differences of the law on the polar form."""
    u = law_of(name, **options)

    def rates(r, theta):
        r_dot = -V * math.cos(theta)
        return np.array([r_dot, V * math.sin(theta) / r + u(r, r_dot)])

    h = 1e-5
    at = (R_A, 0.5 * math.pi)
    assert rates(*at) == pytest.approx([0.0, 0.0], abs=1e-9), "the circle is an equilibrium"
    by_r = (rates(at[0] + h, at[1]) - rates(at[0] - h, at[1])) / (2 * h)
    by_theta = (rates(at[0], at[1] + h) - rates(at[0], at[1] - h)) / (2 * h)
    j = np.array([by_r, by_theta]).T
    return -np.trace(j), np.linalg.det(j)


@pytest.mark.parametrize("name", ["hashemi2013", "hashemi2013_outer", "cao2013_smooth"])
def test_the_paper_s_law_at_its_circle(name):
    assert characteristic(name, kappa=KAPPA) == pytest.approx((K * V, (K * V) ** 2), rel=1e-4)


def test_the_pd_law_at_its_circle():
    w = KAPPA / (2.0 * 0.7) * V / R_A
    assert characteristic("pd_bias", kappa=KAPPA, damping=0.7) == pytest.approx((2.0 * 0.7 * w, w * w), rel=1e-4)


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False)])
def test_the_lag_that_the_paper_s_law_bears(share, stable):
    """T s^3 + s^2 + (k V + T (V / r_a)^2) s + (k V)^2: stable for T k V < 1 / (1 - 1 / kappa^2)."""
    T = share / (K * V * (1.0 - 1.0 / KAPPA**2))
    roots = np.roots([T, 1.0, K * V + T * (V / R_A) ** 2, (K * V) ** 2])
    assert (roots.real.max() < 0.0) == stable


def test_the_dead_time_that_the_paper_s_law_bears():
    """The loop gain (k V s + (k V)^2) / s^2 passes 1 at 1.27 k V with 51.8 degrees to spare: k V T < 0.71."""
    x = np.linspace(1.0, 2.0, 1_000_001)
    crossing = x[np.argmin(np.abs(np.sqrt(1.0 + x * x) / x**2 - 1.0))]
    assert crossing == pytest.approx(1.272, abs=1e-3)
    assert math.atan(crossing) / crossing == pytest.approx(0.711, abs=1e-3)


def test_on_the_tangents_the_error_of_the_saturated_law_moves_with_the_turn_alone():
    """sigma' = V (r_a / r) u on sigma = r_dot + V sqrt(1 - (r_a / r)^2) = 0, the target on the right."""
    for r in (90.0, 150.0, 400.0):
        theta = math.asin(R_A / r)

        def sigma(r, theta):
            return -V * math.cos(theta) + V * math.sqrt(1.0 - (R_A / r) ** 2)

        for u in (-0.4, 0.0, 0.3):
            h = 1e-4
            dr, dtheta = -V * math.cos(theta) * h, (V * math.sin(theta) / r + u) * h
            slope = (sigma(r + dr, theta + dtheta) - sigma(r - dr, theta - dtheta)) / (2 * h)
            assert slope == pytest.approx(V * R_A / r * u, abs=1e-4)


def test_where_the_saturated_law_circles():
    u = law_of("cao2013_saturated", turn_share=1.0, layer_share=0.1)
    r = R_A / math.sqrt(1.0 - (0.1 * V / (R_A * LIMIT)) ** 2)
    assert u(r, 0.0) == pytest.approx(-V / r, rel=2e-3)


def test_the_turn_that_the_sliding_law_takes_at_the_knee():
    """On r_dot = -chi, by differences of S = r_dot + chi along the motion: the turn that keeps S at 0."""
    slope, chi = 2.0 * V / R_A, 0.8 * V
    r, theta, h = 1.4 * R_A, math.acos(0.8), 1e-5

    def rate(u):
        turned = theta + (V * math.sin(theta) / r + u) * h
        return (-V * math.cos(turned) + slope * (-V * math.cos(theta)) * h + chi) / h

    needed = -rate(0.0) / (rate(1.0) - rate(0.0))
    assert needed == pytest.approx(2.24 * V / R_A, rel=0.01)


@pytest.mark.parametrize(("path", "rank"), [("circle", 5), ("straight", 3)])
def test_what_a_path_shows_of_place_drift_and_scale(path, rank):
    """The sensitivity of the ranges to (p, w, s): all five on the circle, three on a straight line past the target."""
    t = np.linspace(0.0, 60.0, 601)
    if path == "circle":
        vehicle = R_A * np.array([np.cos(V / R_A * t), -np.sin(V / R_A * t)])
    else:
        vehicle = np.array([-300.0 + V * t, np.full_like(t, 70.0)])
    moved = vehicle - vehicle[:, :1]

    def ranges(state):
        p = state[:2, None] - (1.0 + state[4]) * moved - state[2:4, None] * t
        return np.hypot(*p)

    truth = np.array([*-vehicle[:, 0], 0.0, 0.0, 0.0])
    scale = np.array([1.0, 1.0, 0.1, 0.1, 0.01])
    columns = [(ranges(truth + d) - ranges(truth - d)) / 2e-4 for d in np.diag(scale) * 1e-4]
    values = np.linalg.svd(np.array(columns).T, compute_uv=False)
    assert int(np.sum(values > 1e-4 * values[0])) == rank


def test_a_turn_tells_the_sides_apart():
    """r'' = V sin(theta) (V sin(theta) / r + u): the sides differ by 2 V |sin theta| u, nothing without a turn."""
    for u in (0.0, 0.2):
        r, theta, h = 200.0, 1.1, 1e-3
        r_ddot = []
        for side in (1.0, -1.0):
            bearing = side * theta
            turned = bearing + (V * math.sin(bearing) / r + u) * h
            r_ddot.append((-V * math.cos(turned) + V * math.cos(bearing)) / h)
        assert r_ddot[0] - r_ddot[1] == pytest.approx(2.0 * V * math.sin(theta) * u, abs=2e-2)


def test_what_the_direct_filter_knows_in_the_end():
    """Steady state of the continuous filter of r'' = white noise q with readings of variance R T: the closed form."""
    par = direct.parameters({"sigma_m": 1.0}, EstimatorContext(R_A, V, LIMIT))
    bank, mem, T = direct.begin(par), Memory(), 0.1
    for _ in range(600):
        mem = direct.observe(bank, mem, Moved(T, V * T, 0.0, -V / R_A * T, V, -V / R_A, math.nan), Reading(R_A), par)
    density = 1.0 * T
    assert math.sqrt(direct.covariance(bank)[0]) == pytest.approx((4 * par.q * density**3) ** (1 / 8), rel=0.1)
    assert math.sqrt(direct.covariance(bank)[2]) == pytest.approx((4 * par.q**3 * density) ** (1 / 8), rel=0.1)


def test_how_far_the_course_of_the_tangent_law_is_from_the_tangent():
    """The table of docs/guidance_law.md: the straight tangent makes acos(r_a / r) with the perpendicular."""
    text = (Path(__file__).parents[2] / "docs" / "guidance_law.md").read_text()
    reaches, shares = (
        [float(cell.split()[0]) for cell in re.search(rf"^\| {head} \|(.*)\|$", text, re.MULTILINE)[1].split("|")]
        for head in ("reach / r_a", "short of it by")
    )
    assert len(reaches) == len(shares) == 5
    for reach, share in zip(reaches, shares, strict=True):
        short = [1.0 - run_in(r, 1.0, reach)[0] / math.acos(1.0 / r) for r in (2.0 + 0.01 * i for i in range(10_000))]
        assert max(short) == short[0]  # most at r = 2 r_a
        assert 100.0 * max(short) == pytest.approx(share, rel=0.02, abs=0.005)
