"""The phase table, walked row by row, and the properties that every path through it must keep."""

from __future__ import annotations

import itertools

import pytest

from circumnav_mav.guidance.phases import ENGAGED, TABLE, Facts, Phase, step

GOOD = Facts(heard=True, held=True, fresh=True, coastable=True)
WAITING = Facts(heard=True, fresh=True, coastable=True)

WALK = [
    # (from, facts, to)
    (Phase.ACQUIRING, GOOD._replace(released=True, held=False), Phase.RELEASED),
    (Phase.ORBITING, GOOD._replace(held=False, ending=True), Phase.FINISHED),
    (Phase.RELEASED, WAITING, Phase.WAITING_AUTOPILOT),
    (Phase.ORBITING, GOOD._replace(heard=False), Phase.WAITING_AUTOPILOT),
    (Phase.WAITING_AUTOPILOT, WAITING, Phase.WAITING_RANGE),
    (Phase.ORBITING, GOOD._replace(broken=True), Phase.BROKEN_OFF),
    (Phase.BROKEN_OFF, WAITING._replace(broken=True), Phase.WAITING_RANGE),
    (Phase.WAITING_RANGE, GOOD._replace(fresh=False, coastable=False), Phase.RANGE_LOST),
    (Phase.READY, GOOD, Phase.ACQUIRING),
    (Phase.WAITING_RANGE, WAITING, Phase.READY),
    (Phase.READY, WAITING._replace(fresh=False), Phase.WAITING_RANGE),
    (Phase.ACQUIRING, GOOD._replace(fresh=False, coastable=False), Phase.RANGE_LOST),
    (Phase.ORBITING, GOOD._replace(fresh=False), Phase.COASTING),
    (Phase.COASTING, GOOD, Phase.ACQUIRING),
    (Phase.COASTING, GOOD._replace(fresh=False, coastable=False), Phase.RANGE_LOST),
    (Phase.ACQUIRING, GOOD._replace(settled=True), Phase.ORBITING),
    (Phase.ORBITING, GOOD._replace(strayed=True), Phase.ACQUIRING),
    (Phase.RANGE_LOST, WAITING, Phase.READY),
    (Phase.RANGE_LOST, GOOD, Phase.ACQUIRING),
]


@pytest.mark.parametrize(("row", "walk"), list(zip(TABLE, WALK, strict=True)), ids=[r.reason for r in TABLE])
def test_every_row_is_walked_by_its_own_case(row, walk):
    phase, facts, to = walk
    assert phase in row.leave and row.when(facts), "the case does not reach its row"
    change = step(phase, facts, "why")
    assert change is not None
    assert change[0] is to
    assert change[1] == row.reason.format(why="why"), "an earlier row took the case"


EVERY = [Facts(*bits) for bits in itertools.product((False, True), repeat=len(Facts._fields))]


def test_released_is_left_only_by_the_latch_or_the_end():
    for facts in EVERY:
        change = step(Phase.RELEASED, facts, "")
        if change is not None:
            assert not facts.released or facts.ending


def test_finished_is_for_good():
    assert all(step(Phase.FINISHED, facts, "") is None for facts in EVERY)


def test_nothing_engages_while_not_held():
    for phase, facts in itertools.product(Phase, EVERY):
        change = step(phase, facts, "")
        if change is not None and change[0] in ENGAGED and phase not in ENGAGED:
            assert facts.held and not facts.released


def test_a_range_that_comes_back_during_the_hand_over_does_not_stop_it():
    for facts in EVERY:
        change = step(Phase.RANGE_LOST, facts, "")
        if facts.handing_over and change is not None:
            assert change[0] not in ENGAGED | {Phase.BROKEN_OFF}


def test_range_lost_is_no_dead_end_for_a_pilot_who_engages_again():
    again = GOOD._replace(fresh=False, coastable=False)
    assert step(Phase.RANGE_LOST, again, "") is None, "given back again, by the flight"
    assert step(Phase.RANGE_LOST, again._replace(broken=True), "")[0] is Phase.BROKEN_OFF
    assert step(Phase.RANGE_LOST, GOOD._replace(broken=True), "")[0] is Phase.BROKEN_OFF
    assert step(Phase.RANGE_LOST, GOOD, "")[0] is Phase.ACQUIRING


def test_an_engaged_phase_never_outlives_a_release():
    for phase, facts in itertools.product(ENGAGED, EVERY):
        if facts.released:
            change = step(phase, facts, "")
            assert change is not None and change[0] in (Phase.RELEASED, Phase.FINISHED)


def test_orbiting_never_flies_on_without_a_range_it_can_carry():
    for phase, facts in itertools.product(ENGAGED, EVERY):
        if not facts.fresh and not facts.coastable:
            change = step(phase, facts, "")
            assert change is not None
            assert change[0] not in ENGAGED
