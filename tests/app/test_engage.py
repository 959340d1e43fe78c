"""`engage: auto`: it arms, takes off and asks, and leaves the vehicle to whoever acts on the way."""

from __future__ import annotations

import math

import pytest

from sitl_stub import StubConfig
from tests.lockstep import Rig, config

ARM, TAKE_OFF, SET_MODE = 400, 22, 176
HOLD, POSITION, OFFBOARD = 0x03040000, 0x00030000, 0x00060000


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
