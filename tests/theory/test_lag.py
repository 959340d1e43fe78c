"""How much lag each law bears: the bound against flights of the study's plant, and what `check` says of it."""

import math
from collections import deque

import pytest

from circumnav_mav.check import findings
from circumnav_mav.config import Config
from circumnav_mav.guidance.feasibility import LAG_UNSTABLE, orbit_shift
from circumnav_mav.guidance.kernel import Estimate, LawContext
from circumnav_mav.guidance.lag import Loop, loop_of
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.plant import Plant, World, fly

V, R_A, LIMIT, TOLD = 15.0, 80.0, 0.458, 0.5
STEP_S, HAIR_M = 0.01, 0.008


def prepared(name):
    law = LAWS[name]
    par = law.parameters(law.options, LawContext(R_A, V, LIMIT, TOLD))
    return law, par, loop_of(law, par, R_A, V)


def swings(name, lag_s, dead_s):
    """Swing of the range [m] early and late in a flight that starts a hair off the circle, on exact estimates.

    A law with a layer ends in a weaving of a steady width, soon: wide is then as good as growing.
    """
    law, par, loop = prepared(name)
    r_e = V / loop.omega
    plant = Plant(V, STEP_S, lag_s, math.inf, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, math.inf)
    world = World(0.0, -(r_e + HAIR_M), 0.0, 0.5 * math.pi, -loop.omega, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    queue = deque([-loop.omega] * round(dead_s / STEP_S))
    errors = []
    for _ in range(int(25.0 * max(1.0, lag_s, 2.0 * dead_s) / STEP_S)):
        r = math.hypot(world.x, world.y)
        r_dot = V * (world.x * math.cos(world.psi) + world.y * math.sin(world.psi)) / r
        queue.append(law.turn_rate(Estimate(r, r_dot, V, world.u, 0, world.psi, -world.x, -world.y, 0, 0), par))
        world = fly(world, queue.popleft(), plant, 0.0, 0.0)
        errors.append(r)
    n = len(errors) // 6
    return tuple(max(part) - min(part) for part in (errors[n : 2 * n], errors[-n:]))


@pytest.mark.parametrize("name", LAWS)
def test_the_lag_that_a_law_bears(name):
    borne_s = prepared(name)[2].lag_s()
    early, late = swings(name, 0.85 * borne_s, 0.0)
    assert late < early
    early, late = swings(name, 1.2 * borne_s, 0.0)
    assert late > min(early, 10.0 * HAIR_M)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("lag_share", [0.0, 0.3])
def test_the_dead_time_that_a_law_bears_beside_a_lag(name, lag_share):
    loop = prepared(name)[2]
    lag_s = lag_share * loop.lag_s()
    borne_s = loop.dead_time_s(lag_s)
    early, late = swings(name, lag_s, 0.85 * borne_s)
    assert late < early
    early, late = swings(name, lag_s, 1.2 * borne_s)
    assert late > min(early, 10.0 * HAIR_M)


def test_the_bounds_are_the_closed_forms_where_there_are_some():
    k = 3.0 / R_A
    paper = prepared("hashemi2013")[2]
    assert paper.lag_s() == pytest.approx(1.0 / (k * V * (1.0 - 1.0 / 9.0)), rel=1e-3)
    assert k * V * paper.dead_time_s() >= LAG_UNSTABLE  # that of a large kappa is the least
    pd = LAWS["pd_bias"].parameters({}, LawContext(R_A, V, LIMIT, TOLD))
    assert prepared("pd_bias")[2].lag_s() == pytest.approx(pd.c1 / pd.c2, rel=1e-3)
    assert prepared("sliding_mode")[2].lag_s() == pytest.approx(R_A / (2.0 * V), rel=1e-3)  # 1 / slope
    assert prepared("hashemi2013")[2].dead_time_s(paper.lag_s()) == 0.0
    tangent = prepared("tangent")[2]
    assert tangent.lag_s() == pytest.approx(6.04, rel=0.01)  # Routh on the cubic of docs/guidance_law.md
    assert tangent.k_u == pytest.approx(-(1.0 + 1.0 / 1.5) * TOLD, rel=0.01)  # -(g + c) tau


@pytest.mark.parametrize(("told_s", "borne"), [(0.55, True), (0.65, False)])
def test_tangent_on_a_vehicle_without_a_lag_bears_no_dead_time_if_told_a_long_one(told_s, borne):
    """(g + V / reach) tau = 1 at tau = 0.6 s: g tau alone would say 1 s."""
    law = LAWS["tangent"]
    loop = loop_of(law, law.parameters(law.options, LawContext(R_A, V, LIMIT, told_s)), R_A, V)
    assert (loop.dead_time_s() > 0.0) is borne


def test_the_shift_in_wind_is_that_of_the_paper_s_law_and_is_flown_by_another():
    assert prepared("hashemi2013")[2].shift_m(0.3) == pytest.approx(orbit_shift(R_A, 3.0, 0.3 / V).size_m, rel=1e-3)
    law, par, loop = prepared("pd_bias")
    ranges = flown(law, par, 0.0, math.inf, 0.0, wind=0.3)
    assert 0.5 * (max(ranges) - min(ranges)) == pytest.approx(loop.shift_m(0.3), rel=0.05)


def flown(law, par, lag_s, accel, off_m, wind=0.0, step_s=0.04):
    """Return the ranges [m] of the last 100 s of 300, started so far off the circle, commands as the limiter slews."""
    plant = Plant(V, step_s, lag_s, math.inf, wind, 0.0, 0.0, 0.0, 1.0, 0.0, math.inf)
    world = World(0.0, -(R_A + off_m), 0.0, 0.5 * math.pi, -V / R_A, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    u, ranges = -V / R_A, []
    for _ in range(int(300.0 / step_s)):
        r = math.hypot(world.x, world.y)
        r_dot = (world.x * (V * math.cos(world.psi) + wind) + world.y * V * math.sin(world.psi)) / r
        wanted = law.turn_rate(Estimate(r, r_dot, V, world.u, 0, world.psi, -world.x, -world.y, wind, 0), par)
        u += min(max(wanted - u, -accel * step_s), accel * step_s)
        world = fly(world, u, plant, 0.0, 0.0)
        ranges.append(r)
    return ranges[int(200.0 / step_s) :]


@pytest.mark.parametrize(("accel", "weaves"), [(0.15, True), (2.0 * LIMIT / 0.7, False)])
def test_check_says_where_a_law_with_a_layer_weaves_for_want_of_turn_acceleration(accel, weaves):
    """The plane of the table, from 60 m off: at 0.15 rad/s^2 it ends in turns, with a swing in 0.7 s on the circle."""
    law = LAWS["sliding_mode"]
    par = law.parameters(law.options, LawContext(R_A, V, LIMIT, 0.2))
    ranges = flown(law, par, 0.2, accel, 60.0)
    assert (max(ranges) - min(ranges) > 5.0) is weaves
    sections = {"vehicle": {"class": "px4_fixed_wing"}, "orbit": {"radius_m": R_A, "speed_m_s": V}}
    sections |= {"limits": {"turn_rate_rad_s": LIMIT, "turn_accel_rad_s2": accel, "bank_deg": 40.0}}
    told = {f.topic: f for f in findings(Config.model_validate(sections | {"law": {"name": "sliding_mode"}}))}
    assert ("weave" in told) is weaves
    assert "circles at" in told["off"].text


def lag_of(law, **options):
    orbit, limits = {"radius_m": 80.0, "speed_m_s": 15.0}, {"bank_deg": 40.0, "turn_rate_rad_s": 0.46}
    estimator = {"name": "drift" if law == "tangent" else "direct"}
    sections = {"orbit": orbit, "limits": limits, "estimator": estimator, "law": {"name": law, **options}}
    return {f.topic: f for f in findings(Config.model_validate({"vehicle": {"class": "px4_fixed_wing"}, **sections}))}[
        "lag"
    ]


@pytest.mark.parametrize("name", LAWS)
def test_check_says_for_every_law_what_it_bears(name):
    assert lag_of(name).severity in ("info", "warning")


def test_check_names_the_gain_that_is_calm():
    assert lag_of("tangent").severity == lag_of("pd_bias").severity == "info"
    wild = lag_of("pd_bias", kappa=60.0)
    assert wild.severity == "error" and "kappa" in wild.text and "is calm" in wild.text
    weaving = lag_of("cao2013_saturated", layer_share=0.05)
    assert weaving.severity == "warning" and "weave" in weaving.text and "layer_share" in weaving.text
    assert lag_of("tangent", gain_per_s=300.0).severity == "error"


def test_a_gain_however_large_is_seen_to_swing():
    """g tau = 60, 200 and 20,000: the loop passes 1 where it is far quicker than any vehicle."""
    for gain in (300.0, 1e3, 1e5):
        assert lag_of("tangent", gain_per_s=gain).severity == "error"
    assert Loop(V, V / R_A, -1e12, -1e12, 0.0).dead_time_s(0.1) < 1e-5
    closing = Loop(V, V / R_A, -1e-9, -1e-7, 0.0)  # hardly steered: it passes 1 within a millionth of V / r_a
    assert 0.0 < closing.dead_time_s() < math.inf


def test_a_lag_without_bound_is_called_any():
    """With so slow a run-in the range has no say but for the turn of the sight (K_r > 0): by Routh any lag will do."""
    text = lag_of("tangent", reach_s=1e4).text
    assert "lags by any time" in text and "inf" not in text
