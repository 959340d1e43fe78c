"""Range and the bearing from line of sight to heading, from range and the turn rate flown. No compass.

State (r, theta) of the paper's polar form. Over a motion that is known from speed and turn rate the target stands
still, so the state moves exactly, as a point seen from a rigid body that moves. theta starts unknown: a ring of
extended Kalman filters covers it, and +theta and -theta, which look alike until the vehicle has turned, live on until
the ranges decide. Wind and speed errors are process noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, hypot, isnan, nan, pi, sin
from typing import NamedTuple

from circumnav_mav.guidance.estimators.gate import refuse, remember
from circumnav_mav.guidance.estimators.ring import LIKELY, TWIN, best_of, log_likelihood, prune, smoothed
from circumnav_mav.guidance.kernel import (
    RESTARTED,
    Estimate,
    Estimator,
    EstimatorContext,
    Memory,
    Moved,
    Reading,
)

RING = 8
"""Hypotheses of theta at the start."""


STIRS = (1.0, 300.0)
"""Calm air, and wind or lag that the model does not have: how many times the usual noise drives the state."""


class Parameters(NamedTuple):
    V: float  # nominal speed, m/s
    sigma_r: float  # of a reading that claims none, m
    sigma_r_dot: float  # of a measured range rate, m/s
    q_r: float  # density of the noise that drives r, m^2/s
    q_theta: float  # density of the noise that drives theta, rad^2/s
    gate: float  # standard deviations
    alarm: float  # smoothed normalised innovation squared that restarts the ring
    side: float  # +1 target wanted on the right, -1 on the left


class Polar(NamedTuple):
    r: float  # m
    theta: float  # rad
    prr: float
    prt: float
    ptt: float
    stir: float  # how many times the usual noise drives it
    log_weight: float


def predict(h: Polar, m: Moved, par: Parameters) -> Polar:
    """Return the hypothesis after a motion of the vehicle."""
    x, y = h.r * cos(h.theta) - m.ahead, -h.r * sin(h.theta) - m.left
    r, phi = hypot(x, y), atan2(y, x) + h.theta  # phi: how far the line of sight swung
    c, s = cos(phi), sin(phi)
    # dr' = c dr - r0 s dtheta;  dtheta' = (s dr + r0 c dtheta) / r'
    a, b, d, e = c, -h.r * s, s / max(r, 1e-3), h.r * c / max(r, 1e-3)
    prr, prt, ptt = h.prr, h.prt, h.ptt
    return Polar(
        r,
        (h.theta - phi + m.turn + pi) % (2.0 * pi) - pi,
        a * a * prr + 2.0 * a * b * prt + b * b * ptt + h.stir * par.q_r * m.dt,
        a * d * prr + (a * e + b * d) * prt + b * e * ptt,
        d * d * prr + 2.0 * d * e * prt + e * e * ptt + h.stir * par.q_theta * m.dt,
        h.stir,
        h.log_weight,
    )


def correct(h: Polar, error: float, a: float, b: float, variance: float, gate: float) -> Polar:
    """Return the update by the innovation `error` of the measurement a r + b theta; beyond the gate it only costs."""
    gr, gt = a * h.prr + b * h.prt, a * h.prt + b * h.ptt
    s = a * gr + b * gt + variance
    nis = error * error / s
    log_weight = h.log_weight + log_likelihood(nis, s, gate)
    if nis > gate * gate:
        return Polar(h.r, h.theta, h.prr, h.prt, h.ptt, h.stir, log_weight)
    return Polar(
        h.r + gr / s * error,
        h.theta + gt / s * error,
        h.prr - gr * gr / s,
        h.prt - gr * gt / s,
        h.ptt - gt * gt / s,
        h.stir,
        log_weight,
    )


def begin(par: Parameters) -> list[Polar]:
    """Return an empty bank."""
    bank = [Polar(nan, nan, nan, nan, nan, 1.0, 0.0)]
    bank.pop()
    return bank


def seed(bank: list[Polar], z: Reading, par: Parameters, variance: float) -> None:
    """Fill the ring; the wanted side is the likelier one by a little, so that ties do not hang in the air."""
    bank.clear()
    step = 2.0 * pi / RING
    for i in range(RING):
        theta = -pi + (i + 0.5) * step
        bank.append(Polar(z.r, theta, variance, 0.0, (0.5 * step) ** 2, 1.0, 0.1 if theta * par.side > 0.0 else 0.0))


def same(h: Polar, best: Polar) -> bool:
    turn = (h.theta - best.theta + pi) % (2.0 * pi) - pi
    return h.stir == best.stir and turn * turn < best.ptt and (h.r - best.r) ** 2 < best.prr


def merge(bank: list[Polar]) -> None:
    """Drop what has become the same as the best; where that is the leader, the best takes its place."""
    best = best_of(bank)
    for i in range(len(bank) - 1, 0, -1):
        if i != best and same(bank[i], bank[best]):
            bank.pop(i)
            if i < best:
                best -= 1
    if best > 0 and same(bank[0], bank[best]):
        bank[0] = bank.pop(best)


def twin(bank: list[Polar]) -> None:
    """Have each kind of air flown by one hypothesis at least."""
    if len(bank) > 2 * len(STIRS):
        return
    for stir in STIRS:
        flown = False
        for h in bank:
            flown = flown or h.stir == stir
        if not flown:
            h = bank[0]
            bank.append(Polar(h.r, h.theta, h.prr, h.prt, h.ptt, stir, h.log_weight - TWIN))


def observe(bank: list[Polar], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank to the reading, judge it and use it."""
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    variance = sigma_r * sigma_r
    if len(bank) == 0:
        seed(bank, z, par, variance)
        return remember(mem, m.dt, nan, 0.0, 1.0)
    least, best_nis, best = 1e300, 0.0, 0
    top = bank[best_of(bank)].log_weight
    for i in range(len(bank)):
        h = bank[i] = predict(bank[i], m, par)
        nis = (z.r - h.r) ** 2 / (h.prr + variance)
        if h.log_weight > top - LIKELY and nis < least:
            least = nis
        if i == best:
            best_nis = nis
    if least > par.gate**2:
        mem = refuse(mem, z.r, m.dt, 2.0 * par.V, 2.0 * par.gate * sigma_r)
        if mem.verdict == RESTARTED:
            seed(bank, z, par, variance)
        return mem
    for i in range(len(bank)):
        bank[i] = correct(bank[i], z.r - bank[i].r, 1.0, 0.0, variance, par.gate)
        if not isnan(z.r_dot):
            h = bank[i]
            error = z.r_dot + m.V * cos(h.theta)
            bank[i] = correct(h, error, 0.0, m.V * sin(h.theta), par.sigma_r_dot**2, par.gate)
    if len(bank) > len(STIRS):
        merge(bank)
    prune(bank)
    twin(bank)
    alarm = smoothed(mem.alarm, min(best_nis, par.gate**2))
    if alarm > par.alarm:
        seed(bank, z, par, variance)
        return Memory(mem.known, RESTARTED, best_nis, 1.0, nan, 0.0, 0.0)
    known = 1.0 if bank[0].ptt < 0.25 else mem.known
    return remember(mem, m.dt, best_nis, known, alarm)


