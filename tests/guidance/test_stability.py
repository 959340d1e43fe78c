"""The stability argument of docs/guidance_law.md, taken again from the code: the law linearised at its circle."""

import math

import numpy as np
import pytest

from circumnav_mav.guidance.kernel import LawContext
from circumnav_mav.guidance.laws import tangent
from tests.guidance.test_laws import LIMIT, R_A, V, truth


def closed_loop(lag_believed, lag_true):
    """The Jacobian of (r, theta, u) at the circle, by differences of the law itself."""
    par = tangent.parameters({}, LawContext(R_A, V, LIMIT, lag_believed))

    def rate(state):
        r, theta, u = state
        command = tangent.turn_rate(truth(-r, 0.0, theta, u), par)  # target due east: the sight is along x
        return np.array([-V * math.cos(theta), V * math.sin(theta) / r + u, (command - u) / lag_true])

    at = np.array([R_A, 0.5 * math.pi, -V / R_A])
    return np.array([(rate(at + d) - rate(at - d)) / 2e-4 for d in np.eye(3) * 1e-4]).T


def test_the_poles_are_those_of_the_argument():
    poles = np.sort(np.linalg.eigvals(closed_loop(0.5, 0.5)).real)
    assert poles == pytest.approx([-2.0, -1.0, -1.0 / 1.5], rel=0.12)


@pytest.mark.parametrize(("lag_true", "stable"), [(1.0, True), (3.0, True), (5.8, True), (6.3, False), (12.0, False)])
def test_a_wrong_lag_is_borne_as_far_as_the_argument_says(lag_true, stable):
    """At 10 m/s on 60 m Routh says 5.91 s; without the turn of the sight, (T - tau) omega^2, it would say 5.5."""
    assert (np.linalg.eigvals(closed_loop(0.5, lag_true)).real.max() < 0.0) == stable


@pytest.mark.parametrize("lag_true", [0.5, 1.0, 3.0, 6.0])
def test_the_loop_with_a_wrong_lag_is_that_of_the_argument(lag_true):
    """T s^3 + (1 + (g + c) tau) s^2 + (g + c + g c tau + (T - tau) omega^2) s + g c, to 1 %."""
    g, c, tau, omega = 1.0, 1.0 / 1.5, 0.5, V / R_A
    told = [lag_true, 1.0 + (g + c) * tau, g + c + g * c * tau + (lag_true - tau) * omega**2, g * c]
    assert lag_true * np.poly(closed_loop(tau, lag_true)) == pytest.approx(told, rel=0.01)


@pytest.mark.parametrize(("W", "ratio"), [(0.25, 1.028), (1.0 / 3.0, 1.044), (0.5, 1.061)])
def test_the_least_effort_in_wind_is_what_the_page_says(W, ratio):
    """From the geometry of the air path alone: a point on the circle, its course, the heading that makes it."""
    phi = np.linspace(0.0, 2.0 * math.pi, 40001)
    course = phi - 0.5 * math.pi
    across = -W * np.sin(course)  # of a wind along x, to the left of the course
    psi = course + np.arcsin(-across)
    speed = np.sqrt(1.0 - across**2) + W * np.cos(course)
    time = np.diff(phi) * 2.0 / (speed[1:] + speed[:-1])  # r_a = V = 1
    u = np.diff(psi) / time
    assert np.sum(u * u * time) / np.sum(time) == pytest.approx(ratio, abs=6e-4)
