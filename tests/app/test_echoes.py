"""Echoes that come in bursts: the airplane and the multirotor fly on over MAVLink bytes.

An echo off a bank or a hangar lasts about a second, again and again. The errors are the stub's truth.
"""

from __future__ import annotations

import pytest

from tests.lockstep import Rig, airborne, config

PLANE = {
    "vehicle": {"class": "px4_fixed_wing"},
    "orbit": {"radius_m": 80.0, "speed_m_s": 12.0},
    "ranging": {"sigma_m": 1.0},
    "limits": {"bank_deg": 35.0, "turn_accel_rad_s2": 0.5},
}
PLANE_WORLD = {
    "airframe": "fixed_wing",
    "distance_m": 350.0,
    "bearing_rad": -2.0,
    "heading_rad": 1.0,
    "height_m": 100.0,
    "start_speed_m_s": 12.0,
    "wind_east_m_s": -3.0,
    "wind_north_m_s": -4.0,
    "range_sigma_m": 1.0,
    "range_max_m": 5000.0,
}
AGAIN = "outvoted the estimate"
BACK = "back where they had been"


def bursts(every_s, for_s, add_m, from_s=60.0, to_s=120.0):
    """Return faults that add add_m to every range for for_s, every every_s."""
    times = range(int((to_s - from_s) / every_s) + 1)
    return tuple(f"{from_s + n * every_s:.2f}-{from_s + n * every_s + for_s:.2f} range-add {add_m:g}" for n in times)


def flown(app, world, for_s=130.0):
    rig = Rig(config(**app), airborne(**{"seed": 23, **world})).engage()
    rig.run(for_s)
    return rig


def told(rig, words):
    return [event.text for event in rig.flight.events if words in event.text]


@pytest.mark.parametrize(("every_s", "for_s", "rate_hz"), [(15.0, 1.0, 10.0), (18.0, 0.15, 50.0)])
def test_a_plane_flies_on_through_bursts_of_echoes(every_s, for_s, rate_hz):
    faults = bursts(every_s, for_s, 40.0)
    rig = flown(PLANE, {**PLANE_WORLD, "range_rate_hz": rate_hz, "faults": faults})
    assert rig.log.phases[-1] == "orbiting", rig.flight.events
    assert rig.log.furthest_m(70.0) < 1.5
    assert told(rig, AGAIN) == []


def test_a_multirotor_flies_on_through_bursts_of_echoes():
    rig = flown({"orbit": {"radius_m": 40.0}}, {"distance_m": 90.0, "faults": bursts(15.0, 1.0, 40.0)})
    assert rig.log.phases[-1] == "orbiting", rig.flight.events
    assert rig.log.furthest_m(70.0) < 1.5
    assert told(rig, AGAIN) == []


@pytest.mark.parametrize(("add_m", "for_s"), [pytest.param(40.0, 6.0, marks=pytest.mark.soak), (-30.0, 4.0)])
def test_echoes_that_outvote_the_estimate_are_found_out_and_end_no_flight(add_m, for_s):
    """For seconds out of every ten: an echo wins each time, and each time the estimate of before is taken back.

    Five restarts within a minute would break the flight off: those that were taken back are none. That the ranges are
    horizontal is told: with echoes for most of the time, `auto` may take the wrong one for right.
    """
    told_height = {**PLANE, "ranging": {**PLANE["ranging"], "target_height_m": None}}
    rig = flown(told_height, {**PLANE_WORLD, "faults": bursts(10.0, for_s, add_m, to_s=110.0)}, for_s=150.0)
    assert len(told(rig, AGAIN)) >= 5
    assert len(told(rig, BACK)) >= 5
    assert rig.log.phases[-1] == "orbiting", rig.flight.events
    assert rig.log.furthest_m(10.0) < 1.5
