"""The vehicle and the target of the study: exact arcs, a lagging and limited turn rate, wind, a target that moves.

Kernels only: the runner compiles them. Axes as in guidance/kernel.py: x east, y north, + counter-clockwise.
"""

from __future__ import annotations

from math import cos, exp, isinf, sin
from typing import NamedTuple


class Plant(NamedTuple):
    """What a vehicle and its world do, apart from noise. SI units, radians."""

    V: float  # airspeed, m/s
    dt: float  # time a command is held, s
    lag: float  # first-order lag of the turn rate, s
    limit: float  # greatest turn rate, rad/s; infinite = none
    wind_x: float
    wind_y: float
    target_turn: float  # turn rate of the target's course, rad/s
    gust: float  # standard deviation of each component of the gusts, m/s
    gust_s: float  # their correlation time, s
    speed_step: float  # share by which the airspeed steps up at `step_s`
    step_s: float  # s


class World(NamedTuple):
    """Where everything is."""

    t: float
    x: float  # vehicle
    y: float
    psi: float  # heading, unwrapped
    u: float  # turn rate flown
    tx: float  # target
    ty: float
    tvx: float
    tvy: float
    gx: float  # gust
    gy: float


SUBSTEP_S = 0.06
"""Longest arc flown with one turn rate while the turn rate is lagging: 0.5 mm of error at 15 m/s and full lag."""


def airspeed(t: float, plant: Plant) -> float:
    return plant.V * (1.0 + plant.speed_step) if t >= plant.step_s else plant.V


def limited(u: float, plant: Plant) -> float:
    return u if isinf(plant.limit) else min(max(u, -plant.limit), plant.limit)


def fly(world: World, u_command: float, plant: Plant, draw_x: float, draw_y: float) -> World:
    """Return the world after one held command. draw_x, draw_y: standard normal draws for the gusts of this step."""
    _, x, y, psi, u, tx, ty, tvx, tvy, gx, gy = world
    V = airspeed(world.t, plant)
    n = 1 if plant.lag <= 0.0 else int(plant.dt / SUBSTEP_S) + 1
    h = plant.dt / n
    for _ in range(n):
        if plant.lag > 0.0:
            left = exp(-h / plant.lag)
            turn = u_command * h + (u - u_command) * plant.lag * (1.0 - left)
            u = u_command + (u - u_command) * left
        else:
            u, turn = u_command, u_command * h
        half = 0.5 * turn
        chord = V * h * (sin(half) / half if abs(half) > 1e-6 else 1.0)
        x += chord * cos(psi + half) + (plant.wind_x + gx) * h
        y += chord * sin(psi + half) + (plant.wind_y + gy) * h
        psi += turn
    if plant.gust > 0.0:
        keep = exp(-plant.dt / plant.gust_s)
        kick = plant.gust * (1.0 - keep * keep) ** 0.5
        gx, gy = keep * gx + kick * draw_x, keep * gy + kick * draw_y
    if plant.target_turn != 0.0:
        c, s = cos(plant.target_turn * plant.dt), sin(plant.target_turn * plant.dt)
        tvx, tvy = c * tvx - s * tvy, s * tvx + c * tvy
    return World(world.t + plant.dt, x, y, psi, u, tx + tvx * plant.dt, ty + tvy * plant.dt, tvx, tvy, gx, gy)


def range_and_rate(world: World, plant: Plant) -> tuple[float, float]:
    """Return the true (r, r_dot)."""
    dx, dy = world.x - world.tx, world.y - world.ty
    r = max((dx * dx + dy * dy) ** 0.5, 1e-9)
    V = airspeed(world.t, plant)
    vx = V * cos(world.psi) + plant.wind_x + world.gx - world.tvx
    vy = V * sin(world.psi) + plant.wind_y + world.gy - world.tvy
    return r, (dx * vx + dy * vy) / r
