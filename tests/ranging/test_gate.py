"""The gate as a table: one row a reason, at its very edge."""

from __future__ import annotations

import math
import random

import pytest

from circumnav_mav.ranging.gate import Gate, Limits
from circumnav_mav.ranging.plug import Reading
from circumnav_mav.types import RangeSample

NAN, INF = math.nan, math.inf
LIMITS = Limits(max_age_s=1.0, min_m=2.0, max_m=500.0, min_quality_pct=30.0, stuck_s=2.0)


def judge(gate, now_s, *, range_m=50.0, t_s=None, bias_m=0.0, rate=NAN, moving=True, **reading):
    sample = RangeSample(now_s if t_s is None else t_s, range_m - bias_m, rate)
    rejected = gate.judge(Reading(range_m=range_m, range_rate_m_s=rate, **reading), sample, now_s, moving=moving)
    return None if rejected is None else str(rejected.reason)


ROWS = [
    ({}, None),
    ({"range_m": 2.0}, None),
    ({"range_m": 1.999}, "out_of_range"),
    ({"range_m": 500.0}, None),
    ({"range_m": 500.001}, "out_of_range"),
    ({"range_m": -50.0}, "out_of_range"),
    ({"range_m": NAN}, "not_finite"),
    ({"range_m": INF}, "not_finite"),
    ({"rate": INF}, "not_finite"),
    ({"rate": -3.0}, None),
    ({"least_m": 50.0, "most_m": 50.0}, None),
    ({"least_m": 50.1}, "out_of_range"),
    ({"most_m": 49.9}, "out_of_range"),
    ({"range_m": 3.0, "bias_m": 1.5, "least_m": 2.5}, "out_of_range"),
    ({"range_m": 4.0, "bias_m": 1.5, "most_m": 4.0}, None),
    ({"quality_pct": 0.0}, "invalid_quality"),
    ({"quality_pct": 29.0}, "invalid_quality"),
    ({"quality_pct": 30.0}, None),
    ({"t_s": 9.0}, None),
    ({"t_s": 8.99}, "stale"),
    ({"t_s": NAN}, "stale"),
]


@pytest.mark.parametrize(("reading", "reason"), ROWS)
def test_row(reading, reason):
    assert judge(Gate(LIMITS), 10.0, **reading) == reason


@pytest.mark.parametrize("absurd_m", [655.37, 1e5, 1e30, 9.96921e36, 1.7e308])
def test_a_number_that_no_such_sensor_measures_is_no_range_unless_max_m_says_so(absurd_m):
    assert judge(Gate(Limits(most_m=655.36)), 10.0, range_m=absurd_m) == "out_of_range"
    assert judge(Gate(Limits(most_m=655.36, max_m=absurd_m)), 10.0, range_m=absurd_m) is None


@pytest.mark.parametrize(("rate", "reason"), [(1e30, "out_of_range"), (-1000.1, "out_of_range"), (-1000.0, None)])
def test_a_rate_that_nothing_flies(rate, reason):
    assert judge(Gate(Limits(most_m=655.36)), 10.0, rate=rate) == reason


def test_no_limits_means_none():
    gate = Gate(Limits())
    assert judge(gate, 10.0, range_m=0.001) is None
    assert judge(gate, 10.1, range_m=1e6, quality_pct=0.5) is None


def test_time_may_stand_but_not_go_back():
    gate = Gate(LIMITS)
    assert judge(gate, 10.0, t_s=9.9) is None
    assert judge(gate, 10.0, t_s=9.9, range_m=50.1) is None
    assert judge(gate, 10.1, t_s=9.89) == "time_backwards"
    assert judge(gate, 10.1, t_s=9.91) is None


def test_a_rejected_sample_does_not_move_time():
    gate = Gate(LIMITS)
    assert judge(gate, 10.0, t_s=10.0, range_m=1000.0) == "out_of_range"
    assert judge(gate, 10.1, t_s=9.9) is None


def test_without_stamp_and_sequence_the_same_range_twice_is_two_measurements():
    gate = Gate(Limits())
    assert [judge(gate, 10.0 + 0.1 * n) for n in range(3)] == [None] * 3


@pytest.mark.parametrize("identity", [{"stamp_s": 5.0}, {"sequence": 7}, {"stamp_s": 5.0, "sequence": 7}])
def test_the_same_measurement_twice_is_a_duplicate(identity):
    gate = Gate(Limits())
    assert judge(gate, 10.0, **identity) is None
    assert judge(gate, 10.1, **identity) == "duplicate"
    assert judge(gate, 10.2, range_m=50.1, **identity) is None


