"""Laws against geometry, with a target that is known exactly: what a law does is not the estimator's merit."""

import math
import random

import pytest

from circumnav_mav.guidance.kernel import Estimate, LawContext, mirror
from circumnav_mav.guidance.laws import LAWS, tangent

V, R_A, LIMIT = 10.0, 60.0, 0.6
SWITCHING = ("cao2013_saturated", "sliding_mode")
SMOOTH = [name for name in LAWS if name not in SWITCHING]


def context(r_min=math.nan, lag_s=0.0):
    return LawContext(R_A, V, LIMIT, lag_s, r_min)


def truth(x, y, psi, u=0.0, drift=(0.0, 0.0)):
    """The exact estimate of a target at the origin. drift: wind minus target velocity."""
    vx, vy = V * math.cos(psi) + drift[0], V * math.sin(psi) + drift[1]
    r = math.hypot(x, y)
    theta = math.remainder(psi - math.atan2(-y, -x), 2 * math.pi)
    return Estimate(r, (x * vx + y * vy) / r, V, u, theta, psi, -x, -y, *drift)


def fly(name, start, for_s=120.0, options=None, drift=(0.0, 0.0), lag_s=0.0, mirrored=False, r_min=math.nan):
    """Return the ranges of a flight on exact estimates, 50 Hz, Euler steps of 5 ms."""
    law = LAWS[name]
    par = law.parameters(options or {}, context(r_min, lag_s))
    x, y, psi = start
    u, ranges = 0.0, []
    for _ in range(int(for_s * 50)):
        est = truth(x, y, psi, u, drift)
        command = -law.turn_rate(mirror(est), par) if mirrored else law.turn_rate(est, par)
        command = max(-LIMIT, min(LIMIT, command))
        for _ in range(4):
            u += (command - u) * 0.005 / lag_s if lag_s else command - u
            psi += u * 0.005
            x += (V * math.cos(psi) + drift[0]) * 0.005
            y += (V * math.sin(psi) + drift[1]) * 0.005
        ranges.append(math.hypot(x, y))
    return ranges


@pytest.mark.parametrize("name", SMOOTH)
def test_on_the_circle_the_turn_is_that_of_the_circle(name):
    par = LAWS[name].parameters({}, context())
    for bearing in (0.1, 2.0, 4.5):
        est = truth(R_A * math.cos(bearing), R_A * math.sin(bearing), bearing - 0.5 * math.pi, -V / R_A)
        assert LAWS[name].turn_rate(est, par) == pytest.approx(-V / R_A, rel=1e-3)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", LAWS)
def test_every_law_reaches_its_circle_from_anywhere(name, mirrored):
    draw = random.Random(7)
    for _ in range(2):
        start = (draw.uniform(-200, 200), draw.choice((-1, 1)) * draw.uniform(80, 200), draw.uniform(-3, 3))
        last = fly(name, start, 120.0, mirrored=mirrored)[-1000:]
        assert max(abs(r - R_A) for r in last) < 0.06 * R_A, f"seed 7, start {start}"


