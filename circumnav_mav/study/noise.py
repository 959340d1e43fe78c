"""The study's one source of chance: keyed by the seed and the run, so the same for any law and any workers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circumnav_mav.study.plant import Plant, World
from circumnav_mav.study.scenarios import Scenario

Floats = NDArray[np.float64]

BLOCK = 16
"""Runs of the paper's plant that share a stream: making one costs more than 1,000 draws from it."""


def generator(seed: int, *key: int) -> np.random.Generator:
    """Return a stream of its own for each seed and key."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))


def normals(seed: int, stream: int, first: int, count: int, steps: int, channel: int = 0) -> Floats:
    """Return standard normal draws (count, steps) for the runs first ... first + count - 1 of a stream.

    A row hangs on its run alone, not on which runs are asked for together. channel: one a sensor.
    """
    draws = np.empty((count, steps))
    for block in range(first // BLOCK, -(-(first + count) // BLOCK)):
        rows = generator(seed, stream, block, channel).standard_normal((BLOCK, steps))
        low, high = max(first, block * BLOCK), min(first + count, (block + 1) * BLOCK)
        draws[low - first : high - first] = rows[low - block * BLOCK : high - block * BLOCK]
    return draws


class Chance(NamedTuple):
    """The draws of one run. One row a range; gusts one row a control step (or none)."""

    range_error_m: Floats
    rate_error_m_s: Floats  # empty when the sensor has no rate
    gust_x: Floats  # standard normal; empty without gusts
    gust_y: Floats
    plant: Plant
    start: World


def draw(scenario: Scenario, seed: int, index: int) -> Chance:
    """Return the draws of run `index`. Scenarios that differ in one thing share the draws of all others."""
    place, ranges, rates, gusts = (generator(seed, index, stream) for stream in range(4))
    steps = round(scenario.duration_s / scenario.control_s)
    n = steps // scenario.range_every + 1
    return Chance(
        _range_errors(scenario, ranges, n),
        rates.standard_normal(0 if math.isnan(scenario.sigma_r_dot_m_s) else n) * scenario.sigma_r_dot_m_s,
        gusts.standard_normal(steps if scenario.gust_m_s > 0.0 else 0),
        gusts.standard_normal(steps if scenario.gust_m_s > 0.0 else 0),
        *_place(scenario, place),
    )


def _range_errors(scenario: Scenario, chance: np.random.Generator, n: int) -> Floats:
    errors = chance.standard_normal(n) * scenario.sigma_r_m
    if scenario.echo_m > 0.0:
        errors = errors + scenario.echo_m * echoes(chance.random(n), scenario.outlier_share, scenario.echo_burst)
    elif scenario.outlier_share > 0.0:
        echo = chance.random(n) < scenario.outlier_share
        errors = errors + echo * chance.exponential(scenario.outlier_mean_m, n)
    return errors


def echoes(uniform: Floats, share: float, burst: int) -> NDArray[np.bool_]:
    """Return which readings are echoes, `burst` at a time, `share` of all in the mean. uniform: a draw a reading."""
    begins = uniform < share / (burst * (1.0 - share) + share)  # of a reading that is in no burst yet
    echo, i = np.zeros(len(uniform), dtype=bool), 0
    while i < len(uniform):
        if begins[i]:
            echo[i : i + burst] = True
        i += burst if begins[i] else 1
    return echo


def _place(scenario: Scenario, chance: np.random.Generator) -> tuple[Plant, World]:
    """Return the plant and the start of a run. Every draw is made in every scenario, so that they stay comparable."""
    near, far = scenario.start_m
    r = near + (far - near) * chance.random()
    bearing, heading, wind, target = (chance.random(4) * 2.0 * math.pi).tolist()
    if not math.isnan(scenario.start_bearing_deg):
        bearing = math.radians(scenario.start_bearing_deg)
    if not math.isnan(scenario.start_heading_deg):
        heading = math.radians(scenario.start_heading_deg)
    if scenario.start_away:
        heading = bearing
    if not math.isnan(scenario.wind_deg):
        wind = math.radians(scenario.wind_deg)
    if not math.isnan(scenario.target_deg):
        target = math.radians(scenario.target_deg)
    tvx, tvy = scenario.target_m_s * math.cos(target), scenario.target_m_s * math.sin(target)
    plant = Plant(
        V=scenario.V_m_s,
        dt=scenario.control_s,
        lag=scenario.lag_s,
        limit=scenario.limit_rad_s,
        wind_x=scenario.wind_m_s * math.cos(wind),
        wind_y=scenario.wind_m_s * math.sin(wind),
        target_turn=scenario.target_turn_rad_s,
        gust=scenario.gust_m_s,
        gust_s=5.0,
        speed_step=scenario.speed_step,
        step_s=scenario.duration_s / 3.0,
    )
    start = World(0.0, r * math.cos(bearing), r * math.sin(bearing), heading, 0.0, 0.0, 0.0, tvx, tvy, 0.0, 0.0)
    return plant, start
