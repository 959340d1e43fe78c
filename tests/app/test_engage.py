"""`engage: auto`: it arms, takes off and asks, and leaves the vehicle to whoever acts on the way."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from circumnav_mav.mavlink.engage import AutoEngage, Step
from circumnav_mav.mavlink.vehicles.px4_fixed_wing import PX4_FIXED_WING
from sitl_stub import StubConfig
from tests.lockstep import Rig, config

ARM, TAKE_OFF, SET_MODE = 400, 22, 176
HOLD, POSITION, OFFBOARD, PX4_TAKEOFF = 0x03040000, 0x00030000, 0x00060000, 0x02040000


def grounded(**more) -> Rig:
    world = StubConfig(step_s=0.02, beacon_east_m=120.0, seed=4, **more)
    app = config(engage="auto", orbit={"height_m": 15.0}, ranging={"target_height_m": 0.0})
    return Rig(app, world)


def asked(rig: Rig, from_s: float = 0.0) -> list[int]:
    """Return the vehicle commands that the app gave, in order (streams and requests left out)."""
    commands = [m.command for _, m in rig.decoded(from_s) if m.get_type() == "COMMAND_LONG"]
    return [c for c in commands if c in (ARM, TAKE_OFF, SET_MODE)]


def climbing(height_m: float) -> Rig:
    rig = grounded()
    rig.run(40.0, until=lambda: rig.stub.truth().height_m > height_m)
    assert rig.stub.truth().mode == "AUTO/TAKEOFF"
    return rig


def test_it_arms_takes_off_asks_for_offboard_and_flies():
    rig = grounded()
    rig.run(120.0)
    assert asked(rig) == [ARM, TAKE_OFF, SET_MODE]
    assert rig.log.phases[-1] == "orbiting"
    assert rig.stub.truth().height_m == pytest.approx(15.0, abs=1.0)


def test_a_vehicle_that_a_pilot_has_flown_and_landed_is_never_armed():
    """No range at first; the pilot arms, flies, lands and disarms; then the beacon is heard."""
    rig = grounded(range_dropouts_s=((0.0, 70.0),))
    rig.run(3.0)
    rig.pilot.command(ARM, 1.0)
    rig.pilot.command(TAKE_OFF, 0, 0, 0, math.nan, math.nan, math.nan, 489.4 + 5.0)
    rig.run(15.0)
    assert rig.stub.truth().height_m > 3.0
    rig.pilot.mode(0x06040000)
    rig.run(45.0)
    assert not rig.stub.truth().armed
    rig.run(30.0)
    assert rig.log.ticks[-1].sample_age_s < 1.0, "the beacon was not heard: the test shows nothing"
    assert asked(rig) == []
    assert not rig.stub.truth().armed


@pytest.mark.parametrize("mode", [HOLD, POSITION])
def test_a_pilot_who_stops_the_take_off_keeps_the_vehicle(mode):
    rig = climbing(5.0)
    if mode == POSITION:
        rig.pilot.send(stick := manual(rig))
        rig.run(0.3)
        rig.pilot.send(stick)
    rig.pilot.mode(mode)
    rig.run(30.0)
    assert asked(rig) == [ARM, TAKE_OFF]
    assert rig.stub.truth().mode != "OFFBOARD"


def manual(rig: Rig):
    from pymavlink.dialects.v20 import all as mavlink

    return mavlink.MAVLink_manual_control_message(rig.stub.config.system_id, 0, 0, 500, 0, 0)


def test_ctrl_c_on_the_ground_gives_no_further_command():
    rig = grounded()
    rig.run(20.0, until=lambda: ARM in asked(rig))
    rig.flight.end("stopped by the operator")
    rig.run(10.0)
    assert asked(rig) == [ARM]


def test_ctrl_c_on_the_way_up_says_what_the_vehicle_goes_on_doing():
    rig = climbing(5.0)
    rig.flight.end("stopped by the operator")
    rig.run(1.0)
    assert rig.flight.done
    assert "goes on with its take-off" in rig.flight.left_behind
    assert asked(rig) == [ARM, TAKE_OFF]


def test_after_a_release_and_the_latch_it_is_the_pilot_who_engages():
    rig = grounded()
    rig.run(60.0, until=lambda: rig.stub.truth().mode == "OFFBOARD")
    rig.run(5.0)
    rig.pilot.mode(HOLD)
    rig.run(3.0)
    assert rig.log.ticks[-1].phase == "released"
    rig.pilot.command(31010, target=(rig.stub.config.system_id, 191))
    rig.run(3.0)
    assert rig.log.ticks[-1].phase == "ready"
    assert any("select Offboard" in event.text for event in rig.flight.events)
    count = len(asked(rig))
    rig.pilot.mode(OFFBOARD)
    rig.run(3.0)
    assert rig.log.ticks[-1].phase == "acquiring"
    assert len(asked(rig)) == count, "the app asked by itself"


class Climber:
    """What AutoEngage sees of an airplane that takes off: it overshoots, then sinks by meters before it flies level."""

    def __init__(self):
        self.custom_mode, self.armed, self.in_air, self.system_status = HOLD, False, False, 3
        self.amsl_m = self.height_m = self.climb_m_s = 0.0
        self.asked_s: list[float] = []
        self.autopilot = self.authority = self.commands = self
        self.words = SimpleNamespace(ours=OFFBOARD)
        self.accepted = {"arming", "take-off"}
        self.refused = False
        self.control = None
        self.rival = ""

    grounded = False

    def rival_words(self, now_s):
        return self.rival

    def height_above_home_m(self, now_s):
        return self.height_m

    def ask(self, now_s):
        self.asked_s.append(now_s)

    def push(self, *command, purpose):
        pass

    def clear(self):
        pass

    def failure(self, purpose):
        return None

    def fly(self, engage, top_m, sinks_to_m):
        """Climb at 3 m/s to the top in TAKEOFF, sink in HOLD to where it flies level."""
        for k in range(1, 3000):
            now_s = 0.1 * k
            if k > 5:
                self.armed = self.in_air = True
            if k > 10 and self.custom_mode == HOLD and not self.height_m:
                self.custom_mode = PX4_TAKEOFF
            if self.custom_mode == PX4_TAKEOFF:
                self.climb_m_s = 3.0
                self.custom_mode = HOLD if self.height_m >= top_m else PX4_TAKEOFF
            elif self.height_m:
                self.climb_m_s = -0.9 if self.height_m > sinks_to_m else 0.0
            self.height_m += 0.1 * self.climb_m_s
            engage.tick(now_s, ready=True, may_ask=True)


@pytest.mark.parametrize("height_m", [50.0, 80.0, 120.0])
def test_a_plane_that_sinks_after_its_take_off_is_engaged_all_the_same(height_m):
    plane = Climber()
    engage = AutoEngage(plane, PX4_FIXED_WING.take_off, height_m)
    plane.fly(engage, height_m, height_m - 6.6)
    assert len(plane.asked_s) == 1 and plane.climb_m_s == 0.0


def test_what_never_gets_to_the_height_is_not():
    plane = Climber()
    engage = AutoEngage(plane, PX4_FIXED_WING.take_off, 50.0)
    plane.fly(engage, 30.0, 30.0)
    assert plane.asked_s == [] and engage.step is Step.LEFT_TO_PILOT


def test_a_rival_that_is_heard_keeps_it_on_the_ground_and_from_asking():
    plane = Climber()
    engage = AutoEngage(plane, PX4_FIXED_WING.take_off, 50.0)
    plane.rival = "another program on the link"
    for k in range(100):
        engage.tick(0.1 * k, ready=True, may_ask=True)
    assert engage.step is Step.WAITING
    plane.rival = ""
    engage.tick(11.0, ready=True, may_ask=True)
    plane.rival = "another program on the link"
    plane.fly(engage, 50.0, 50.0)
    assert plane.asked_s == []


def test_a_pilot_who_takes_over_long_after_the_climb_is_left_alone_without_a_fault():
    plane = Climber()
    engage = AutoEngage(plane, PX4_FIXED_WING.take_off, 50.0)
    plane.rival = ""
    plane.ask = lambda now_s: None
    plane.fly(engage, 50.0, 50.0)
    engage.step = Step.CLIMBING  # waits in the air: the range is gone
    engage.tick(2000.0, ready=False, may_ask=False)
    plane.custom_mode = POSITION
    engage.tick(2000.1, ready=False, may_ask=False)
    assert engage.step is Step.LEFT_TO_PILOT and engage.problem == ""
