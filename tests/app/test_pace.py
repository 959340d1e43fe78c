"""One clock for two processes: both ends of a pace file, on a wall clock that the test turns."""

from __future__ import annotations

import math
import time

import pytest

from circumnav_mav.runtime import pace as app_end
from circumnav_mav.runtime.pace import PacedClock
from circumnav_mav.runtime.watchdog import WITHIN_S
from sitl_stub import pace as stub_end
from sitl_stub.pace import Pace

SPEED = 5.0


class Wall:
    """A wall clock, and two processes that look at it unless they are held up."""

    def __init__(self, monkeypatch, path):
        self.s = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.s)
        self.clock = PacedClock(SPEED, path)
        self.pace = Pace(path)
        self.vehicle_s = self._vehicle_wall_s = 0.0
        self.ahead_s: list[float] = []  # app minus vehicle, after every round in which both ran

    def run(self, wall_s, app=True, vehicle=True, step_s=0.002):
        for _ in range(round(wall_s / step_s)):
            self.s += step_s
            if vehicle:
                limit_s = self.pace.limit_s(self.vehicle_s, self.s)
                self.vehicle_s = max(self.vehicle_s, min(self.vehicle_s + step_s * SPEED, limit_s))
            if app:
                self.app_s = self.clock.now()
            if app and vehicle:
                self.ahead_s.append(self.app_s - self.vehicle_s)


@pytest.fixture
def wall(monkeypatch, tmp_path):
    return Wall(monkeypatch, tmp_path / "pace")


def test_the_watchdog_is_more_patient_than_the_clock():
    assert app_end.HOLD_S < WITHIN_S


def test_neither_waits_while_both_run(wall):
    wall.run(0.3, vehicle=False)  # the vehicle's process is starting
    wall.run(10.0)
    assert wall.clock.held_s == pytest.approx(0.0, abs=1e-9)
    assert wall.vehicle_s == pytest.approx(10.0 * SPEED) and wall.app_s == pytest.approx(10.3 * SPEED)


def test_the_vehicle_waits_for_an_app_that_is_held_up(wall):
    wall.run(1.0)
    app_s, vehicle_s = wall.app_s, wall.vehicle_s
    wall.run(0.8, app=False)
    assert wall.vehicle_s - vehicle_s <= 2 * stub_end.LEAD_S
    wall.run(0.002)
    assert wall.app_s - app_s <= 3 * stub_end.LEAD_S  # no lag that the flight would see as one
    assert wall.clock.held_s == pytest.approx(0.8, abs=0.1)


def test_the_app_waits_for_a_vehicle_that_is_held_up(wall):
    wall.run(1.0)
    app_s, before_s = wall.app_s, wall.ahead_s[-1]
    wall.run(0.8, vehicle=False)
    assert wall.app_s - app_s <= 2 * app_end.LEAD_S
    wall.run(5.0)
    assert abs(wall.ahead_s[-1] - before_s) <= 2 * app_end.LEAD_S
    assert wall.app_s - app_s == pytest.approx(5.0 * SPEED, abs=0.2)


@pytest.mark.parametrize(("held", "patience_s"), [("app", stub_end.HOLD_S), ("vehicle", app_end.HOLD_S)])
def test_who_stands_still_for_long_is_given_up_and_met_again(wall, held, patience_s):
    wall.run(1.0)
    start_s = {"app": wall.vehicle_s, "vehicle": wall.app_s}[held]
    wall.run(7.0, **{held: False})
    other_s = {"app": wall.vehicle_s, "vehicle": wall.app_s}[held]
    assert other_s - start_s == pytest.approx((7.0 - patience_s) * SPEED, abs=0.5)
    wall.run(5.0)
    assert max(wall.ahead_s[-100:]) - min(wall.ahead_s[-100:]) <= 2 * app_end.LEAD_S
    assert wall.vehicle_s > other_s if held == "app" else wall.app_s > other_s + 4.0 * SPEED


@pytest.mark.parametrize("first", ["app", "vehicle"])
def test_a_machine_that_stands_still_holds_both_up_and_neither_is_given_up(wall, first):
    """Both find the wall clock far ahead; who is back first sees the other where it was, and that proves nothing."""
    wall.run(1.0)
    app_s, vehicle_s = wall.app_s, wall.vehicle_s
    for _ in range(5):
        wall.s += 2.0 * max(app_end.HOLD_S, stub_end.HOLD_S)
        wall.run(0.01, app=first == "app", vehicle=first == "vehicle")
        wall.run(0.1)
    assert wall.app_s - app_s <= 5 * (0.11 * SPEED + 2 * app_end.LEAD_S)
    assert wall.vehicle_s - vehicle_s <= 5 * (0.11 * SPEED + 2 * stub_end.LEAD_S)
    assert max(wall.ahead_s) - min(wall.ahead_s) <= 2 * app_end.LEAD_S


def test_an_app_that_was_frozen_finds_the_time_that_the_vehicle_flew_without_it(wall):
    wall.run(1.0)
    app_s = wall.app_s
    wall.run(stub_end.HOLD_S + 2.0, app=False)
    wall.run(0.01)
    assert wall.app_s - app_s > 1.8 * SPEED  # its own rules for a late loop must see it


def test_a_file_that_is_no_pace_file_is_one_line(tmp_path):
    (tmp_path / "pace").write_bytes(b"12345")
    with pytest.raises(ValueError, match="no pace file: it must hold 16 bytes"):
        Pace(tmp_path / "pace")


def test_a_vehicle_alone_is_held_by_nobody(tmp_path):
    PacedClock(SPEED, tmp_path / "pace")
    assert Pace(tmp_path / "pace").limit_s(0.0, 1.0) == math.inf
