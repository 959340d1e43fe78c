"""Calibration against ranges whose bias is known, and what it must refuse."""

from __future__ import annotations

import random
import re

import pytest

from circumnav_mav.ranging.calibrate import calibrate


def measured(distance_m, bias_m, sigma_m, count, seed=1, rho=0.0, step_m=0.0):
    """Ranges with an AR(1) error of lag-1 correlation rho, rounded to step_m."""
    rng = random.Random(seed)
    error_m, ranges = 0.0, []
    for _ in range(count):
        error_m = rho * error_m + (1.0 - rho**2) ** 0.5 * rng.gauss(0.0, sigma_m)
        r_m = distance_m + bias_m + error_m
        ranges.append(round(r_m / step_m) * step_m if step_m else r_m)
    return ranges


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_the_bias_and_its_standard_error_are_honest(rho):
    """Over many calibrations the error in units of its standard error has a standard deviation near 1."""
    scores = []
    for seed in range(300):
        found = calibrate(measured(10.0, 0.154, 0.05, 400, seed, rho), 10.0)
        scores.append((found.bias_m - 0.154) / found.standard_error_m)
    rms = (sum(score**2 for score in scores) / len(scores)) ** 0.5
    assert 0.85 < rms < 1.25


def test_a_good_calibration_says_so():
    found = calibrate(measured(10.0, 0.154, 0.03, 300, step_m=0.01), 10.0, resolution_m=0.01)
    assert found.ok
    assert found.bias_m == pytest.approx(0.154, abs=0.01)
    assert found.verdict().endswith("good")


def test_a_bias_that_was_corrected_already_is_added():
    found = calibrate(measured(10.0, 0.05, 0.03, 300), 10.0, current_bias_m=0.1)
    assert found.bias_m == pytest.approx(0.15, abs=0.01)


def test_a_few_reflections_do_not_move_the_bias():
    ranges = measured(10.0, 0.15, 0.03, 300)
    ranges[::20] = [r_m + 4.0 for r_m in ranges[::20]]
    found = calibrate(ranges, 10.0)
    assert found.ok
    assert found.outliers == 15
    assert found.bias_m == pytest.approx(0.15, abs=0.01)


def test_a_range_that_never_changes_still_has_an_error():
    found = calibrate([10.15] * 100, 10.0, resolution_m=0.01)
    assert found.bias_m == pytest.approx(0.15)
    assert found.standard_error_m == pytest.approx(0.01 / 12**0.5)


REFUSED = {
    "no ranges": ([], 10.0, "too few"),
    "one range": ([10.1], 10.0, "too few"),
    "too few": (measured(10.0, 0.1, 0.03, 49), 10.0, "too few"),
    "too near": (measured(0.5, 0.1, 0.03, 300), 0.5, "too near"),
    "reflections": (measured(10.0, 0.1, 0.03, 250) + [14.0] * 50, 10.0, "far off"),
    "in motion": (measured(10.0, 0.1, 0.8, 300), 10.0, "spread"),
    "wrong distance": (measured(50.0, 0.1, 0.03, 300), 10.0, "is 10 m right"),
    "drift": ([r_m + 0.0005 * n for n, r_m in enumerate(measured(10.0, 0.1, 0.03, 400))], 10.0, "drift"),
    "steady drift": ([r_m + 0.01 * n for n, r_m in enumerate(measured(30.0, 0.1, 0.03, 60))], 30.0, "drift by"),
    "fast drift": ([r_m + 0.005 * n for n, r_m in enumerate(measured(30.0, 0.1, 0.03, 300))], 30.0, "drift by"),
    "noisy drift": ([r_m + 0.005 * n for n, r_m in enumerate(measured(30.0, 0.1, 0.2, 300))], 30.0, "drift by"),
    "noisy and short": (measured(30.0, 0.1, 0.55, 60), 30.0, "for longer"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_words(case):
    ranges, distance_m, words = REFUSED[case]
    found = calibrate(ranges, distance_m)
    assert not found.ok
    assert words in found.verdict() and "nan" not in found.verdict()


@pytest.mark.parametrize("drift_m_s", [-0.1, 0.1])
def test_a_drift_is_not_called_a_matter_of_patience(drift_m_s):
    """Ranges at 10 Hz for 30 s; the error of their mean is inflated by the drift itself."""
    found = calibrate([r_m + drift_m_s * n / 10.0 for n, r_m in enumerate(measured(60.0, 0.1, 0.05, 300))], 60.0)
    told = re.search(r"drift by (\S+) m between the halves", found.verdict())
    assert told and float(told[1]) == pytest.approx(15.0 * drift_m_s, abs=0.03) and "longer" not in found.verdict()


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
def test_good_data_is_rarely_refused(rho):
    refused = [s for s in range(500) if not calibrate(measured(10.0, 0.15, 0.05, 300, s, rho=rho), 10.0).ok]
    assert len(refused) <= 5


@pytest.mark.parametrize("distance_m", [0.0, -1.0, float("nan"), float("inf")])
def test_a_distance_that_is_none_raises(distance_m):
    with pytest.raises(ValueError, match="distance"):
        calibrate([10.0] * 100, distance_m)


def test_ranges_must_be_finite():
    with pytest.raises(ValueError, match="finite"):
        calibrate([10.0, float("nan")], 10.0)
