"""Estimators and laws in flight through the flying wrapper, both ways round, against the vehicle's own geometry."""

import math
import random

import pytest

from circumnav_mav.config import RESTARTS_A_MINUTE
from circumnav_mav.guidance.estimators import ESTIMATORS, make
from circumnav_mav.guidance.kernel import SOURCES, EstimatorContext, Motion
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.types import RangeSample
from tests.guidance.flight import Flight

BOTH_WAYS = pytest.mark.parametrize("clockwise", [True, False])
FILTERS = ("direct", "polar", "drift")


def ours(**keys):
    return Flight(law="tangent", estimator="drift", **keys)


@BOTH_WAYS
def test_polar_needs_no_compass(clockwise):
    flight = Flight(estimator="polar", clockwise=clockwise, compass=False).fly(150.0)
    assert flight.furthest(110.0) < 1.5


@BOTH_WAYS
@pytest.mark.parametrize("start", [(-120.0, 30.0, 0.4), (90.0, -60.0, 2.0), (10.0, 0.0, 0.0)])
def test_ours_holds_the_circle_from_anywhere_in_wind(clockwise, start):
    flight = ours(clockwise=clockwise, start=start, wind=(2.0, -1.0)).fly(100.0)
    assert flight.rms(65.0) < 0.6
    assert flight.furthest(65.0) < 1.5


@BOTH_WAYS
def test_the_orbit_goes_the_way_that_was_asked(clockwise):
    flight = ours(clockwise=clockwise).fly(60.0)
    x, y, psi = flight.state
    turning = x * math.sin(psi) - y * math.cos(psi)  # angular momentum: + counter-clockwise
    assert (turning < 0.0) == clockwise


@BOTH_WAYS
@pytest.mark.parametrize("estimator", ["polar", "drift"])
def test_bearing_and_place_of_the_target_are_those_of_the_geometry(estimator, clockwise):
    law = "tangent" if estimator == "drift" else "hashemi2013"
    flight = Flight(law=law, estimator=estimator, clockwise=clockwise).fly(90.0)
    x, y, psi = flight.state
    est = flight.est.at(flight.times[-1], Motion(flight.V, flight.u, psi))
    assert math.remainder(est.theta - (psi - math.atan2(-y, -x)), 2 * math.pi) == pytest.approx(0.0, abs=0.05)
    assert (est.px, est.py) == pytest.approx((-x, -y), abs=2.5)
    assert est.r_dot == pytest.approx(0.0, abs=0.3)


def test_drift_finds_the_wind_and_the_airspeed_scale():
    flight = ours(wind=(1.5, 1.0), believed=1.1).fly(110.0)
    est = flight.est.at(flight.times[-1], Motion(1.1 * flight.V, flight.u, flight.state[2]))
    assert (est.wx, est.wy) == pytest.approx((1.5, 1.0), abs=0.15)
    assert abs(est.V - flight.V) < 0.15


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_ours_bears_echoes(share):
    flight = ours(wind=(2.0, 0.0), outliers=share, seed=4).fly(120.0)
    assert flight.furthest(80.0) < 2.0, "seed 4"


@pytest.mark.parametrize("estimator", FILTERS)
def test_a_beacon_that_jumps_is_found_again(estimator):
    flight = Flight(estimator=estimator, jump=(80.0, 25.0, 10.0)).fly(180.0)
    assert flight.est.restarts >= 1
    assert flight.furthest(150.0) < 1.5


@pytest.mark.parametrize("estimator", ["direct", "polar", "drift"])
@pytest.mark.parametrize("jump_m", [(25.0, 10.0), (60.0, -40.0)])
def test_a_beacon_that_jumps_among_thirty_per_cent_of_echoes_is_found_again(estimator, jump_m):
    law = "tangent" if estimator == "drift" else "hashemi2013"
    echoes = {"outliers": 0.3, "outlier_mean_m": 40.0}
    flight = Flight(estimator=estimator, law=law, jump=(70.0, *jump_m), **echoes).fly(150.0)
    assert flight.furthest(60.0, 70.0) < 1.5, "on the circle before, in spite of the echoes"
    assert flight.furthest(70.5, 75.0) > 15.0, "a real jump"
    assert flight.furthest(135.0) < 1.5, "on the circle about the new place"
    assert flight.rejected["outlier"] > 0.7 * 0.3 * 1500


@pytest.mark.parametrize("estimator", ["direct", "polar", "drift"])
@pytest.mark.parametrize(("for_s", "add_m", "sample_hz"), [(1.5, -15.0, 10.0), (3.0, 25.0, 10.0), (1.0, 40.0, 50.0)])
def test_a_burst_of_echoes_leaves_the_belief_standing(estimator, for_s, add_m, sample_hz):
    echo = (90.0, 90.0 + for_s, add_m)
    flight = Flight(estimator=estimator, sample_hz=sample_hz, echo=echo).fly(100.0)
    assert (flight.est.restarts, flight.est.returns) == (0, 0)
    assert flight.furthest(90.0) < 1.5


@pytest.mark.parametrize("estimator", ["direct", "polar", "drift"])
@pytest.mark.parametrize("add_m", [25.0, -15.0])
def test_ranges_that_jump_and_come_back_find_the_belief_as_it_was(estimator, add_m):
    flight = Flight(estimator=estimator, echo=(90.0, 100.0, add_m)).fly(150.0)
    assert flight.est.restarts == flight.est.returns == 1
    assert flight.furthest(130.0) < 1.5


