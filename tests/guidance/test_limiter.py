import math

import pytest

from circumnav_mav.guidance.limiter import TurnRateLimiter


def test_saturates_both_ways_and_says_so():
    limiter = TurnRateLimiter(0.5, math.inf)
    assert limiter.limit(0.0, 0.7) == limiter.limit(1.0, 0.7)
    assert limiter.limit(2.0, -0.7).turn_rate_rad_s == -0.5
    assert limiter.limit(3.0, -0.7).saturated
    inside = limiter.limit(4.0, 0.4)
    assert (inside.turn_rate_rad_s, inside.saturated, inside.slewed) == (0.4, False, False)


def test_slews_towards_the_command_at_the_turn_acceleration():
    limiter = TurnRateLimiter(1.0, 2.0)
    limiter.limit(10.0, 0.0)
    rates = [limiter.limit(10.0 + 0.1 * n, 0.5) for n in (1, 2, 3)]
    assert [x.turn_rate_rad_s for x in rates] == pytest.approx([0.2, 0.4, 0.5])
    assert [x.slewed for x in rates] == [True, True, False]


def test_the_first_command_after_a_reset_is_not_slewed():
    limiter = TurnRateLimiter(1.0, 2.0)
    limiter.limit(0.0, -1.0)
    limiter.reset()
    assert limiter.limit(0.02, 1.0).turn_rate_rad_s == 1.0


@pytest.mark.parametrize("limits", [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0)])
def test_refuses_limits_that_are_not_positive(limits):
    with pytest.raises(ValueError, match="must be above 0"):
        TurnRateLimiter(*limits)
