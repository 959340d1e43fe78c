import math
import random

import pytest

from circumnav_mav.guidance.estimators.gate import (
    AGREE,
    AGREE_S,
    LONGER_S,
    SHELF_S,
    compared,
    refuse,
    remember,
    restarted,
    shelved,
)
from circumnav_mav.guidance.kernel import ACCEPTED, OUTLIER, RESTARTED, RETURNED, Memory

RATES_HZ = [0.5, 1.0, 2.0, 10.0, 50.0, 200.0]


OLD = Memory(known=1.0, stood_s=LONGER_S)
"""The memory of a belief that has stood for long."""


def readings_wanted(mem, rate_hz, error):
    """How many readings that agree, and nothing between them, end the belief."""
    n = 0
    while mem.verdict != RESTARTED:
        mem = refuse(mem, 100.0, 1.0 / rate_hz, 10.0, 2.0, error)
        n += 1
        assert n < 10_000
    assert mem.votes == mem.stood_s == 0.0
    return n


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize(("error", "wanted_s"), [(-9.0, AGREE_S), (9.0, LONGER_S), (math.nan, AGREE_S)])
def test_readings_that_agree_win_after_seconds_or_for_a_slow_radio_after_a_few(rate_hz, error, wanted_s):
    assert readings_wanted(OLD, rate_hz, error) == max(AGREE, round(wanted_s * rate_hz))


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("stood_s", [0.0, 0.7, 1.5, 3.0])
def test_a_young_belief_falls_to_as_much_as_it_has_behind_it(rate_hz, stood_s):
    mem = Memory(known=1.0)
    for _ in range(round(stood_s * rate_hz)):
        mem = remember(mem, 1.0 / rate_hz, 1.0, 1.0, 1.0)
    for error, most_s in ((-9.0, AGREE_S), (9.0, LONGER_S)):
        wanted = math.ceil(min(mem.stood_s, most_s) * rate_hz - 1e-6)
        assert readings_wanted(mem, rate_hz, error) == max(AGREE, wanted)


def test_after_a_dropout_one_reading_is_one_reading():
    first = refuse(OLD, 100.0, 15.0, 10.0, 2.0, -9.0)
    assert first.votes == 1.0 / AGREE
    again = remember(Memory(known=1.0), 15.0, 1.0, 1.0, 1.0)
    assert again.stood_s == LONGER_S / AGREE


def test_readings_that_disagree_do_not():
    draw = random.Random(2)
    mem = Memory(known=1.0)
    for _ in range(500):
        mem = refuse(mem, 100.0 + draw.expovariate(1.0 / 40.0), 0.1, 10.0, 0.5)
        assert mem.verdict == OUTLIER


def test_good_readings_speak_against_the_rival():
    mem = Memory(known=1.0)
    for _ in range(200):
        for r in (90.0, 90.0):
            mem = refuse(mem, r, 0.1, 1.0, 1.0)
            assert mem.verdict == OUTLIER
        for _ in range(3):
            mem = remember(mem, 0.1, 1.0, 1.0, 1.0)
            assert mem.verdict == ACCEPTED


def test_a_good_reading_outweighs_an_echo_of_its_length():
    mem = OLD
    for _ in range(500):
        mem = refuse(mem, 140.0, 0.1, 10.0, 2.0, 40.0)
        assert mem.verdict == OUTLIER
        mem = remember(mem, 0.1, 1.0, 1.0, 1.0)
    assert mem.votes == 0.0


def test_a_rival_may_move_as_fast_as_a_vehicle_closes_but_no_faster():
    slow = fast = Memory(known=1.0)
    for n in range(int(AGREE)):
        slow = refuse(slow, 200.0 - 9.0 * n, 1.0, 10.0, 0.1)
        fast = refuse(fast, 200.0 - 30.0 * n, 1.0, 10.0, 0.1)
    assert slow.verdict == RESTARTED
    assert fast.verdict == OUTLIER
    assert math.isnan(slow.rival_r)


def shelf(mem, flown_error, error, dt=0.1, nis=1.0):
    """The memory after a reading: both beliefs missed it by so much; noise of 1 m and a gate of 4."""
    return compared(remember(mem, dt, 1.0, 1.0, 1.0, flown_error), mem, dt, error, nis, 4.0, 8.0)


def test_a_shelved_belief_comes_back_when_the_ranges_are_where_it_expects_them():
    mem, n = shelved(Memory(known=1.0), 0.0, 0.0), 0
    while mem.verdict != RETURNED:
        mem, n = shelf(mem, -40.0, 0.5), n + 1
        assert n < 100
    assert 0.5 <= 0.1 * n <= 1.0 and math.isnan(mem.shelf_s)


@pytest.mark.parametrize(
    ("flown_error", "error", "nis"), [(0.5, -40.0, 99.0), (-40.0, -40.0, 99.0), (0.5, 0.4, 1.0), (-40.0, -25.0, 1.0)]
)
def test_a_shelved_belief_that_is_no_better_waits_and_is_given_up(flown_error, error, nis):
    mem, n = shelved(Memory(known=1.0), 0.0, 0.0), 0
    while not math.isnan(mem.shelf_s):
        mem, n = shelf(mem, flown_error, error, nis=nis), n + 1
        assert mem.verdict == ACCEPTED and n < 1000
    assert 0.1 * n == pytest.approx(SHELF_S, abs=0.2)


def test_a_shelved_belief_that_fits_comes_back_when_the_flown_one_falls():
    before = shelved(Memory(known=1.0), 3.0, 0.0)
    fallen = restarted(before, math.nan, 0.0)
    assert compared(fallen, before, 0.1, 2.0, 1.0, 4.0, 8.0).verdict == RETURNED
    assert compared(fallen, before, 0.1, 30.0, 99.0, 4.0, 8.0).verdict == RESTARTED


def test_readings_that_fit_the_new_belief_alone_speak_against_the_shelved_one():
    mem = shelved(Memory(known=1.0), 0.0, 0.0)
    for n in range(150):
        mem = shelf(mem, *((-40.0, 0.5) if n % 3 == 0 else (0.5, 40.0)))
        assert mem.verdict == ACCEPTED
