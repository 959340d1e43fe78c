"""How seldom ranges may come: the closed forms against flights and against the filter's own difference equations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from circumnav_mav.advice import SUITS
from circumnav_mav.check import findings
from circumnav_mav.config import Config
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.feasibility import LAG_UNSTABLE
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.study.compare import row
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot
from tests.guidance.flight import Flight

R_A, V, KAPPA = 50.0, 5.0, 5.0
OMEGA = KAPPA / R_A * V  # k V


def swing(estimator, lag_s, period_s, sigma_r_dot=math.nan):
    """How far the range swings about its mean, without noise to speak of, started on the circle."""
    flight = Flight(
        r_a=R_A,
        V=V,
        estimator=estimator,
        law_options={"kappa": KAPPA},
        start=(-1.02 * R_A, 0.0, 0.5 * math.pi),
        lag_s=lag_s,
        turn_rate_limit=1.0,
        sigma_r=0.002,
        sigma_r_dot=sigma_r_dot,
        sample_hz=1.0 / period_s,
        tick_hz=20.0,
    ).fly(200.0)
    return float(np.std(flight.errors(150.0)))


@pytest.mark.parametrize("lag", [0.1, 0.4])
def test_a_difference_of_held_ranges_weaves_where_the_bound_says(lag):
    lag_s = lag / OMEGA
    bound_s = sampling.slowest_period_s(R_A, KAPPA, V, lag_s, measured_rate=False)
    assert sampling.largest_kappa(R_A, V, lag_s + bound_s) == pytest.approx(KAPPA)
    assert swing("raw", lag_s, 0.8 * bound_s) < 0.05
    assert swing("raw", lag_s, 1.35 * bound_s) > 1.0


def test_a_held_rate_that_is_measured_is_borne_twice_as_long():
    bound_s = sampling.slowest_period_s(R_A, KAPPA, V, 0.1 / OMEGA, measured_rate=True)
    assert bound_s == pytest.approx(2.0 * sampling.slowest_period_s(R_A, KAPPA, V, 0.1 / OMEGA, measured_rate=False))
    assert swing("raw", 0.1 / OMEGA, 0.8 * bound_s, sigma_r_dot=0.001) < 0.05
    assert swing("raw", 0.1 / OMEGA, 2.0 * bound_s, sigma_r_dot=0.001) > 1.0


def test_an_estimate_that_is_carried_on_bears_ranges_far_apart():
    assert swing("direct", 0.3 / OMEGA, 1.5 / OMEGA) < 0.05
    assert 2.0 * (LAG_UNSTABLE - 0.3) < 1.5, "more than twice what a held difference bears"


@pytest.mark.parametrize(("sigma_m", "accel", "period_s"), [(0.3, 0.4, 0.1), (1.0, 0.2, 0.1), (5.0, 0.4, 0.5)])
def test_the_lag_of_the_filter_is_that_of_its_own_equations(sigma_m, accel, period_s):
    """The steady Kalman filter, iterated in numpy, follows a rate that grows steadily as late as the formula says."""
    dt, q = period_s, accel**2
    F, H = np.array([[1.0, dt], [0.0, 1.0]]), np.array([1.0, 0.0])
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    P = np.eye(2)
    for _ in range(4000):
        P = F @ P @ F.T + Q
        K = P @ H / (H @ P @ H + sigma_m**2)
        P = P - np.outer(K, H @ P)
    x = np.zeros(2)
    for n in range(1, 4000):
        t = n * dt
        x = F @ x
        x = x + K * (0.5 * t * t - x[0])
    late_s = t - x[1]  # of a rate of t
    assert sampling.filter_lag_s(sigma_m, accel, period_s) == pytest.approx(late_s, rel=0.1, abs=0.5 * period_s)


def wind_shift(kappa, accel):
    flight = Flight(
        r_a=R_A,
        V=V,
        law_options={"kappa": kappa},
        estimator_options={"accel_m_s2": accel},
        start=(-1.1 * R_A, 0.0, 0.5 * math.pi),
        lag_s=0.1,
        turn_rate_limit=1.0,
        sample_hz=5.0,
        wind=(0.15 * V, 0.0),
        tick_hz=20.0,
    ).fly(250.0)
    return float(np.std(flight.errors(120.0)))


def test_a_law_faster_than_its_filter_gains_nothing_against_the_wind():
    quick, slow = 0.4, 0.01
    assert sampling.kappa_of_use(R_A, V, sampling.filter_lag_s(0.3, quick, 0.2)) > 8.0
    assert sampling.kappa_of_use(R_A, V, sampling.filter_lag_s(0.3, slow, 0.2)) < 3.0
    assert wind_shift(8.0, quick) < 0.4 * wind_shift(3.0, quick)
    assert wind_shift(8.0, slow) > 0.6 * wind_shift(3.0, slow)


def check(**sections):
    return {f.topic: f for f in findings(Config.model_validate(sections))}


@pytest.mark.parametrize("kind", VEHICLES)
def test_check_names_the_estimator_that_suits_every_class(kind):
    vehicle = VEHICLES[kind]
    best, _ = SUITS[vehicle.speed]
    estimator, law = {"name": best}, {"name": "tangent" if best == "drift" else "hashemi2013"}
    found = check(vehicle={"class": kind}, estimator=estimator, law=law)["estimator"]
    assert found.severity == "info"
    assert f"{best} suits {kind}" in found.text
    worse = check(vehicle={"class": kind}, estimator={"name": "raw"})["estimator"]
    assert worse.severity == "warning"
    assert f"{best} suits {kind}" in worse.text


def test_check_bounds_the_gain_by_the_rate_of_ranges():
    assert check(estimator={"name": "raw"})["range_rate"].severity == "info"
    found = check(estimator={"name": "raw"}, law={"kappa": 8.0})["range_rate"]
    assert found.severity == "warning"
    assert "1 s apart (ranging.max_age_s), only kappa below" in found.text
    noisy = {"ranging": {"sigma_m": 5.0}, "estimator": {"name": "direct"}}
    assert check(**noisy, law={"kappa": 5.0})["range_rate"].severity == "warning"
    assert check(estimator={"name": "direct"})["range_rate"].severity == "info"
    assert "adds nothing" in check(estimator={"name": "polar"})["range_rate"].text


TANGENT = {"law": {"name": "tangent"}, "estimator": {"name": "drift"}}
PLANE_12 = {"vehicle": {"class": "px4_fixed_wing"}, **TANGENT}


def test_check_says_what_rms_tangent_on_drift_will_have():
    """The plane on 80 m, sigma 1 m, one range a second: 24 flights of the study's plant have 0.48 m."""
    found = check(**PLANE_12, study={"range_rate_hz": 1.0}, ranging={"sigma_m": 1.0})
    assert "expect 0.48 m rms" in found["range_rate"].text and found["range_rate"].severity == "info"
    assert "(ranging.max_age_s)" in check(**TANGENT)["range_rate"].text
    rare = {"ranging": {"sigma_m": 10.0, "max_age_s": 5.0}, "study": {"range_rate_hz": 0.2, "wind_m_s": 9.0}}
    found = check(**PLANE_12, **rare)  # flown: 24 flights of 41 m rms, a sixth lost
    assert found["range_rate"].severity == found["sight"].severity == "warning"
    assert "turns by up to 1.3 rad" in found["sight"].text  # (12 + 9) 5 / 80
    assert "140 m or wider" in found["sight"].text
    wide = check(**PLANE_12, **rare, orbit={"radius_m": 400.0})
    assert "sight" not in wide and wide["range_rate"].severity == "info"


