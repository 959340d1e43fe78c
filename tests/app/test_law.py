"""The paper's law against its own closed forms and geometry."""

from __future__ import annotations

import math
import random

import pytest

from circumnav_mav.config_file import parse
from circumnav_mav.guidance.kernel import Estimate, LawContext, mirror
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import LAW, Parameters, parameters, turn_rate

CONTEXT = LawContext(r_a=50.0, V=5.0, turn_rate_limit=0.8, turn_lag_s=0.45)


def u(r: float, theta: float, kappa: float, V: float = 5.0, r_a: float = 50.0) -> float:
    par = parameters({"kappa": kappa}, LawContext(r_a, V, 0.8, 0.45))
    return turn_rate(Estimate(r=r, r_dot=-V * math.cos(theta), V=V), par)


@pytest.mark.parametrize("kappa", [1.0, 1.2, 3.0, 8.0])
@pytest.mark.parametrize("r_a", [5.0, 50.0, 400.0])
def test_the_orbit_is_an_equilibrium_turned_clockwise(kappa, r_a):
    assert u(r_a, math.pi / 2, kappa, r_a=r_a) == pytest.approx(-5.0 / r_a, rel=1e-9)


def test_outside_the_vehicle_heading_for_the_tangent_of_r_s_flies_straight():
    """On the course whose bearing from the line of sight is asin(r_s / r), u is zero: the tangent of r_s."""
    par = parameters({"kappa": 3.0}, CONTEXT)
    for r in (60.0, 100.0, 1000.0):
        assert u(r, math.asin(par.r_s / r), 3.0) == pytest.approx(0.0, abs=1e-12)


def test_it_is_continuous_at_r_s():
    par = parameters({"kappa": 3.0}, CONTEXT)
    for theta in (0.2, 1.5, 4.0):
        inside, outside = u(par.r_s * (1 - 1e-12), theta, 3.0), u(par.r_s * (1 + 1e-12), theta, 3.0)
        assert inside == pytest.approx(outside, abs=1e-5)


def test_it_never_asks_for_more_than_2_k_v():
    draw = random.Random(5)
    for _ in range(20_000):
        kappa, r, theta = draw.uniform(1, 10), draw.uniform(1e-6, 500), draw.uniform(0, 2 * math.pi)
        assert abs(u(r, theta, kappa)) <= 2 * kappa / 50.0 * 5.0 + 1e-12


def test_small_gain_means_r_s_zero_and_no_division_by_it():
    assert parameters({"kappa": 1.0 - 1e-10}, CONTEXT) == Parameters(k=0.02, r_s=0.0)
    assert math.isfinite(u(1e-3, 1.0, 1.0))


def test_k_is_the_other_spelling_of_kappa():
    assert parameters({"k": 0.06}, CONTEXT) == pytest.approx(parameters({"kappa": 3.0}, CONTEXT))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kappa": 0.99}, "no orbit exists below 1"),
        ({"k": 0.0199}, "no orbit exists below 1"),
        ({"kappa": math.inf}, "finite"),
        ({"kappa": 3.0, "k": 0.06}, "not both"),
    ],
)
def test_gains_without_an_orbit_are_refused_in_words(options, words):
    with pytest.raises(ValueError, match=words):
        parameters(options, CONTEXT)


def test_a_mirrored_estimate_keeps_range_and_rate():
    est = Estimate(r=60.0, r_dot=-2.0, V=5.0, u=0.1, theta=1.0, psi=0.5, px=3.0, py=4.0, wx=1.0, wy=2.0)
    assert mirror(mirror(est)) == est
    assert LAW.turn_rate(mirror(est), parameters({}, CONTEXT)) == LAW.turn_rate(est, parameters({}, CONTEXT))


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_every_law_turns_towards_the_clockwise_orbit(law):
    """Whatever a law reads: too far and opening, it turns tighter than the orbit; too near and closing, less."""
    par = law.parameters(dict(law.options), CONTEXT)
    for r, r_dot, side in ((55.0, 1.5, -1.0), (45.0, -1.5, +1.0)):
        theta = math.acos(-r_dot / 5.0)
        # Heading north; the target lies to the right, theta away from the heading.
        px, py = r * math.sin(theta), r * math.cos(theta)
        est = Estimate(r, r_dot, 5.0, -0.1, theta, math.pi / 2, px, py, 0.0, 0.0)
        assert side * (law.turn_rate(est, par) + 0.1) > 0.0


PLANE = """
vehicle: {class: px4_fixed_wing}
orbit: {radius_m: 80, speed_m_s: 12, r_min_m: %s}
limits: {turn_rate_rad_s: 0.4, turn_accel_rad_s2: 5}
law: {name: tangent}
estimator: {name: drift}
"""


def least_range_m(r_min_m: str, r_m: float, course: float) -> float:
    """Return how near the tangent law of a configuration comes in still air, every state known, no barrier."""
    config, step_s = parse(PLANE % r_min_m), 0.02
    par = LAWS["tangent"].parameters(config.law.options, config.law_context())
    x, y, psi, turn, speed, least = -r_m, 0.0, course, 0.0, config.orbit.speed_m_s, r_m
    for _ in range(round(30.0 / step_s)):
        r = math.hypot(x, y)
        est = Estimate(r=r, V=speed, u=turn, psi=psi, px=-x, py=-y, wx=0.0, wy=0.0)
        turn += (LAWS["tangent"].turn_rate(est, par) - turn) * step_s / par.lag
        psi += turn * step_s
        x, y, least = x + speed * math.cos(psi) * step_s, y + speed * math.sin(psi) * step_s, min(least, r)
    return least


def test_the_entry_is_chosen_so_that_the_configured_r_min_is_kept():
    """From 120 m a turn by the shorter side leads to 70 m: enough for the law alone (0.8 r_a), not for r_min 72 m."""
    courses = [0.25 * k for k in range(-12, 13)]
    assert min(least_range_m("null", 120.0, course) for course in courses) == pytest.approx(70.0, abs=0.5)
    assert min(least_range_m("72", 120.0, course) for course in courses) > 72.0
