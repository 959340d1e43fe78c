"""THE TABLE: every row is a flight in lockstep over MAVLink bytes, and what must hold in it.

The errors are the stub's truth, not the app's estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pytest

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
    for_s: float = 250.0
    tail_s: float = 90.0


ROWS = [
    Row("heading at the beacon", 0.6, 1.5, world={"heading_rad": 0.3}),
    Row("heading away", 0.6, 1.5, world={"heading_rad": 0.3 + math.pi}),
    Row("beacon to the right", 0.6, 1.5, world={"bearing_rad": EAST, "heading_rad": NORTH}),
    Row("beacon to the left", 0.6, 1.5, world={"bearing_rad": WEST, "heading_rad": NORTH}),
    Row("start inside the orbit", 0.6, 1.5, world={"distance_m": 15.0}),
    Row("anticlockwise", 0.6, 1.5, app={"orbit": {"direction": "anticlockwise"}}),
    Row("anticlockwise from inside", 0.6, 1.5, {"orbit": {"direction": "anticlockwise"}}, {"distance_m": 20.0}),
    Row("kappa 1.2", 1.0, 2.0, app={"law": {"kappa": 1.2}}),
    Row("kappa 2", 0.6, 1.5, app={"law": {"kappa": 2.0}}),
    Row("kappa 5", 0.6, 1.5, app={"law": {"kappa": 5.0}}),
    Row("kappa 8, slowed to 3 m/s", 0.6, 1.5, {"law": {"kappa": 8.0}, "orbit": {"speed_m_s": 3.0}}, for_s=400.0),
    Row("k instead of kappa", 0.6, 1.5, app={"law": {"k": 0.06}}),
    Row("wide orbit", 0.8, 2.0, {"orbit": {"radius_m": 120.0, "speed_m_s": 8.0}}, {"distance_m": 400.0}, 350.0),
    Row("wind 2 m/s", 0.6, 1.5, world={"wind_east_m_s": 2.0}),
    Row("wind 4 m/s, gusts", 1.0, 2.5, world={"wind_north_m_s": -4.0, "gust_sigma_m_s": 1.0}),
    Row("noise 1 m that nobody told", 1.0, 3.0, world={"range_sigma_m": 1.0}),
    Row("noise 1 m", 1.0, 3.0, {"ranging": {"sigma_m": 1.0}}, {"range_sigma_m": 1.0}),
    Row("a range every half second", 1.0, 2.5, world={"range_rate_hz": 2.0}),
    Row("15 s dropout on the orbit", 1.5, 3.5, world={"range_dropouts_s": ((180.0, 195.0),)}),
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
