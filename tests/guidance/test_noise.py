"""The noise of ranges, measured from innovations, against the noise that was put in."""

import math
import random

import pytest

from circumnav_mav.guidance.estimators.noise import ENOUGH, MOST, WINDOW, NoiseMeter

EXPECTED_M = 0.3


def fed(sigma_m, n=400, outliers=0.0, drift_m=0.0, seed=1):
    """Return the sigmas that a meter says over n innovations, and it; drift_m: what a wrong speed adds to each."""
    draw, meter, said = random.Random(seed), NoiseMeter(), []
    for k in range(n):
        detour = draw.expovariate(1 / 20.0) if draw.random() < outliers else 0.0
        meter.add(draw.gauss(0.0, sigma_m) + detour + k * drift_m, EXPECTED_M)
        said.append(meter.times * EXPECTED_M)
    return said, meter


@pytest.mark.parametrize("sigma_m", [0.1, 1.0, 5.0])
def test_white_noise_is_measured(sigma_m):
    said, _ = fed(sigma_m)
    usual = sorted(said[ENOUGH:])[len(said[ENOUGH:]) // 2]
    assert usual == pytest.approx(sigma_m, rel=0.15)


def test_nothing_is_said_of_too_few():
    said, meter = fed(1.0, n=ENOUGH)
    assert all(math.isnan(s) for s in said)
    assert meter.sigma(0.3) == 0.3 and not meter.noisier


def test_a_wrong_belief_that_drifts_away_is_not_noise():
    _, meter = fed(0.3, drift_m=0.1)
    assert not meter.noisier


@pytest.mark.parametrize("seed", range(5))
def test_a_tenth_of_outliers_is_not_noise(seed):
    _, meter = fed(0.3, outliers=0.1, seed=seed)
    assert not meter.noisier


def test_a_third_of_outliers_is_followed_but_not_to_the_outliers():
    _, meter = fed(0.3, outliers=0.33)
    assert meter.sigma(0.3) < MOST * 0.3


def test_what_was_configured_is_used_until_the_ranges_are_clearly_noisier():
    assert fed(0.45)[1].sigma(0.3) == 0.3
    assert fed(1.0)[1].sigma(0.3) == pytest.approx(1.0, rel=0.4)
    assert fed(50.0)[1].sigma(0.3) == MOST * 0.3


def test_a_replaced_belief_is_no_noise():
    meter = NoiseMeter()
    for k in range(200):
        if k % 20 == 0:
            meter.restart()
        meter.add(100.0 * (k // 20) + (0.1 if k % 2 else -0.1), 1.0)
    assert meter.times < 0.5


def test_an_innovation_that_could_not_be_predicted_is_left_out():
    meter = NoiseMeter()
    for _ in range(100):
        meter.add(1.0, 0.3)
        meter.add(math.nan, 0.3)
    assert math.isnan(meter.times)


def test_asking_changes_nothing():
    """Of ranges 1.7 times as noisy as expected the answer depends on what was there before: nothing, or much more."""
    draw, asked, left = random.Random(4), NoiseMeter(), NoiseMeter()
    for k in range(600):
        for meter in (asked, left):
            draw.seed(k)
            meter.add(draw.gauss(0.0, 1.0 if k < 300 else 0.51), EXPECTED_M)
        for expected_m in (0.01, 0.3, 100.0):  # whatever somebody else expects
            asked.sigma(expected_m)
            assert asked.surely in (True, False)
    assert left.noisier and asked.noisier and asked.sigma(EXPECTED_M) == left.sigma(EXPECTED_M)


def test_noise_that_grows_and_shrinks_as_expected_is_none():
    """A levelled slant range: overhead four times the noise of the range itself, and each told so."""
    draw, meter = random.Random(5), NoiseMeter()
    for k in range(1000):
        expected_m = 0.3 * (1.0 + 3.0 * abs((k % 100) / 50.0 - 1.0))
        meter.add(draw.gauss(0.0, expected_m), expected_m)
        assert not meter.noisier


def test_it_is_sure_only_once_the_window_that_showed_it_is_over():
    draw, meter = random.Random(6), NoiseMeter()
    first = sure = 0
    for k in range(1000):
        meter.add(draw.gauss(0.0, 0.9), EXPECTED_M)
        first, sure = first or k * meter.noisier, sure or k * meter.surely
    assert ENOUGH <= first < ENOUGH + 10 and sure == first + WINDOW