@pytest.mark.parametrize("estimator", FILTERS)
def test_twenty_seconds_without_ranges(estimator):
    flight = Flight(estimator=estimator, gaps=((110.0, 130.0),)).fly(160.0)
    assert flight.furthest(110.0, 131.0) < 5.0
    assert flight.furthest(145.0) < 1.5


@pytest.mark.parametrize("estimator", FILTERS)
def test_latency_does_not_move_the_circle(estimator):
    flight = Flight(estimator=estimator, latency_s=0.5, law_options={"kappa": 5.0}).fly(150.0)
    assert flight.furthest(110.0) < 1.5


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_at_between_samples_goes_on_as_the_vehicle_does(estimator):
    """Fly a known circle, then ask at later times: the range must follow the geometry, not stand still."""
    if estimator == "raw":
        pytest.skip("raw holds the last reading: that is what it is for")
    est = make(estimator, {}, EstimatorContext(50.0, 5.0, 0.5))
    V, u, draw = 5.0, -0.125, random.Random(1)

    def place(t):
        psi = 0.4 + u * t
        return -70.0 + V / u * (math.sin(psi) - math.sin(0.4)), 20.0 - V / u * (math.cos(psi) - math.cos(0.4)), psi

    for n in range(2001):
        t = 0.02 * n
        x, y, psi = place(t)
        est.advance(t, Motion(V, u, psi))
        if n % 5 == 0:
            est.on_sample(RangeSample(t, math.hypot(x, y) + draw.gauss(0.0, 0.3), math.nan, 0.3), Motion(V, u, psi))
    for later in (40.3, 41.0, 42.0):
        x, y, psi = place(later)
        assert est.at(later, Motion(V, u, psi)).r == pytest.approx(math.hypot(x, y), abs=0.8)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_garbage_gives_estimates_or_rejections_never_an_exception(estimator):
    draw = random.Random(9)
    est = make(estimator, {}, EstimatorContext(50.0, 5.0, 0.5))
    t = 0.0
    for _ in range(3000):
        t += draw.choice((-0.5, 0.0, 0.001, 0.02, 0.1, 3.0, 30.0))
        motion = Motion(
            draw.choice((math.nan, 0.0, 5.0, 12.0)),
            draw.choice((math.nan, -2.0, 0.0, 1.0)),
            draw.choice((0.0, 3.0, -9.0)),
        )
        est.advance(t, motion)
        if draw.random() < 0.7:
            r = draw.choice((0.0, 1e-9, 50.0, draw.uniform(0, 500), 1e6))
            est.on_sample(
                RangeSample(t + draw.uniform(-3, 1), r, draw.choice((math.nan, 2.0)), draw.choice((math.nan, 0.5))),
                motion,
            )
        found = est.at(t + draw.choice((0.0, 0.5)), motion)
        assert found is None or not math.isnan(found.r), "seed 9"
        est.sigma_r(), est.covariance(), est.consistency()


def test_drift_waits_for_a_compass_and_then_flies():
    est = make("drift", {}, EstimatorContext(50.0, 5.0, 0.5))
    for n in range(20):
        est.advance(0.1 * n, Motion(5.0, 0.0))
        est.on_sample(RangeSample(0.1 * n, 80.0), Motion(5.0, 0.0))
        assert est.at(0.1 * n, Motion(5.0, 0.0)) is None
    for n in range(20, 40):
        est.advance(0.1 * n, Motion(5.0, 0.0, 1.0))
        est.on_sample(RangeSample(0.1 * n, 80.0 - 0.5 * (n - 20)), Motion(5.0, 0.0, 1.0))
    assert est.at(3.9, Motion(5.0, 0.0, 1.0)).r == pytest.approx(70.5, abs=1.0)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_reset_forgets_everything(estimator):
    flight = Flight(estimator=estimator, law="hashemi2013").fly(5.0)
    flight.est.reset()
    assert flight.est.at(5.0, Motion(5.0, 0.0, 0.0)) is None
    assert math.isnan(flight.est.sample_time_s())
    assert flight.est.restarts == 0


def test_what_an_estimator_declares_is_what_it_gives():
    for name, estimator in ESTIMATORS.items():
        assert estimator.needs <= SOURCES
        flight = Flight(estimator=name, law="hashemi2013").fly(20.0)
        est = flight.est.at(flight.times[-1], Motion(5.0, 0.0, 0.0))
        assert all(math.isfinite(getattr(est, field)) for field in estimator.gives)


def test_every_law_flies_on_some_estimator():
    for law in LAWS.values():
        assert any(set(law.needs) <= estimator.gives for estimator in ESTIMATORS.values())


@pytest.mark.parametrize(("estimator", "law"), [("direct", "hashemi2013"), ("drift", "tangent")])
def test_ranges_three_times_noisier_than_configured_are_flown_on(estimator, law):
    flight = Flight(estimator=estimator, law=law, sigma_r=1.0, claimed=0.3, lag_s=0.1).fly(150.0)
    assert flight.est.times_noisier() * 0.3 == pytest.approx(1.0, rel=0.5)
    assert flight.est.restarts < RESTARTS_A_MINUTE  # until the noise has shown itself
    assert flight.rms(100.0) < 0.6