def carry(bank: list[Polar], mem: Memory, m: Moved, par: Parameters) -> Estimate:
    """Return the leading hypothesis after a motion; with a compass also where the target is."""
    h = predict(bank[0], m, par)
    sight = m.psi - h.theta
    return Estimate(h.r, -m.V * cos(h.theta), m.V, m.u, h.theta, m.psi, h.r * cos(sight), h.r * sin(sight), nan, nan)


def covariance(bank: list[Polar]) -> tuple[float, ...]:
    """Return (var r [m^2], cov r theta, var theta [rad^2]) of the leading hypothesis at the last reading."""
    if not bank:
        return (nan, nan, nan)
    h = bank[0]
    return (h.prr, h.prt, h.ptt)


def places(bank: list[Polar]) -> list[tuple[float, float]]:
    """Return where each hypothesis has the target [m], ahead and left of the vehicle."""
    return [(h.r * cos(h.theta), -h.r * sin(h.theta)) for h in bank]


def parameters(options: Mapping[str, float], context: EstimatorContext) -> Parameters:
    """Return the kernel's parameters; noises given as a share of speed and of the turn rate on the circle."""
    given = {**OPTIONS, **options}
    for name, value in given.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be above 0, not {value}")
    V, omega = context.V, context.V / context.r_a
    return Parameters(
        V=V,
        sigma_r=given["sigma_m"],
        sigma_r_dot=given["sigma_rate_m_s"],
        q_r=(given["drift_share"] * V) ** 2 / omega,
        q_theta=given["turn_share"] ** 2 * omega,
        gate=given["gate_sigmas"],
        alarm=given["alarm_nis"],
        side=context.side,
    )


OPTIONS = {
    "sigma_m": 0.3,
    "sigma_rate_m_s": 0.5,
    "drift_share": 0.01,
    "turn_share": 0.01,
    "gate_sigmas": 4.0,
    "alarm_nis": 5.0,
}

ESTIMATOR = Estimator(
    name="polar",
    begin=begin,
    observe=observe,
    carry=carry,
    covariance=covariance,
    places=places,
    parameters=parameters,
    options=OPTIONS,
    needs=frozenset({"range", "speed", "turn_rate"}),
    gives=frozenset({"r", "r_dot", "V", "u", "theta"}),
    source="extended Kalman filters on the polar form of Hashemi et al. 2013",
)
