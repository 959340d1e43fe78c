"""Range and the bearing from line of sight to heading, from range and the turn rate flown. No compass.

State (r, theta) of the paper's polar form. Over a motion that is known from speed and turn rate the target stands
still, so the state moves exactly, as a point seen from a rigid body that moves. theta starts unknown: a ring of
extended Kalman filters covers it, and +theta and -theta, which look alike until the vehicle has turned, live on until
the ranges decide. Wind and speed errors are process noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, hypot, isnan, log, nan, pi, sin
from typing import NamedTuple

from circumnav_mav.guidance.bounds import ALARM, NOISE, forgets, refuse_options
from circumnav_mav.guidance.estimators.gate import AGREE_S, compared, refuse, remember, restarted, shelved
from circumnav_mav.guidance.estimators.ring import (
    NEVER,
    TWIN,
    all_refuse,
    best_of,
    log_likelihood,
    merge,
    prune,
    smoothed,
    unflown,
)
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

TURN = 2.0 * pi

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
    r0, theta, prr, prt, ptt, stir, log_weight = h
    dt, ahead, left, turn, _, _, _ = m
    c0, s0 = cos(theta), sin(theta)
    x, y = r0 * c0 - ahead, -r0 * s0 - left
    r = hypot(x, y)
    if r < 1e-3:
        r = 1e-3
    c, s = (x * c0 - y * s0) / r, (y * c0 + x * s0) / r  # of the angle that the line of sight swung
    # dr' = c dr - r0 s dtheta;  dtheta' = (s dr + r0 c dtheta) / r'
    b, d, e = -r0 * s, s / r, r0 * c / r
    grr, grt, gtr, gtt = c * prr + b * prt, c * prt + b * ptt, d * prr + e * prt, d * prt + e * ptt
    return Polar(
        r,
        (turn - atan2(y, x) + pi) % TURN - pi,
        c * grr + b * grt + stir * par.q_r * dt,
        d * grr + e * grt,
        d * gtr + e * gtt + stir * par.q_theta * dt,
        stir,
        log_weight,
    )


def use_range(h: Polar, z: float, variance: float, gate: float) -> tuple[Polar, float]:
    """Return the hypothesis after a range, and its normalised innovation squared; beyond the gate it only costs."""
    r, theta, prr, prt, ptt, stir, log_weight = h
    error, s = z - r, prr + variance
    nis, most = error * error / s, gate * gate
    if nis > most:  # log_likelihood, written out here and below: the filter's whole cost is this and `predict`
        return Polar(r, theta, prr, prt, ptt, stir, log_weight - 0.5 * (most + log(s))), nis
    log_weight -= 0.5 * (nis + log(s))
    kr, kt = prr / s, prt / s
    return (
        Polar(r + kr * error, theta + kt * error, prr - kr * prr, prt - kr * prt, ptt - kt * prt, stir, log_weight),
        nis,
    )


def use_rate(h: Polar, z: float, V: float, variance: float, gate: float) -> Polar:
    """Return the hypothesis after a range rate -V cos(theta)."""
    r, theta, prr, prt, ptt, stir, log_weight = h
    error, slope = z + V * cos(theta), V * sin(theta)
    gr, gt = slope * prt, slope * ptt
    s = slope * gt + variance
    nis = error * error / s
    log_weight += log_likelihood(nis, s, gate)
    if nis > gate * gate:
        return Polar(r, theta, prr, prt, ptt, stir, log_weight)
    kr, kt = gr / s, gt / s
    return Polar(r + kr * error, theta + kt * error, prr - kr * gr, prt - kr * gt, ptt - kt * gt, stir, log_weight)


def again(h: Polar, stir: float, log_weight: float) -> Polar:
    """Return the hypothesis with another noise and weight."""
    return Polar(h.r, h.theta, h.prr, h.prt, h.ptt, stir, log_weight)


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


def observe(bank: list[Polar], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank to the reading, judge it and use it; take a shelved belief back when ranges fit it again."""
    if isnan(mem.shelf_s):
        return follow(bank, mem, m, z, par)
    h = bank.pop()
    after = follow(bank, mem, m, z, par)
    if not isnan(after.shelf_s):  # a newer one is on the shelf
        return after
    h = predict(h, m, par)
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    used, nis = use_range(h, z.r, sigma_r * sigma_r, par.gate)
    after = compared(after, mem, m.dt, z.r - h.r, nis, par.gate, 2.0 * par.gate * sigma_r)
    if after.verdict == RETURNED:
        bank.clear()
        bank.append(again(used, used.stir, 0.0))
    elif not isnan(after.shelf_s):
        bank.append(h)
    return after


def follow(bank: list[Polar], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank, nothing on the shelf, to the reading, judge it and use it."""
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    variance = sigma_r * sigma_r
    if len(bank) == 0:
        seed(bank, z, par, variance)
        return remember(mem, m.dt, nan, 0.0, 1.0)
    used, nis = [], []
    for i in range(len(bank)):
        bank[i] = predict(bank[i], m, par)
        h, n = use_range(bank[i], z.r, variance, par.gate)
        used.append(h)
        nis.append(n)
    leader = nis[0]
    error = z.r - bank[0].r
    if all_refuse(bank, nis, par.gate):
        settled = len(bank) <= 2 * len(STIRS) and mem.stood_s >= AGREE_S
        mem = refuse(mem, z.r, m.dt, 2.0 * par.V, 2.0 * par.gate * sigma_r, error)
        if mem.verdict == RESTARTED:
            falls = bank[0]
            seed(bank, z, par, variance)
            if settled:
                bank.append(again(falls, falls.stir, NEVER))
                return shelved(mem, 0.0, 0.0)
        return mem
    rated = not isnan(z.r_dot)
    for i in range(len(bank)):
        bank[i] = use_rate(used[i], z.r_dot, m.V, par.sigma_r_dot**2, par.gate) if rated else used[i]
    if len(bank) > len(STIRS):
        best, alike = bank[best_of(bank)], []
        for h in bank:
            alike.append(same(h, best))
        merge(bank, alike)
    prune(bank)
    for stir in unflown(bank, STIRS):
        bank.append(again(bank[0], stir, bank[0].log_weight - TWIN))
    alarm = smoothed(mem.alarm, min(leader, par.gate**2))
    if alarm > par.alarm:
        seed(bank, z, par, variance)
        return restarted(mem, leader, 1.0)
    known = 1.0 if bank[0].ptt < 0.25 else mem.known
    return remember(mem, m.dt, leader, known, alarm, error)


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
    refuse_options(given, BOUNDS)
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
BOUNDS = {
    **NOISE,
    "alarm_nis": ALARM,
    "drift_share": forgets("the range", 0.3, 1.0),
    "turn_share": forgets("the bearing", 0.5, 1.0),
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
    bounds=BOUNDS,
    needs=frozenset({"range", "speed", "turn_rate"}),
    gives=frozenset({"r", "r_dot", "V", "u", "theta"}),
    source="extended Kalman filters on the polar form of Hashemi et al. 2013",
)
