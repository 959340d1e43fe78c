"""The truth that tests compare with: where everything really is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl_stub.autopilot import Autopilot
from sitl_stub.modes import name_of
from sitl_stub.world import World


@dataclass(frozen=True, slots=True)
class Truth:
    """Where everything really is at t_s [s since boot].

    East, north [m] from the world's origin; height_m above ground. heading_rad and course_rad count counter-clockwise
    from east; turn_rate_rad_s is that of the nose, + counter-clockwise. speed_m_s is the horizontal ground speed.
    range_m is the slant range to the beacon.
    """

    t_s: float
    east_m: float
    north_m: float
    height_m: float
    heading_rad: float
    course_rad: float
    speed_m_s: float
    climb_m_s: float
    airspeed_m_s: float
    turn_rate_rad_s: float
    roll_rad: float
    pitch_rad: float
    beacon_east_m: float
    beacon_north_m: float
    beacon_height_m: float
    range_m: float
    horizontal_range_m: float
    wind_east_m_s: float
    wind_north_m_s: float
    mode: str
    armed: bool
    failsafe: bool


def truth_of(autopilot: Autopilot, world: World, t_s: float) -> Truth:
    """Return where everything is at t_s."""
    v, commander = autopilot.vehicle, autopilot.commander
    beacon_n, beacon_e, beacon_h = world.beacon(t_s)
    return Truth(
        t_s=t_s,
        east_m=v.e,
        north_m=v.n,
        height_m=v.h,
        heading_rad=_from_east(v.yaw),
        course_rad=math.atan2(v.vn, v.ve),
        speed_m_s=math.hypot(v.vn, v.ve),
        climb_m_s=v.vu,
        airspeed_m_s=autopilot.airspeed(),
        turn_rate_rad_s=-v.yaw_rate,
        roll_rad=v.roll,
        pitch_rad=v.pitch,
        beacon_east_m=beacon_e,
        beacon_north_m=beacon_n,
        beacon_height_m=beacon_h,
        range_m=world.range_and_rate(t_s, v)[0],
        horizontal_range_m=math.hypot(beacon_n - v.n, beacon_e - v.e),
        wind_east_m_s=world.wind_e,
        wind_north_m_s=world.wind_n,
        mode=name_of(commander.mode),
        armed=commander.armed,
        failsafe=commander.failsafe,
    )


def _from_east(compass_rad: float) -> float:
    angle = math.pi / 2 - compass_rad
    return math.atan2(math.sin(angle), math.cos(angle))