@pytest.mark.parametrize("name", LAWS)
def test_a_mirrored_flight_is_the_mirror_image(name):
    right = fly(name, (-150.0, 40.0, 0.3), 40.0)
    left = fly(name, (-150.0, -40.0, -0.3), 40.0, mirrored=True)
    assert right == pytest.approx(left, abs=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_an_option_that_no_law_has_a_range_for_is_refused_in_words(name):
    option = next(iter(LAWS[name].options))
    with pytest.raises(ValueError, match=r"must|below|raise"):
        LAWS[name].parameters({option: -1.0}, context())


@pytest.mark.parametrize("name", ["cao2013_saturated", "sliding_mode", "tangent"])
def test_a_circle_tighter_than_the_vehicle_turns_is_refused(name):
    with pytest.raises(ValueError, match=r"fly slower, or wider"):
        LAWS[name].parameters({}, LawContext(10.0, V, LIMIT, 0.0))


def test_the_tangent_law_needs_a_limit_to_plan_with():
    with pytest.raises(ValueError, match="turn_rate_rad_s"):
        LAWS["tangent"].parameters({}, LawContext(R_A, V, math.inf, 0.0))


@pytest.mark.parametrize("r", [10.0, 40.0, 59.99, 60.01, 61.0, 70.0, 120.0, 900.0])
def test_the_slope_of_the_run_in_is_its_derivative(r):
    h = 1e-5 * r
    slope = (tangent.run_in(r + h, R_A, 15.0)[0] - tangent.run_in(r - h, R_A, 15.0)[0]) / (2 * h)
    assert tangent.run_in(r, R_A, 15.0)[1] == pytest.approx(slope, rel=1e-3, abs=1e-7)


def test_far_away_the_run_in_is_the_tangent_of_the_circle():
    f, _ = tangent.run_in(20.0 * R_A, R_A, 15.0)
    assert 0.5 * math.pi - f == pytest.approx(math.asin(1.0 / 20.0), abs=0.02)


@pytest.mark.parametrize("drift", [(4.0, 0.0), (-2.0, 5.0)])
@pytest.mark.parametrize("lag_s", [0.0, 0.5])
def test_wind_does_not_move_the_circle_of_the_tangent_law(drift, lag_s):
    ranges = fly("tangent", (-150.0, 40.0, 0.0), 80.0, drift=drift, lag_s=lag_s)
    # Without the lag only the 50 Hz hold is left; with it, the third derivative that is not fed forward.
    assert max(abs(r - R_A) for r in ranges[-2000:]) < (0.25 if lag_s == 0.0 else 0.6)


def test_on_the_circle_in_wind_the_turn_is_the_derivative_of_the_heading():
    par = LAWS["tangent"].parameters({}, context())
    wx, wy = 3.0, -4.0

    def state(phi):
        """Heading and angular speed for a ground track around the circle, by vector geometry."""
        c, s = math.sin(phi), -math.cos(phi)  # clockwise course at bearing phi
        across = -wx * s + wy * c
        along = wx * c + wy * s
        psi = math.atan2(s, c) + math.asin(-across / V)
        return psi, -(math.sqrt(V * V - across * across) + along) / R_A

    for phi in (0.0, 1.0, 2.5, 4.0, 5.5):
        psi, rate = state(phi)
        h = 1e-5
        u = math.remainder(state(phi + h)[0] - state(phi - h)[0], 2 * math.pi) / (2 * h) * rate
        est = truth(R_A * math.cos(phi), R_A * math.sin(phi), psi, u, (wx, wy))
        assert LAWS["tangent"].turn_rate(est, par) == pytest.approx(u, abs=1e-4)


@pytest.mark.parametrize("start", [(-45.0, 0.0, 0.0), (-45.0, 5.0, 0.3), (-45.0, -5.0, -0.3), (-50.0, 20.0, -1.0)])
def test_the_entry_keeps_the_least_range_where_a_turn_can(start):
    r_min = 15.0
    turns = []
    for side in (1.0, -1.0):  # what a full turn either way would come to
        R, (x, y, psi) = V / LIMIT, start
        cx, cy = x - side * R * math.sin(psi), y + side * R * math.cos(psi)
        turns.append(abs(math.hypot(cx, cy) - R))
    assert max(turns) > r_min, "the case must be one that can be flown"
    assert min(fly("tangent", start, 60.0, r_min=r_min)) > 0.95 * min(r_min, max(turns))


@pytest.mark.parametrize("r_min", [math.nan, 40.0])
@pytest.mark.parametrize("r", [62.0, 70.0, 85.0, 110.0])
def test_a_vehicle_that_circles_the_wrong_way_turns_round(r, r_min):
    """Seen in flight: at the edge between two sides of a turn the choice chattered, and the circle went on for ever."""
    last = fly("tangent", (r, 0.0, 0.5 * math.pi), 60.0, lag_s=0.5, r_min=r_min)[-500:]
    assert max(abs(e - R_A) for e in last) < 0.5


def test_the_least_range_of_a_turn_is_that_of_the_flown_turn():
    par = LAWS["tangent"].parameters({}, context(lag_s=0.0))
    for psi, turn, drift in ((0.2, 2.5, (0.0, 0.0)), (-1.0, -3.0, (3.0, -2.0)), (2.0, 1.2, (-4.0, 1.0))):
        est = truth(-70.0, 20.0, psi, math.copysign(LIMIT, turn), drift)
        x, y, heading, least = -70.0, 20.0, psi, math.hypot(70.0, 20.0)
        for _ in range(int(abs(turn) / LIMIT / 1e-3)):
            heading += math.copysign(LIMIT, turn) * 1e-3
            x += (V * math.cos(heading) + drift[0]) * 1e-3
            y += (V * math.sin(heading) + drift[1]) * 1e-3
            least = min(least, math.hypot(x, y))
        assert tangent.least_range(est, turn, par, par.lag) == pytest.approx(least, abs=1.5)


@pytest.mark.parametrize("name", ["hashemi2013", "hashemi2013_outer", "cao2013_smooth"])
def test_a_range_of_zero_is_flown_on_at_the_least_gain(name):
    """There r_s is 0: the law is u = -k (r_dot + V) at every range."""
    law = LAWS[name]
    par = law.parameters({"kappa": 1.0}, LawContext(10.0, 2.0, 1.0, 0.0))
    for r in (0.0, 1e-200, 3.0):
        assert law.turn_rate(Estimate(r=r, r_dot=0.5, V=2.0), par) == pytest.approx(-0.1 * 2.5)


@pytest.mark.parametrize(
    ("x", "psi", "period_s", "wind"),
    [
        (-1.2, 0.0, 0.5, 0.0),
        (-1.2, 0.0, 1.0, 3.0),
        (-1.2, 0.0, 1.0, 0.0),
        (-1.5, -0.2, 1.0, 3.0),
        (-1.5, -0.2, 0.5, 3.0),
    ],
)
def test_mirror_images_that_lead_in_turns_do_not_lead_over_the_target(x, psi, period_s, wind):
    """Seen in flight: the target said to lie on one side and then on the other, and the lag spent on changing sides."""
    lag_s, dt, drift = 1.0, 0.01, (wind, 0.0)
    par = LAWS["tangent"].parameters({}, context(lag_s=0.5 * lag_s))
    x, y, u, least = x * R_A, 0.0, 0.0, math.inf
    for n in range(3000):
        seen = truth(x, y, psi, u, drift)
        if int(n * dt / period_s) % 2:  # the same range and range rate: the target mirrored in the course
            course = math.atan2(V * math.sin(psi) + drift[1], V * math.cos(psi) + drift[0])
            bearing = 2.0 * course - math.atan2(seen.py, seen.px)
            seen = seen._replace(px=seen.r * math.cos(bearing), py=seen.r * math.sin(bearing))
        u += (LAWS["tangent"].turn_rate(seen, par) - u) * dt / lag_s
        psi += u * dt
        x += (V * math.cos(psi) + drift[0]) * dt
        y += (V * math.sin(psi) + drift[1]) * dt
        least = min(least, math.hypot(x, y))
    assert least > 0.4 * R_A
