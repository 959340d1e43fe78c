"""The note about a machine that is too slow for its demo, from invented records whose times are known."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from circumnav_mav.config import Config
from circumnav_mav.guidance.phases import Phase
from circumnav_mav.mavlink.vehicles.fitness import Unfit
from circumnav_mav.runtime.app import FIT_WITHIN, App, Options
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.runtime.session import behind_note


def record(app_s: float, stub_s: float, started_s: float = 12.0):
    """Return ticks and truth of a stub that was heard started_s into the app's run and flew stub_s in app_s."""
    count = int(app_s + started_s)
    ticks = {
        "t_s": [f"{float(n)}" for n in range(count + 1)],
        "phase": ["waiting_autopilot" if n < started_s else "orbiting" for n in range(count + 1)],
    }
    return ticks, {"t_s": [f"{stub_s * n / 100:.5f}" for n in range(101)]}


@pytest.mark.parametrize(("stub_s", "percent"), [(190.0, "5 %"), (100.0, "50 %")])
def test_a_stub_that_fell_behind_is_a_note(stub_s, percent):
    note = behind_note(*record(200.0, stub_s), speed=10.0)
    assert note.startswith("this machine cannot keep up with 10 x real time") and "try a lower --speed" in note
    assert percent in note


@pytest.mark.parametrize("stub_s", [196.0, 200.0, 203.0])
def test_a_stub_that_kept_up_is_none(stub_s):
    assert behind_note(*record(200.0, stub_s), speed=10.0) == ""


def test_no_flight_is_no_note():
    ticks, truth = record(200.0, 100.0)
    assert behind_note({}, truth, speed=1.0) == ""
    assert behind_note(ticks, None, speed=1.0) == ""
    assert behind_note(ticks, {"t_s": []}, speed=1.0) == ""
    silent = {"t_s": ticks["t_s"], "phase": ["waiting_autopilot"] * len(ticks["t_s"])}
    assert behind_note(silent, truth, speed=1.0) == ""


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