def test_check_warns_where_polar_loses_sight_between_ranges():
    """Measured at 5 m/s and 50 m in a tenth of wind: 4 of 24 lost with a range in 5 s (0.5 rad), none in 2 s."""
    base = {
        "estimator": {"name": "polar"},
        "orbit": {"radius_m": 50.0, "speed_m_s": 5.0},
        "ranging": {"max_age_s": 5.0},
    }
    for law in ("hashemi2013", "pd_bias"):
        assert check(**base, law={"name": law})["sight"].severity == "warning"
        assert "sight" not in check(**base, law={"name": law}, study={"range_rate_hz": 0.5})


@pytest.mark.parametrize("law", ["hashemi2013", "pd_bias", "sliding_mode"])
def test_check_warns_where_direct_has_too_few_ranges(law):
    """Measured at 5 m/s and 50 m in a fifth of wind: 5 % lost with a range in 6 s (0.75 rad), none in 2.5 s."""
    base = {"estimator": {"name": "direct"}, "law": {"name": law}, "ranging": {"max_age_s": 60.0}}
    assert check(**base, study={"range_rate_hz": 0.02})["sight"].severity == "warning"
    assert check(**base, study={"range_rate_hz": 0.16})["sight"].severity == "warning"
    assert "sight" not in check(**base, study={"range_rate_hz": 0.5})


@pytest.mark.parametrize(
    ("options", "warned"),
    [({}, False), ({"gain_per_s": 10.0}, False), ({"gain_per_s": 50.0}, True), ({"reach_s": 0.01}, True)],
)
def test_check_warns_of_gains_that_turn_noise_into_turning(options, warned):
    """Flown at 5 m/s on 50 m: u^2 of 1.00, 1.08, 48 and 9.5 times the circle's."""
    found = check(estimator={"name": "drift"}, law={"name": "tangent", **options}, study={"range_rate_hz": 10.0})
    assert ("effort" in found) == warned
    if warned:
        assert found["effort"].severity == "warning" and "the vehicle is never still" in found["effort"].text


@pytest.mark.parametrize(
    ("r_a", "V_", "sigma_m", "hz"),
    [(80.0, 12.0, 0.1, 1.0), (80.0, 12.0, 1.0, 10.0), (80.0, 12.0, 3.0, 0.5), (50.0, 5.0, 1.0, 1.0)],
)
@pytest.mark.soak
def test_the_rms_of_tangent_on_drift_is_the_formula_s(r_a, V_, sigma_m, hz):
    scenario = replace(
        SCENARIOS["R_calm"], V_m_s=V_, r_a_m=r_a, sigma_r_m=sigma_m, range_every=round(20.0 / hz), lag_s=0.5,
        limit_rad_s=0.47, start_m=(1.5 * r_a, 3.0 * r_a),
    )  # fmt: skip
    for wind in (0.0, 0.3):
        flown = row(replace(scenario, wind_m_s=wind * V_), Pilot("tangent", "drift"), 20, seed=3)
        assert flown.lost == 0.0
        assert flown.tail_rms_m == pytest.approx(sampling.drift_rms_m(r_a, V_, sigma_m, 1.0 / hz, 0.003), rel=0.3)
