"""Range and its rate, filtered: what the paper's law needs and no more.

A Kalman filter on (r, r_dot), driven by the turn rate that was flown: a known turn is not noise. With
theta = acos(-r_dot / V) the polar kinematics (NOTES: the paper's polar form) give the change of both over any motion of
the vehicle, exactly, also through a dropout. The sign of theta, the side the target lies on, is not observed in one
sample: one filter flies on each side, the readings weigh them, and the loser is re-seeded from the winner.
Covariance: the chain r_ddot = white noise of density `q`, for lags, gusts and speed errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import acos, atan2, cos, hypot, isfinite, isnan, log, nan, sin, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.bounds import NOISE, POSITIVE, refuse_options
from circumnav_mav.guidance.estimators.gate import AGREE_S, compared, refuse, remember, shelved
from circumnav_mav.guidance.kernel import (
    RESTARTED,
    RETURNED,
    Estimate,
    Estimator,
    EstimatorContext,
    Memory,
    Moved,
    Reading,
)

SLOW_SHARE = 0.7
SLOW_ACCEL_PER_S = 0.5
"""Acceleration noise while slow, as a share of the nominal speed a second: a multirotor gathers speed in 1 to 2 s."""
LIKELIER, LOST = 0.4, 7.0
"""Natural logarithms: how much likelier the wanted side is at the start, and how much less likely a side may become
before it starts again from the other one's state."""


class Parameters(NamedTuple):
    V: float  # nominal speed: the prior of r_dot, m/s
    sigma_r: float  # of a reading that claims none, m
    sigma_r_dot: float  # of a measured range rate, m/s
    q: float  # density of the acceleration noise, m^2/s^3
    gate: float  # standard deviations
    side: float  # +1 target wanted on the right (theta > 0), -1 on the left


class Side(NamedTuple):
    r: float
    r_dot: float
    prr: float
    prv: float
    pvv: float
    log_weight: float
    side: float


def predict(h: Side, m: Moved, par: Parameters) -> Side:
    """Return the side after a motion: the target stays where it was, the vehicle moves and turns.

    Below the speed it is to fly at, a vehicle hovers or gathers speed, and its range rate follows no turn: it is then
    left to the readings (SLOW_ACCEL).
    """
    dt = m.dt
    if dt <= 0.0:
        return h
    V = m.V
    q = par.q if V > SLOW_SHARE * par.V else max(par.q, (SLOW_ACCEL_PER_S * par.V) ** 2)
    v_in = min(max(h.r_dot, -V), V)
    excess = h.r_dot - v_in  # wind, or a speed that lags: it moves the range, and is kept as it is
    theta = h.side * acos(-v_in / V) if V > 0.0 else 0.0
    x, y = h.r * cos(theta) - m.ahead, -h.r * sin(theta) - m.left
    theta = -(atan2(y, x) - m.turn)
    prr = h.prr + dt * (2.0 * h.prv + dt * h.pvv) + q * dt**3 / 3.0
    prv = h.prv + dt * h.pvv + q * dt**2 / 2.0
    pvv = h.pvv + q * dt
    if pvv > par.V**2:  # a range rate is never less known than within the speed; scaled so that it stays a covariance
        prv *= par.V / sqrt(pvv)
        pvv = par.V**2
    side = h.side if sin(theta) * h.side >= 0.0 else -h.side
    return Side(max(0.0, hypot(x, y) + excess * dt), -V * cos(theta) + excess, prr, prv, pvv, h.log_weight, side)


def correct(h: Side, error: float, a: float, b: float, variance: float) -> Side:
    """Return the update by the innovation `error` of the measurement a r + b r_dot, weighted by its likelihood."""
    gr, gv = a * h.prr + b * h.prv, a * h.prv + b * h.pvv
    s = a * gr + b * gv + variance
    return Side(
        h.r + gr / s * error,
        h.r_dot + gv / s * error,
        h.prr - gr * gr / s,
        h.prv - gr * gv / s,
        h.pvv - gv * gv / s,
        h.log_weight - 0.5 * (error * error / s + log(s)),
        h.side,
    )


def best_of(bank: list[Side]) -> int:
    return 0 if bank[0].log_weight >= bank[1].log_weight else 1


def begin(par: Parameters) -> list[Side]:
    """Return a bank that knows nothing."""
    return [Side(nan, 0.0, nan, 0.0, nan, LIKELIER, par.side), Side(nan, 0.0, nan, 0.0, nan, 0.0, -par.side)]


def seed(bank: list[Side], z: Reading, par: Parameters, variance: float) -> None:
    """Start both sides from one reading. The side that is wanted is the likelier one by a little.

    A range that moved says nothing of its rate: what was believed stays the best guess.
    """
    v, pvv = (bank[best_of(bank)].r_dot, 0.5 * par.V**2) if isnan(z.r_dot) else (z.r_dot, par.sigma_r_dot**2)
    bank[0] = Side(z.r, v, variance, 0.0, pvv, LIKELIER, par.side)
    bank[1] = Side(z.r, v, variance, 0.0, pvv, 0.0, -par.side)