def test_stuck_needs_time_and_repeats_and_ends_with_a_change():
    slow = Gate(LIMITS)
    assert [judge(slow, 10.0 + n) for n in range(7)] == [None] * 5 + ["stuck"] * 2
    quick = Gate(LIMITS)
    assert {judge(quick, 10.0 + 0.01 * n) for n in range(200)} == {None}
    assert judge(quick, 12.01) == "stuck"
    assert judge(quick, 12.02, range_m=50.001) is None


def test_stuck_is_not_judged_at_rest():
    gate = Gate(LIMITS)
    assert {judge(gate, 10.0 + 0.1 * n, moving=False) for n in range(100)} == {None}
    assert judge(gate, 20.1) is None
    assert judge(gate, 23.0) is None


def test_what_is_stuck_stays_so_at_rest_until_the_value_changes():
    gate = Gate(LIMITS)
    assert [judge(gate, 10.0 + 0.5 * n) for n in range(7)][-2:] == ["stuck"] * 2
    assert {judge(gate, 14.0 + 0.5 * n, moving=False) for n in range(100)} == {"stuck"}
    assert judge(gate, 64.0, range_m=50.01, moving=False) is None
    assert {judge(gate, 64.5 + 0.5 * n, range_m=50.01, moving=False) for n in range(20)} == {None}


def by_itself():
    """Return a gate that is told nothing of values that stand."""
    return Gate(Limits())


def stuck_after_s(gate, start_s, range_m, period_s=0.1):
    """Return how long a value that never changes again is believed, s."""
    for n in range(2000):
        if judge(gate, start_s + n * period_s, range_m=range_m) == "stuck":
            return n * period_s
    return INF


@pytest.mark.parametrize("sigma_m", [0.02, 0.1, 0.3, 2.0])
def test_a_radio_whose_noise_is_seen_in_its_steps_is_stuck_after_three_seconds(sigma_m):
    gate, draw = by_itself(), random.Random(f"stuck {sigma_m}")
    for n in range(600):
        assert judge(gate, 10.0 + 0.1 * n, range_m=round(draw.gauss(50.0, sigma_m), 2)) is None
    assert 3.0 < stuck_after_s(gate, 70.0, 51.0) < 8.0


@pytest.mark.parametrize("step_m", [0.001, 0.01, 0.1, 1.0])
def test_a_noiseless_range_that_stops_in_the_approach_is_stuck_after_three_seconds(step_m):
    gate, last = by_itself(), NAN
    for n in range(300):  # 20 m/s
        assert judge(gate, 10.0 + 0.1 * n, range_m=(last := step_m * round((900.0 - 2.0 * n) / step_m))) is None
    assert stuck_after_s(gate, 40.0, last) == pytest.approx(3.0, abs=0.11)


@pytest.mark.parametrize("settling_s", [6.0, 12.0, 24.0, 40.0])
@pytest.mark.parametrize("step_m", [0.001, 0.01, 0.1, 1.0])
def test_a_noiseless_range_may_come_to_rest_on_the_circle(step_m, settling_s):
    """r = 50 + 100 exp(-t / T) in steps: the last value never changes. It is borne for a minute, and not for ever."""
    gate, rested_s = by_itself(), settling_s * math.log(100.0 / (0.5 * step_m))
    for n in range(int((rested_s + 55.0) * 10.0)):
        t_s = 0.1 * n
        range_m = step_m * round((50.0 + 100.0 * math.exp(-t_s / settling_s)) / step_m)
        assert judge(gate, 10.0 + t_s, range_m=range_m) is None
    assert stuck_after_s(gate, 10.0 + rested_s + 55.0, 50.0) < 10.0


def test_a_value_that_was_stuck_teaches_nothing():
    gate = by_itself()
    for start_s in (10.0, 100.0):
        for n in range(10):
            assert judge(gate, start_s + 0.1 * n, range_m=80.0 - 0.5 * n) is None
        assert stuck_after_s(gate, start_s + 1.0, 10.0) == pytest.approx(3.1)
        assert {judge(gate, start_s + 4.2 + 0.1 * n, range_m=10.0) for n in range(500)} == {"stuck"}


def test_a_value_that_is_sent_again_and_again_is_stuck_after_ten_times_as_long():
    gate = by_itself()
    for n in range(400):  # one measurement in half a second, sent ten times
        assert judge(gate, 10.0 + 0.05 * n, range_m=200.0 - 2.5 * (n // 10)) is None
    assert stuck_after_s(gate, 30.0, 10.0, 0.05) == pytest.approx(5.05)
