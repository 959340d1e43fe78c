"""The numbers of docs/paper_study.md: how they are read off the runs."""

import math

import numpy as np
import pytest

from circumnav_mav.study import paper_claims
from circumnav_mav.study.paper_run import Plant


def test_a_valley_is_told_by_its_span_and_not_by_its_lowest_point():
    gains = np.linspace(1.0, 5.0, 401)
    least, low, high, double = paper_claims.valley(gains, 1.0 + 0.5 * (gains - 3.0) ** 2)
    assert (least, low, high) == pytest.approx((1.0, 2.8, 3.2), abs=0.011)
    assert double == pytest.approx(3.0 + math.sqrt(2.0), abs=0.011)


def test_gains_are_flown_in_the_same_noise():
    """Gains 0.1 % apart give errors as near to each other; in noise of their own they would differ by some 3 %."""
    errors = paper_claims.errors_in_one_noise([0.5, 0.5005, 0.5], Plant(), runs=60)
    assert errors[0] == errors[2]
    assert errors[1] == pytest.approx(errors[0], rel=5e-3)
