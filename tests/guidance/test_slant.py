import math
import random

import pytest

from circumnav_mav.guidance.slant import level

NAN = math.nan


def test_levels_a_flight_in_space():
    draw = random.Random(3)
    for _ in range(50):
        p = [draw.uniform(-100, 100), draw.uniform(-100, 100), draw.uniform(-40, 60)]
        v = [draw.uniform(-10, 10) for _ in range(3)]
        R = math.dist(p, (0, 0, 0))
        r = math.hypot(*p[:2])
        if r < 0.3 * R:
            continue
        flat = level(R, sum(a * b for a, b in zip(p, v, strict=True)) / R, 1.0, p[2], v[2], 0.5)
        assert flat.r == pytest.approx(r)
        assert flat.r_dot == pytest.approx((p[0] * v[0] + p[1] * v[1]) / r)
        assert not flat.overhead


def test_the_standard_deviation_is_that_of_many_draws():
    draw = random.Random(5)
    R, h = 50.0, 30.0
    many = [level(draw.gauss(R, 0.5), NAN, NAN, draw.gauss(h, 0.8), NAN, 0.0).r for _ in range(4000)]
    mean = sum(many) / len(many)
    sigma = math.sqrt(sum((r - mean) ** 2 for r in many) / len(many))
    assert level(R, NAN, 0.5, h, NAN, 0.8).sigma_r == pytest.approx(sigma, rel=0.06)


@pytest.mark.parametrize(("R", "h"), [(30.0, 30.0), (29.0, 30.0), (30.5, 30.0), (10.0, -9.99)])
def test_near_overhead_is_said(R, h):
    flat = level(R, 0.0, 0.3, h, 0.0, 0.3)
    assert flat.overhead
    assert math.isnan(flat.r)


def test_without_a_height_the_range_is_taken_as_it_is():
    assert level(80.0, -2.0, 0.3, NAN, NAN, NAN) == (80.0, -2.0, 0.3, False)


def test_without_a_rate_the_rate_stays_unknown():
    assert math.isnan(level(80.0, NAN, 0.3, 20.0, 1.0, 0.5).r_dot)
