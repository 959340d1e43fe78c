"""The end of a run: what is told about a machine too slow for its demo, and what was not heard in time."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from circumnav_mav.config import Config
from circumnav_mav.flight import VEHICLE
from circumnav_mav.flight_record import TickRecord
from circumnav_mav.guidance.phases import Phase
from circumnav_mav.mavlink.vehicles.fitness import Unfit
from circumnav_mav.runtime.app import FIT_WITHIN, App, Options
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.runtime.session import held_note


@pytest.mark.parametrize(("held_s", "percent"), [(10.0, "20 %"), (40.0, "50 %")])
def test_a_clock_that_stood_still_is_a_note(held_s, percent):
    note = held_note(held_s, 200.0, speed=5.0)
    assert note.startswith("this machine does not keep up with 5 x real time") and percent in note


@pytest.mark.parametrize("held_s", [0.0, 4.0])
def test_a_clock_that_hardly_did_is_none(held_s):
    assert held_note(held_s, 200.0, speed=5.0) == ""


class Hands(Clock):
    """A clock whose time the test sets."""

    s = 0.0

    def now(self) -> float:
        return self.s


@pytest.mark.parametrize(("held_s", "leaves"), [(0.1, True), (0.6, False)])
def test_a_tick_that_is_held_up_before_it_sends_sends_nothing_old(held_s, leaves):
    """A machine may stand still there, too, with no signal: the autopilot may fly on its own when it is back."""
    sent: list[bytes] = []
    recorded: list[TickRecord] = []
    clock, ignore = Hands(), lambda *_: None
    quiet = SimpleNamespace(frame=ignore, tick=recorded.append, event=ignore, show=ignore)
    app = App(Config(), clock, quiet, quiet, Options())
    app._links[VEHICLE] = SimpleNamespace(send=sent.append, drain=lambda: 0, send_errors=0)
    decide = app.flight.tick

    def held_up(*arguments):
        frames, record = decide(*arguments)
        clock.s += held_s
        return frames, record._replace(turn_rate_sent_rad_s=0.2)

    for clock.s in (0.0, 0.4, 0.8):
        app._tick(clock.s, 0.0, 0)
    assert len(sent) == 1, "a heartbeat, once a second"
    clock.s, app.flight.tick = 1.2, held_up
    app._tick(clock.s, 0.0, 0)
    assert len(sent) == (2 if leaves else 1)
    assert (recorded[-1].turn_rate_sent_rad_s == 0.2) == leaves, "the record says what left"


def waiting() -> App:
    return App(Config(), Clock(), SimpleNamespace(), SimpleNamespace(), Options(wait_s=60.0))


def test_what_was_not_heard_in_time_ends_the_run():
    assert waiting()._find_verdict(59.0, Phase.WAITING_RANGE) is None
    assert waiting()._find_verdict(60.0, Phase.WAITING_AUTOPILOT)[0] == "no_autopilot"
    assert waiting()._find_verdict(60.0, Phase.WAITING_RANGE)[0] == "no_range"


def test_once_all_was_heard_a_gap_before_engaging_does_not_end_the_run():
    app = waiting()
    app._find_verdict(10.0, Phase.READY)
    assert app._find_verdict(70.0, Phase.WAITING_RANGE) is None
    assert app._find_verdict(80.0, Phase.WAITING_AUTOPILOT) is None


def test_an_estimator_may_settle_for_longer_than_an_autopilot_may_be_silent():
    app = waiting()
    app.flight.unfit = Unfit("no position yet")
    assert app._find_verdict(70.0, Phase.WAITING_AUTOPILOT) is None
    assert app._find_verdict(FIT_WITHIN * 60.0, Phase.WAITING_AUTOPILOT) == ("refused", "no position yet")
    app.flight.unfit = Unfit("a boat", final=True)
    assert app._find_verdict(60.0, Phase.WAITING_AUTOPILOT) == ("refused", "a boat")
