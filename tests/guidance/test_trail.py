import math

import pytest

from circumnav_mav.guidance.estimators import make
from circumnav_mav.guidance.kernel import EstimatorContext, Motion
from circumnav_mav.guidance.trail import Trail
from circumnav_mav.types import RangeSample


def circle(trail: Trail, V: float, u: float, until_s: float, rate_hz: float, compass: bool) -> None:
    for n in range(int(until_s * rate_hz) + 1):
        t = n / rate_hz
        trail.advance(t, Motion(V, u, math.remainder(0.7 + u * t, 2 * math.pi) if compass else math.nan))


@pytest.mark.parametrize("compass", [True, False])
def test_a_circle_flown_is_a_circle_reckoned(compass):
    V, u = 5.0, -0.5
    trail = Trail(2.0, V)
    circle(trail, V, u, 10.0, 50.0, compass)
    now = Motion(V, u, math.remainder(0.7 + u * 10.0, 2 * math.pi) if compass else math.nan)
    a, b = trail.at(9.0, now), trail.at(10.0, now)
    moved = trail.between(a, b, now)
    R, turn = V / abs(u), u * 1.0  # the chord of an arc of one second, by plane geometry
    assert moved.ahead == pytest.approx(R * math.sin(abs(turn)), rel=1e-6)
    assert moved.left == pytest.approx(-R * (1 - math.cos(turn)), rel=1e-6)
    assert moved.turn == pytest.approx(turn)
    assert math.isnan(moved.psi) != compass
    if compass:
        assert math.remainder(moved.psi - now.psi, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_a_velocity_that_is_measured_moves_the_vehicle_whatever_the_heading_does():
    """It flies straight and slower than V while it turns on the spot."""
    trail = Trail(5.0, 4.0)
    for n in range(201):
        t, psi = n / 50, 0.3 + 0.5 * n / 50
        along = 0.4 - psi  # the velocity points where psi was 0.4
        trail.advance(t, Motion(4.0, 0.5, psi, 3.0 * math.cos(along), 3.0 * math.sin(along)))
    moved = trail.between(trail.at(1.0, Motion()), trail.at(3.0, Motion()), Motion())
    along = 0.4 - (0.3 + 0.5 * 1.0)
    assert moved.ahead == pytest.approx(6.0 * math.cos(along), abs=0.05)  # a step of 20 ms turns it by 0.01 rad
    assert moved.left == pytest.approx(6.0 * math.sin(along), abs=0.05)
    assert moved.turn == pytest.approx(1.0)
    straight = Trail(5.0, 4.0, slips=False)
    straight.advance(0.0, Motion(4.0, 0.0, 0.3, 1.0, 2.0))
    straight.advance(1.0, Motion(4.0, 0.0, 0.3, 1.0, 2.0))
    moved = straight.between(straight.at(0.0, Motion()), straight.at(1.0, Motion()), Motion())
    assert (moved.ahead, moved.left) == pytest.approx((4.0, 0.0))


def test_silent_sensors_keep_their_last_value_and_the_compass_is_reckoned():
    trail = Trail(5.0, 4.0)
    trail.advance(0.0, Motion(4.0, 0.1, 1.0))
    trail.advance(1.0, Motion(4.0, 0.1, 1.1))
    trail.advance(2.0, Motion())
    a, b = trail.at(1.0, Motion()), trail.at(2.0, Motion())
    moved = trail.between(a, b, Motion())
    assert (moved.V, moved.u) == (4.0, 0.1)
    assert moved.psi == pytest.approx(1.2)


def test_a_compass_that_comes_late_is_not_a_turn():
    trail = Trail(5.0, 4.0)
    trail.advance(0.0, Motion(4.0, 0.0))
    trail.advance(1.0, Motion(4.0, 0.0, 2.0))
    moved = trail.between(trail.at(0.0, Motion()), trail.at(1.0, Motion()), Motion())
    assert (moved.turn, moved.ahead, moved.psi) == (0.0, 4.0, 2.0)


def test_forgets_what_is_older_than_its_span_and_sees_ahead_of_its_end():
    trail = Trail(1.0, 4.0)
    circle(trail, 4.0, 0.2, 5.0, 10.0, True)
    assert trail.at(3.0, Motion()) is None
    assert trail.at(4.0, Motion()) is not None
    ahead = trail.at(5.5, Motion(4.0, 0.0))
    assert trail.between(trail.at(5.0, Motion()), ahead, Motion(4.0, 0.0)).ahead == pytest.approx(2.0)


def test_a_heading_that_is_missing_does_not_start_the_ring_again():
    """drift needs a heading; between two of the compass the trail reckons it, so a gap is no restart."""
    V, r_a, rate_hz = 15.0, 80.0, 20.0
    u = -V / r_a
    estimator = make("drift", {}, EstimatorContext(r_a, V, 0.46))
    for n in range(int(70.0 * rate_hz)):
        t = n / rate_hz
        bearing = 0.3 + u * t  # from the target, which stands 10 m off the middle of the circle: the ranges change
        x, y = r_a * math.cos(bearing), r_a * math.sin(bearing)
        heading = math.remainder(bearing - 0.5 * math.pi, 2 * math.pi)
        silent = n == 1200 or 1240 <= n < 1270  # one tick, and a second and a half
        motion = Motion(V, u, math.nan if silent else heading)
        estimator.advance(t, motion)
        assert estimator.on_sample(RangeSample(t, math.hypot(x - 10.0, y), sigma_m=0.3), motion) is None
        if n >= 1199:
            assert estimator.spread_m() < 1.0
            estimate = estimator.at(t, motion)
            assert estimate is not None
            assert (estimate.px, estimate.py) == pytest.approx((10.0 - x, -y), abs=0.5)
