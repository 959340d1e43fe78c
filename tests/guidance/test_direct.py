"""The direct estimator in flight, against the geometry of the test's own vehicle."""

import math

import pytest

from circumnav_mav.guidance.estimators import make
from circumnav_mav.guidance.estimators.gate import LONGER_S
from circumnav_mav.guidance.kernel import EstimatorContext, Motion
from circumnav_mav.types import RangeSample
from tests.guidance.flight import Flight

BOTH_WAYS = pytest.mark.parametrize("clockwise", [True, False])


@BOTH_WAYS
@pytest.mark.parametrize("kappa", [1.5, 3.0, 8.0])
def test_holds_the_circle_with_a_lagging_turn_rate(clockwise, kappa):
    flight = Flight(clockwise=clockwise, law_options={"kappa": kappa}).fly(170.0)
    assert flight.rms(120.0) < 0.6
    assert flight.furthest(120.0) < 1.5


@BOTH_WAYS
@pytest.mark.parametrize("mean_m", [20.0, 40.0])
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_echoes_do_not_move_the_circle(clockwise, share, mean_m):
    flight = Flight(clockwise=clockwise, outliers=share, outlier_mean_m=mean_m).fly(170.0)
    assert flight.furthest(120.0) < 1.5
    assert flight.rejected["outlier"] > 0.7 * share * 1700
    assert flight.est.restarts == 0


def test_a_target_that_jumps_is_found_again():
    flight = Flight(jump=(80.0, 25.0, 10.0)).fly(170.0)
    assert flight.est.restarts == 1
    assert flight.rejected["outlier"] == pytest.approx(10.0 * LONGER_S, abs=1.0)
    assert flight.furthest(130.0) < 1.5


@BOTH_WAYS
def test_twenty_seconds_without_ranges_keep_the_vehicle_on_its_circle(clockwise):
    flight = Flight(clockwise=clockwise, gaps=((100.0, 120.0),)).fly(150.0)
    assert flight.furthest(100.0, 121.0) < 5.0
    assert flight.furthest(130.0) < 1.5


@pytest.mark.parametrize("latency_s", [0.1, 0.4])
def test_late_ranges_are_put_where_they_belong(latency_s):
    flight = Flight(latency_s=latency_s, law_options={"kappa": 6.0}).fly(150.0)
    assert flight.furthest(110.0) < 1.5


def test_a_measured_rate_is_used():
    def first_rate(sigma_r_dot: float) -> float:
        flight = Flight(sigma_r_dot=sigma_r_dot, sigma_r=5.0).fly(3.0)
        return flight.est.covariance()[2]

    assert first_rate(0.5) < 0.1 * first_rate(math.nan)


def test_known_only_when_the_rate_is():
    est = make("direct", {}, EstimatorContext(50.0, 5.0, 0.8))
    motion = Motion(5.0, 0.0)
    assert est.at(0.0, motion) is None
    est.on_sample(RangeSample(0.0, 100.0), motion)
    assert est.at(0.1, motion) is None
    assert math.isclose(est.sigma_r(), 0.3)
    est.on_sample(RangeSample(0.1, 99.5, -5.0), motion)
    assert est.at(0.2, motion).r == pytest.approx(99.0, abs=0.3)


def test_samples_that_cannot_be_placed_are_refused_in_words():
    est = make("direct", {}, EstimatorContext(50.0, 5.0, 0.8))
    motion = Motion(5.0, 0.0)
    for n in range(200):
        est.advance(0.02 * n, motion)
    assert est.on_sample(RangeSample(1.0, 100.0), motion).reason == "too_old"
    assert est.on_sample(RangeSample(3.9, 100.0), motion) is None
    assert est.on_sample(RangeSample(3.8, 100.0), motion).reason == "out_of_order"
    assert est.on_sample(RangeSample(3.9, 100.0), motion).reason == "out_of_order"


@pytest.mark.parametrize(("option", "value"), [("sigma_m", 0.0), ("gate_sigmas", -1.0), ("accel_m_s2", 0.0)])
def test_options_out_of_range_are_refused_in_words(option, value):
    with pytest.raises(ValueError, match=option):
        make("direct", {option: value}, EstimatorContext(50.0, 5.0, 0.8))
