"""The last reading as it came: what the paper flies on. The yardstick that the other estimators are measured by.

Without a measured range rate, the rate is the difference of two ranges.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from typing import NamedTuple

from circumnav_mav.guidance.bounds import POSITIVE, refuse_options
from circumnav_mav.guidance.estimators.gate import remember
from circumnav_mav.guidance.kernel import Estimate, Estimator, EstimatorContext, Memory, Moved, Reading


class Parameters(NamedTuple):
    sigma_r: float  # m


class Last(NamedTuple):
    r: float
    r_dot: float
    variance: float


def begin(par: Parameters) -> list[Last]:
    return [Last(nan, nan, nan)]


def observe(bank: list[Last], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Believe the reading."""
    r_dot = z.r_dot
    if isnan(r_dot) and m.dt > 0.0:
        r_dot = (z.r - bank[0].r) / m.dt
    error = z.r - bank[0].r
    bank[0] = Last(z.r, r_dot, par.sigma_r**2 if isnan(z.sigma_r) else z.sigma_r**2)
    return remember(mem, m.dt, nan, 0.0 if isnan(r_dot) else 1.0, 0.0, error)


def carry(bank: list[Last], mem: Memory, m: Moved, par: Parameters) -> Estimate:
    """Return the last reading, however old."""
    return Estimate(bank[0].r, bank[0].r_dot, m.V, m.u, nan, m.psi, nan, nan, nan, nan)


def covariance(bank: list[Last]) -> tuple[float, ...]:
    """Return (var r [m^2],)."""
    return (bank[0].variance,)


def parameters(options: Mapping[str, float], context: EstimatorContext) -> Parameters:
    given = {**OPTIONS, **options}
    refuse_options(given, BOUNDS)
    return Parameters(given["sigma_m"])


OPTIONS = {"sigma_m": 0.3}
BOUNDS = {"sigma_m": POSITIVE}

ESTIMATOR = Estimator(
    name="raw",
    begin=begin,
    observe=observe,
    carry=carry,
    covariance=covariance,
    parameters=parameters,
    options=OPTIONS,
    bounds=BOUNDS,
    needs=frozenset({"range", "speed"}),
    gives=frozenset({"r", "r_dot", "V", "u"}),
    source="no filter (Hashemi et al. 2013)",
)
