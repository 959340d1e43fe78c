"""THE TABLE: every row is a flight in lockstep over MAVLink bytes, and what must hold in it.

The errors are the stub's truth, not the app's estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import pytest

from circumnav_mav.config import Config
from circumnav_mav.config_file import load
from circumnav_mav.ranging.gate import STUCK_S
from tests.height_rows import SHIPPED
from tests.lockstep import Rig, airborne, config

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2


@dataclass(frozen=True)
class Row:
    """A flight: what is configured, what the world does, and what must hold of the last minute and a half."""

    name: str
    rms_m: float
    worst_m: float
    app: dict[str, Any] = field(default_factory=dict)
    world: dict[str, Any] = field(default_factory=dict)
    for_s: float = 170.0
    tail_s: float = 90.0


ROWS = [
    Row("heading at the beacon", 0.6, 1.5, world={"heading_rad": 0.3}),
    Row("heading away", 0.6, 1.5, world={"heading_rad": 0.3 + math.pi}),
    Row("beacon to the right", 0.6, 1.5, world={"bearing_rad": EAST, "heading_rad": NORTH}),
    Row("beacon to the left", 0.6, 1.5, world={"bearing_rad": WEST, "heading_rad": NORTH}),
    Row("start inside the orbit", 0.6, 1.5, world={"distance_m": 15.0}),
    Row("anticlockwise", 0.6, 1.5, app={"orbit": {"direction": "anticlockwise"}}),
    Row("anticlockwise from inside", 0.6, 1.5, {"orbit": {"direction": "anticlockwise"}}, {"distance_m": 20.0}),
    Row("kappa 1.2", 1.0, 2.0, app={"law": {"kappa": 1.2}}, for_s=250.0),
    Row("kappa 2", 0.6, 1.5, app={"law": {"kappa": 2.0}}),
    Row("kappa 5", 0.6, 1.5, app={"law": {"kappa": 5.0}}),
    Row("kappa 8, slowed to 3 m/s", 0.6, 1.5, {"law": {"kappa": 8.0}, "orbit": {"speed_m_s": 3.0}}, for_s=250.0),
    Row("k instead of kappa", 0.6, 1.5, app={"law": {"k": 0.06}}),
    Row("wide orbit", 0.8, 2.0, {"orbit": {"radius_m": 120.0, "speed_m_s": 8.0}}, {"distance_m": 400.0}, 220.0),
    Row("wind 2 m/s", 0.6, 1.5, world={"wind_east_m_s": 2.0}),
    Row("wind 4 m/s, gusts", 1.0, 2.5, world={"wind_north_m_s": -4.0, "gust_sigma_m_s": 1.0}),
    Row("noise 1 m that nobody told", 1.0, 3.0, world={"range_sigma_m": 1.0}),
    Row("noise 1 m", 1.0, 3.0, {"ranging": {"sigma_m": 1.0}}, {"range_sigma_m": 1.0}),
    Row("a range every half second", 1.0, 2.5, world={"range_rate_hz": 2.0}),
    Row("15 s dropout on the orbit", 1.5, 3.5, world={"range_dropouts_s": ((180.0, 195.0),)}, for_s=250.0),
    Row("10 % outliers, 10 m too long", 1.5, 5.0, world={"outlier_share": 0.1, "outlier_mean_m": 10.0}),
    Row("10 % outliers, 40 m too long", 1.5, 5.0, world={"outlier_share": 0.1, "outlier_mean_m": 40.0}),
    Row("slant range", 0.8, 2.0, {"ranging": {"target_height_m": 0.0}}, {"beacon_height_m": 0.0, "height_m": 30.0}),
    Row("25 Hz loop", 0.6, 1.5, app={"loop": {"rate_hz": 25.0}}),
]


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_row(row):
    rig = Rig(config(**row.app), airborne(**{"seed": 11, **row.world})).engage()
    log = rig.run(row.for_s)
    assert log.phases[-1] == "orbiting", (log.phases, rig.flight.events)
    assert set(log.phases) <= {"waiting_autopilot", "waiting_range", "ready", "acquiring", "orbiting", "coasting"}
    assert log.rms_m(row.tail_s) < row.rms_m
    assert log.furthest_m(row.tail_s) < row.worst_m
    heights = [truth.height_m for truth in log.truth[-3000:]]
    assert max(heights) - min(heights) < 2.0
    keep_the_rules(rig)


@dataclass(frozen=True)
class Stuck:
    """A radio that sends its last value on from `at_s`, and how much farther from the beacon the vehicle may come then.

    farther_m: half of the way flown blind, for a plane all of it. From the orbit: a radius, for a plane in wind two.
    """

    name: str
    at_s: float
    farther_m: float
    app: Config = field(default_factory=config)
    world: dict[str, Any] = field(default_factory=dict)


DRIFT = config(estimator={"name": "drift"}, law={"name": "tangent"})
PLANE = {"airframe": "fixed_wing", "height_m": 100.0, "beacon_height_m": 0.0, "start_speed_m_s": 18.0}
PLANE |= {"distance_m": 400.0, "wind_east_m_s": 3.0, "range_max_m": 2000.0}
FLOWN_BLIND_S = STUCK_S + 20.0
"""What was believed while the value stood, and coast_s after the last one that was used."""

STUCK_ROWS = [
    Stuck("multirotor, approach", 15.0, 0.5 * 5.0 * FLOWN_BLIND_S),
    Stuck("multirotor, orbit", 45.0, 50.0, world={"distance_m": 90.0}),
    Stuck("multirotor on drift, approach", 15.0, 0.5 * 5.0 * FLOWN_BLIND_S, DRIFT),
    Stuck("multirotor on drift, orbit", 45.0, 50.0, DRIFT, {"distance_m": 90.0}),
    Stuck("plane, approach", 12.0, 18.0 * FLOWN_BLIND_S, load(SHIPPED), PLANE),
    Stuck("plane, orbit", 60.0, 160.0, load(SHIPPED), PLANE),
]


@pytest.mark.parametrize("row", STUCK_ROWS, ids=[row.name for row in STUCK_ROWS])
def test_a_stuck_radio_is_found_lost_and_heard_again(row):
    back_s = row.at_s + 30.0
    world = airborne(**{"seed": 11, "faults": (f"{row.at_s:g}-{back_s:g} range-stick",), **row.world})
    rig = Rig(row.app, world).engage()
    rig.run(row.at_s - rig.now_s)
    assert rig.log.phases[-1] == ("orbiting" if "orbit" in row.name else "acquiring")
    there_m = rig.stub.truth().horizontal_range_m
    log = rig.run(back_s - 1.0 - rig.now_s)
    since = [tick for tick in log.ticks if tick.t_s > row.at_s]
    lost_s = next(tick.t_s for tick in since if tick.phase == "range_lost")
    assert lost_s - row.at_s < FLOWN_BLIND_S + 0.3
    assert {tick.phase for tick in since if tick.t_s >= lost_s} == {"range_lost"}, "ready only when the value changes"
    assert max(t.horizontal_range_m for t in log.truth[-len(since) :]) < there_m + row.farther_m
    assert rig.flight.rejected["stuck"] > 200
    told = [event for event in rig.flight.events if event.text.startswith("the range is stuck: ")]
    assert len(told) == 1 and told[0].t_s - row.at_s < STUCK_S + 0.3
    assert rig.run(3.0).phases[-1] == "ready"


SLOW = config(orbit={"radius_m": 20.0, "speed_m_s": 0.8})
BY_ATTITUDE = config(vehicle={"class": "px4_multirotor_attitude", "pitch_deg": -4.37})


@pytest.mark.parametrize(("app", "fault"), [(SLOW, ()), (BY_ATTITUDE, ("10-inf no-gps",))], ids=["slow", "no position"])
def test_a_stuck_radio_is_found_at_any_speed_and_without_a_measured_one(app, fault):
    """Without a position the autopilot goes on to send a velocity: 0 m/s."""
    rig = Rig(app, airborne(distance_m=100.0, faults=("15-inf range-stick", *fault))).engage()
    rig.run(15.0 + STUCK_S + 0.3 - rig.now_s)
    assert rig.flight.ranges.receiver.moving
    assert rig.flight.rejected["stuck"]


@pytest.mark.parametrize(("app", "step_m"), [(DRIFT, 0.01), (config(), 1.0)], ids=["cm", "m"])
def test_a_perfect_orbit_may_keep_its_range(app, step_m):
    """Without noise and wind an honest range stands for long, and then nothing is stuck and nothing coasts."""
    world = airborne(distance_m=120.0, range_sigma_m=0.0, height_drift_m_s=0.0, range_step_m=step_m)
    log = (rig := Rig(app, world).engage()).run(120.0)
    assert max(len(list(same)) for _, same in groupby(tick.range_m for tick in log.ticks)) * rig.tick_s > 2.0 * STUCK_S
    assert log.phases[-1] == "orbiting" and "coasting" not in log.phases
    assert not rig.flight.rejected["stuck"]


@pytest.mark.parametrize("sender", [1, 158])
def test_the_autopilots_own_ranges_are_flown_on_where_they_are_chosen(sender):
    """Its own sensor, or that of a companion which it passes on; its other one looks down."""
    rig = Rig(config(ranging={"from": [1, 1]}), airborne(distance_m=80.0, range_compid=sender)).engage()
    log = rig.run(60.0)
    assert log.phases[-1] == "orbiting" and "coasting" not in log.phases
    assert log.rms_m(15.0) < 0.6
    assert rig.flight.rejected["decoy_orientation"] > 0
    assert (rig.flight.rejected["wrong_source"] > 0) == (sender != 1)


def keep_the_rules(rig: Rig) -> None:
    """What holds in every flight: finite, inside the limits, at the right vehicle, in the right frame."""
    limits, orbit = rig.config.limits, rig.config.orbit
    for t, message in rig.setpoints():
        values = [message.vx, message.vy, message.vz, message.yaw_rate]
        assert all(math.isfinite(v) for v in values), (t, message)
        assert abs(message.yaw_rate) <= limits.turn_rate_rad_s + 1e-6
        assert math.hypot(message.vx, message.vy) <= orbit.speed_m_s + 1e-4
        assert (message.target_system, message.target_component) == (rig.stub.config.system_id, 1)
        assert (message.coordinate_frame, message.type_mask) == (8, 1479)


def test_a_mirrored_world_gives_a_mirrored_flight():
    """Anticlockwise is the clockwise flight in a mirror: same ranges, opposite turns. Noise off, so exactly."""
    quiet = {"range_sigma_m": 0.0, "height_drift_m_s": 0.0}
    right = Rig(config(), airborne(bearing_rad=0.4, heading_rad=0.0, **quiet)).engage()
    left_config = config(orbit={"direction": "anticlockwise"})
    left = Rig(left_config, airborne(bearing_rad=-0.4, heading_rad=0.0, **quiet)).engage()
    for mine, other in zip(right.run(120.0).ticks, left.run(120.0).ticks, strict=True):
        if math.isfinite(mine.turn_rate_sent_rad_s):
            assert other.turn_rate_sent_rad_s == pytest.approx(-mine.turn_rate_sent_rad_s, abs=2e-2)
    assert right.log.rms_m(30.0) == pytest.approx(left.log.rms_m(30.0), abs=0.05)


def test_the_same_seed_gives_the_same_flight():
    flights = [Rig(config(), airborne(seed=5)).engage() for _ in range(2)]
    first, second = (rig.run(60.0) for rig in flights)
    assert [t.turn_rate_sent_rad_s for t in first.sent()] == [t.turn_rate_sent_rad_s for t in second.sent()]
