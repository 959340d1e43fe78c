"""px4_rover in closed loop: the app over MAVLink bytes, in lockstep with a small rover made of what was measured."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub.modes import Mode
from tests.lockstep import OFFBOARD_LINK, Rig, airborne, config
from tests.trust.rules import HOLD, OFFBOARD, keep_the_rules, mode_requests
from tests.vehicles.rover import RO_SPEED_LIM_M_S, RO_YAW_P, RoverPilot, controllers, make_rover

ARM = 400
RADIUS_M, SPEED_M_S = 15.0, 2.0


def standing(world: dict[str, Any] | None = None, *, arm: bool = True, **sections: Any) -> tuple[Rig, RoverPilot]:
    """Return a rover that is armed and stands 60 m from the beacon."""
    orbit = {"radius_m": RADIUS_M, "speed_m_s": SPEED_M_S, **sections.pop("orbit", {})}
    app = config(vehicle={"class": "px4_rover"}, orbit=orbit, **sections)
    rig = Rig(app, airborne(**{"distance_m": 60.0, "height_m": 0.0, "params": {"COM_OBL_RC_ACT": 5}, **(world or {})}))
    rover = make_rover(rig.stub)
    rig.run(2.0)
    if arm:
        rig.pilot.command(ARM, 1)
    rig.run(1.0)
    return rig, rover


@pytest.mark.parametrize(
    ("vn", "ve", "yaw_deg", "speed", "yaw_rate"),
    [  # the rows of PX4.md, 6, that can be asked of it
        (2.0, 0.0, 0.0, 2.0, 0.0),
        (2.0 * math.cos(math.radians(30)), 2.0 * math.sin(math.radians(30)), 0.0, 2.0, 1.57),
        (-2.0, 0.0, 0.0, 2.0, 9.42),
        (0.0, 20.0, 90.0, RO_SPEED_LIM_M_S, 0.0),
    ],
)
def test_the_rover_asks_for_what_was_measured(vn, ve, yaw_deg, speed, yaw_rate):
    asked = controllers(vn, ve, math.radians(yaw_deg))
    assert (asked[0], abs(asked[1])) == pytest.approx((speed, yaw_rate), abs=0.01)


@pytest.mark.parametrize(
    ("direction", "sigma_m"),
    [
        ("clockwise", 0.3),
        ("anticlockwise", 0.1),
        pytest.param("clockwise", 0.1, marks=pytest.mark.soak),
        pytest.param("anticlockwise", 0.3, marks=pytest.mark.soak),
    ],
)
def test_the_rover_circles_either_way(direction, sigma_m):
    """From a start that looks away from the beacon, with noise; the error is the stub's truth."""
    world = {"heading_rad": 2.5, "seed": 5, "range_sigma_m": sigma_m}
    rig, _ = standing(world, orbit={"direction": direction}, ranging={"sigma_m": sigma_m})
    log = rig.engage().run(150.0)
    assert log.phases[-1] == "orbiting", (log.phases, rig.flight.events)
    print(f"{direction}, sigma {sigma_m} m: rms {log.rms_m(60.0):.3f} m, furthest {log.furthest_m(60.0):.3f} m")
    assert log.rms_m(60.0) < 0.6
    tail = log.truth[-3000:]
    turn = sum(truth.turn_rate_rad_s for truth in tail) / len(tail)
    assert turn == pytest.approx((-1 if direction == "clockwise" else 1) * SPEED_M_S / RADIUS_M, rel=0.05)
    keep_the_rules(rig)


def test_with_nothing_but_its_class_named_it_circles_at_the_speed_that_px4_allows():
    """orbit.speed_m_s is 5 unless given, RO_SPEED_LIM 3: the law takes the speed as measured."""
    rig = Rig(config(vehicle={"class": "px4_rover"}), airborne(height_m=0.0, distance_m=120.0))
    make_rover(rig.stub)
    rig.run(2.0)
    rig.pilot.command(ARM, 1)
    rig.run(1.0)
    log = rig.engage().run(160.0)
    assert log.phases[-1] == "orbiting"
    assert log.truth[-1].speed_m_s == pytest.approx(RO_SPEED_LIM_M_S, abs=0.05)
    assert log.rms_m(40.0) < 0.6


def test_the_turn_rate_that_is_asked_for_is_the_one_that_is_driven():
    """The recipe: the velocity points d = u / RO_YAW_P beside the nose."""
    rig, rover = standing({"seed": 2})
    rig.engage().run(100.0)
    assert rover.asked[1] == pytest.approx(-rig.log.ticks[-1].turn_rate_sent_rad_s, abs=0.08)
    (fields,) = [m for _, m in rig.setpoints(rig.now_s)]
    assert math.atan2(fields.vy, fields.vx) * RO_YAW_P == pytest.approx(fields.yaw_rate, abs=1e-4)
    asked = [t.turn_rate_sent_rad_s for t in rig.log.ticks[-1500:]]
    driven = [t.turn_rate_rad_s for t in rig.log.truth[-1500:]]
    assert sum(driven) / 1500 == pytest.approx(sum(asked) / 1500, rel=0.03)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.4, -0.4])
def test_the_fake_ignores_a_yaw_rate_as_px4_does(yaw_rate):
    """Else the flights above would prove nothing about the recipe."""
    rig, rover = standing()
    fields = (2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw_rate)
    ahead = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 1479, 0.0, 0.0, 0.0, *fields)
    rig.stub.receive(OFFBOARD_LINK, ahead.pack(mavlink.MAVLink(None, 1, 191)))
    rig.stub.autopilot.commander.mode = Mode.OFFBOARD
    rover.step(rig.now_s, 0.0, 0.0)
    assert rover.asked == pytest.approx((2.0, 0.0), abs=1e-6)


def test_a_driver_takes_over_and_it_stands():
    rig, _ = standing()
    rig.engage().run(20.0)
    rig.pilot.mode(HOLD)
    taken_s = rig.now_s
    rig.run(10.0)
    assert rig.log.phases[-1] == "released"
    assert max(t for t, _ in rig.setpoints()) - taken_s < 0.7
    assert mode_requests(rig) == []
    assert rig.log.truth[-1].speed_m_s < 0.01


def test_a_range_that_is_lost_stops_it(monkeypatch):
    rig, _ = standing(ranging={"coast_s": 3.0})
    rig.engage().run(20.0)
    monkeypatch.setattr(rig.stub, "radio", None)
    rig.run(10.0)
    assert rig.log.truth[-1].mode == "AUTO/LOITER"
    assert rig.log.truth[-1].speed_m_s < 0.01
    keep_the_rules(rig)


def test_a_rover_that_is_not_armed_is_not_driven():
    rig, rover = standing(arm=False)
    rig.pilot.mode(OFFBOARD)
    rig.run(5.0)
    assert rig.log.phases[-1] == "ready"
    assert rover.speed == 0.0
