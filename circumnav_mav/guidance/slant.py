"""Horizontal range from slant range and height.

A range R is measured along the slope to a target h below (or above) the vehicle. On the ground plane
    r = sqrt(R^2 - h^2),   r_dot = (R R_dot - h h_dot) / r
Errors of R grow by R / r and those of h by h / r: near overhead both are without bound, and the reading is refused.
"""

from __future__ import annotations

from math import hypot, isnan, nan, sqrt
from typing import NamedTuple

from circumnav_mav.types import RangeSample, Rejected

STEEPEST = 0.25
"""Least r / R that is used: the line of sight then dips 75.5 deg, and an error of R counts four times."""


class Level(NamedTuple):
    """A range on the ground plane. r NaN: too near overhead to tell; `overhead` then says so."""

    r: float  # m
    r_dot: float  # m/s, + opening; NaN without a range rate or a climb rate
    sigma_r: float  # standard deviation, m; NaN when that of R is not known
    overhead: bool


def level(
    R: float, R_dot: float, sigma_R: float, h: float, h_dot: float, sigma_h: float, steepest: float = STEEPEST
) -> Level:
    """Return the horizontal range for a slant range R [m], its rate [m/s] and the height h [m] above the target.

    h_dot: climb rate, m/s; sigma_h: standard deviation of h, m (0 = exact). h NaN: the range is taken as horizontal.
    A slant range shorter than the height, by noise or by a wrong height, counts as overhead.
    """
    if isnan(h):
        return Level(R, R_dot, sigma_R, False)
    if not abs(h) < R or sqrt(R * R - h * h) < steepest * R:
        return Level(nan, nan, nan, True)
    r = sqrt(R * R - h * h)
    return Level(r, (R * R_dot - h * h_dot) / r, hypot(R * sigma_R, h * sigma_h) / r, False)


def least_level(h: float, steepest: float = STEEPEST) -> float:
    """Return the least horizontal range [m] that `level` gives at a height h [m] above, or below, the target."""
    return abs(h) * steepest / sqrt(1.0 - steepest * steepest)


def horizontal(sample: RangeSample, above_m: float, climb_m_s: float) -> RangeSample | Rejected:
    """Return a slant range on the ground plane. above_m: height above the target, NaN unknown; climb_m_s: its rate."""
    if isnan(above_m):
        return Rejected(sample.t_s, "no_height", "the slant range needs a height, and the autopilot sends none")
    flat = level(sample.range_m, sample.range_rate_m_s, sample.sigma_m, above_m, climb_m_s, 0.0)
    if flat.overhead:
        return Rejected(sample.t_s, "overhead", f"slant {sample.range_m:.1f} m at {above_m:.1f} m above the target")
    return RangeSample(sample.t_s, flat.r, flat.r_dot, flat.sigma_r, sample.beacon_id)