def settle(bank: list[Side]) -> None:
    """Re-seed a lost side from the other."""
    i = best_of(bank)
    h = bank[i]
    if h.side == bank[1 - i].side or bank[1 - i].log_weight < h.log_weight - LOST:
        bank[1 - i] = Side(h.r, h.r_dot, h.prr, h.prv, h.pvv, h.log_weight - LOST, -h.side)


def observe(bank: list[Side], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank to the reading, judge it and use it; take a shelved belief back when ranges fit it again."""
    if isnan(mem.shelf_s):
        return follow(bank, mem, m, z, par)
    h = bank.pop()
    after = follow(bank, mem, m, z, par)
    if not isnan(after.shelf_s):  # a newer one is on the shelf
        return after
    h = predict(h, m, par)
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    error, variance = z.r - h.r, sigma_r * sigma_r
    nis = error * error / (h.prr + variance)
    after = compared(after, mem, m.dt, error, nis, par.gate, 2.0 * par.gate * sigma_r)
    if after.verdict == RETURNED:
        h = correct(h, error, 1.0, 0.0, variance)
        bank[0] = Side(h.r, h.r_dot, h.prr, h.prv, h.pvv, 0.0, h.side)
        bank[1] = Side(h.r, h.r_dot, h.prr, h.prv, h.pvv, -LOST, -h.side)
    elif not isnan(after.shelf_s):
        bank.append(h)
    return after


def follow(bank: list[Side], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry both sides, nothing on the shelf, to the reading, judge it and use it."""
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    variance = sigma_r * sigma_r
    if isnan(bank[0].r):
        seed(bank, z, par, variance)
        return remember(mem, m.dt, nan, 0.0 if isnan(z.r_dot) else 1.0, 0.0)
    for i in range(2):
        bank[i] = predict(bank[i], m, par)
    h = bank[best_of(bank)]
    error = z.r - h.r
    nis = error * error / (h.prr + variance)
    if nis > par.gate**2:
        settled = mem.stood_s >= AGREE_S
        mem = refuse(mem, z.r, m.dt, 2.0 * par.V, 2.0 * par.gate * sigma_r, error)
        if mem.verdict == RESTARTED:
            seed(bank, z, par, variance)
            if settled:
                bank.append(h)
                return shelved(mem, 0.0, 0.0)
        return mem
    for i in range(2):
        bank[i] = correct(bank[i], z.r - bank[i].r, 1.0, 0.0, variance)
        if not isnan(z.r_dot):
            bank[i] = correct(bank[i], z.r_dot - bank[i].r_dot, 0.0, 1.0, par.sigma_r_dot**2)
    settle(bank)
    known = 1.0 if bank[best_of(bank)].pvv < (0.4 * par.V) ** 2 else mem.known
    return remember(mem, m.dt, nis, known, 0.0, error)


def carry(bank: list[Side], mem: Memory, m: Moved, par: Parameters) -> Estimate:
    """Return the estimate of the likelier side after a motion. theta is that of its side.

    Near overhead a reading can draw the filter below 0; no range is, and no law is asked what to do at one.
    """
    h = predict(bank[best_of(bank)], m, par)
    theta = h.side * acos(min(max(-h.r_dot / m.V, -1.0), 1.0)) if m.V > 0.0 else nan
    return Estimate(max(h.r, 0.0), h.r_dot, m.V, m.u, theta, m.psi, nan, nan, nan, nan)


def covariance(bank: list[Side]) -> tuple[float, ...]:
    """Return (var r [m^2], cov r r_dot, var r_dot [m^2/s^2]) at the last reading."""
    h = bank[best_of(bank)]
    return (h.prr, h.prv, h.pvv)


def parameters(options: Mapping[str, float], context: EstimatorContext) -> Parameters:
    """Return the kernel's parameters. The acceleration noise defaults to a tenth of the greatest turn's."""
    given = {**OPTIONS, **options}
    limit = context.turn_rate_limit if isfinite(context.turn_rate_limit) else 3.0 * context.V / context.r_a
    accel = 0.1 * context.V * limit if isnan(given["accel_m_s2"]) else given["accel_m_s2"]
    refuse_options({**given, "accel_m_s2": accel}, BOUNDS)
    return Parameters(
        context.V, given["sigma_m"], given["sigma_rate_m_s"], accel * accel, given["gate_sigmas"], context.side
    )


OPTIONS = {"sigma_m": 0.3, "sigma_rate_m_s": 0.5, "accel_m_s2": nan, "gate_sigmas": 4.0}
BOUNDS = {**NOISE, "accel_m_s2": POSITIVE}

ESTIMATOR = Estimator(
    name="direct",
    begin=begin,
    observe=observe,
    carry=carry,
    covariance=covariance,
    parameters=parameters,
    options=OPTIONS,
    bounds=BOUNDS,
    needs=frozenset({"range", "speed", "turn_rate"}),
    gives=frozenset({"r", "r_dot", "V", "u", "theta"}),
    source="Kalman filter; polar kinematics of Hashemi et al. 2013",
)
