"""A simulator that stands still for a moment, or runs slower than our clock: it is circled on, and that is said."""

from __future__ import annotations

import pytest

from tests.lockstep import Rig, airborne, config


class SlowRig(Rig):
    """The vehicle's time runs at `rate` of the app's, and stands still once for `pause_s`."""

    rate = 1.0
    pause_s = 0.0

    def step(self):
        if self.pause_s > 0.0:
            self.pause_s -= self.tick_s
            self._vehicle_zero_s += self.tick_s
        else:
            self._vehicle_zero_s += (1.0 - self.rate) * self.tick_s
        return super().step()


def flown(rate: float, pause_s: float) -> SlowRig:
    rig = SlowRig(config(), airborne(80.0, seed=3, height_m=40.0)).engage()
    rig.rate = rate
    rig.run(10.0)
    rig.pause_s = pause_s
    rig.run(90.0)
    return rig


def clock_words(rig: Rig) -> list[str]:
    return [event.text for event in rig.flight.events if "device's clock" in event.text]


@pytest.mark.parametrize("rate", [0.95, 0.98])
def test_a_slow_simulator_is_circled_on_and_said_once(rate):
    rig = flown(rate, 0.0)
    assert rig.log.ticks[-1].phase == "orbiting"
    assert rig.flight.ranges.counts.rejected.get("stale", 0) == 0
    assert len(clock_words(rig)) == 1
    assert rig.log.furthest_m(20.0) < 3.0


def test_a_simulator_that_paused_is_circled_on():
    rig = flown(1.0, 1.5)
    assert "range_lost" not in rig.log.phases
    assert rig.log.ticks[-1].phase == "orbiting"
    assert rig.flight.ranges.counts.rejected.get("stale", 0) <= 20
    assert len(clock_words(rig)) == 1


def test_a_clock_too_slow_to_be_followed_is_said_with_what_to_do():
    rig = flown(0.85, 0.0)
    assert len(words := clock_words(rig)) == 1
    assert "at 0.85 of ours" in words[0] and "ranging.use_stamps: false" in words[0]


def test_without_stamps_it_is_circled_on():
    rig = SlowRig(config(ranging={"use_stamps": False}), airborne(80.0, seed=3, height_m=40.0)).engage()
    rig.rate = 0.85
    rig.run(100.0)
    assert rig.log.ticks[-1].phase == "orbiting"
    assert rig.log.furthest_m(20.0) < 3.0
