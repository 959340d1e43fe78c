"""Where the target is, and how the vehicle is drifted past it, from range, heading and airspeed.

State (p, w, s): p = target minus vehicle, w = drift = wind minus target velocity, s = airspeed scale (true airspeed is
(1 + s) times the believed one). Over a motion of reckoned displacement d in time dt, exactly and linearly,
    p' = p - (1 + s) d - w dt,   w' = w,   s' = s
and a reading is |p|. Wind and a moving target are the same unknown, so a moving target costs nothing extra. One range
leaves a ring: it is covered with Gaussians in polar coordinates, each an extended Kalman filter, until the turns of
the flight leave one. An alarm on its innovations starts the ring again.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, exp, hypot, isnan, nan, pi, sin

from circumnav_mav.guidance.bounds import ALARM, NOISE, Bound, forgets, refuse_options
from circumnav_mav.guidance.estimators.drift_gaussian import (
    STILL,
    Drift,
    Leg,
    Parameters,
    again,
    cut,
    predict,
    use_range,
    use_rate,
)
from circumnav_mav.guidance.estimators.gate import AGREE_S, compared, refuse, remember, restarted, shelved
from circumnav_mav.guidance.estimators.ring import (
    LIKELY,
    NEVER,
    TWIN,
    all_refuse,
    best_of,
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
    Rival,
    no_rivals,
)

RING = 16
"""Gaussians over the bearing at the start."""

KEPT_RATE = 0.2
"""How well a belief that falls knows the range rate, as a share of the airspeed."""

STIRS = (1.0, 30.0, 900.0)
"""Calm, gusty, wild: how many times the usual noise drives drift and scale. Once the ring is gone, one of each is
flown, and the readings say which it is."""


SLOW_SHARE, LATE_S, GATHERS_S = 0.7, 0.05, 1.0
"""Below this share of the nominal speed a vehicle gathers way. It takes about so long, and is told so late."""


def begin(par: Parameters) -> list[Drift]:
    """Return an empty bank."""
    bank = [ring_member(0.0, 0.0, 1.0, par, 0.0)]
    bank.pop()
    return bank


def ring_member(r: float, bearing: float, variance: float, par: Parameters, log_weight: float) -> Drift:
    """Return one Gaussian of the ring: the range well known, the bearing within its share of the circle."""
    c, s = cos(bearing), sin(bearing)
    across = (r * pi / RING) ** 2
    ww = par.sigma_w**2
    xx, xy, yy = variance * c * c + across * s * s, (variance - across) * s * c, variance * s * s + across * c * c
    ss = par.sigma_s**2
    px, py = r * c, r * s
    return Drift(
        px, py, 0.0, 0.0, 0.0, xx, xy, 0.0, 0.0, 0.0, yy, 0.0, 0.0, 0.0, ww, 0.0, 0.0, ww, 0.0, ss, 1.0, log_weight
    )


def seed(bank: list[Drift], z: Reading, par: Parameters, variance: float, first: float) -> None:
    """Fill the ring; the one at the bearing `first` [rad] leads."""
    bank.clear()
    for i in range(RING):
        bank.append(ring_member(z.r, first + 2.0 * pi * i / RING, variance, par, 0.0))


def seed_again(bank: list[Drift], mem: Memory, m: Moved, z: Reading, par: Parameters, variance: float) -> None:
    """Fill the ring once more, with what a belief that falls was hardly wrong in.

    It followed the ranges, so it knew their rate; and it is sooner wrong in the drift than in the bearing by a right
    angle. A ring that leads blindly turns the vehicle round, as likely as not towards a target that is near by now.
    """
    bank[0] = bank[heir(bank, par)]
    here = carry(bank, mem, Moved(0.0, 0.0, 0.0, 0.0, m.V, m.u, m.psi), par)
    seed(bank, z, par, variance, atan2(here.py, here.px))
    for i in range(RING):
        bank[i] = use_rate(bank[i], here.r_dot, m, (KEPT_RATE * par.V) ** 2, par.gate)
    prune(bank)


def alike(bank: list[Drift]) -> list[bool]:
    """Return which hypotheses have become the same as the likeliest: one kind of air, one place, one drift."""
    best = bank[best_of(bank)]
    px, py = best.px, best.py
    near, same = 0.25 * (best.xx + best.yy), []
    for h in bank:
        dx, twin = h.px - px, False
        if dx * dx <= near:  # few are
            dy, du, dv = h.py - py, h.wx - best.wx, h.wy - best.wy
            twin = dx * dx + dy * dy <= near and du * du + dv * dv < 0.25 * (best.uu + best.vv) and h.stir == best.stir
        same.append(twin)
    return same


def possible(h: Drift, par: Parameters) -> bool:
    return hypot(h.wx, h.wy) <= par.w_most and abs(h.s) <= par.s_most


def heir(bank: list[Drift], par: Parameters) -> int:
    """Return the index of the likeliest hypothesis that is possible; 0, the leader, where none is likely."""
    likely, best, i = bank[best_of(bank)].log_weight - LIKELY, 0, 0
    for h in bank:
        if h.log_weight > likely and possible(h, par):
            likely, best = h.log_weight, i
        i += 1  # noqa: SIM113 (plain Python is quicker so)
    return best


def observe(bank: list[Drift], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank to the reading, judge it and use it; take a shelved belief back when ranges fit it again."""
    if isnan(mem.shelf_s):
        return follow(bank, mem, m, z, par)
    h = bank.pop()
    after = follow(bank, mem, m, z, par)
    if isnan(m.psi) or not isnan(after.shelf_s):  # nothing to carry it by; or a newer one is on the shelf
        return after
    leg, sigma_r = flown(m, par), par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    used, nis, error, _ = use_range(h, leg, z.r, sigma_r * sigma_r, par.gate)
    after = compared(after, mem, m.dt, error, nis, par.gate, 2.0 * par.gate * sigma_r)
    if after.verdict == RETURNED:
        bank.clear()
        bank.append(again(used, used.stir, 0.0))
    elif not isnan(after.shelf_s):
        bank.append(predict(h, leg))
    return after


def flown(m: Moved, par: Parameters) -> Leg:
    """Return the leg of a motion. A vehicle that gathers way is told of it late: its reckoning is noisier."""
    q_p = par.q_p if m.V > SLOW_SHARE * par.V else max(par.q_p, (LATE_S * par.V) ** 2 / GATHERS_S)
    dx, dy = displacement(m)
    return Leg(dx, dy, m.dt, q_p * m.dt, par.q_w * m.dt, par.q_s * m.dt)


def displacement(m: Moved) -> tuple[float, float]:
    """Return the reckoned displacement east and north, m."""
    psi = m.psi - m.turn
    c, s = cos(psi), sin(psi)
    return m.ahead * c - m.left * s, m.ahead * s + m.left * c


def follow(bank: list[Drift], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank, nothing on the shelf, to the reading, judge it and use it."""
    sigma_r, gate = par.sigma_r if isnan(z.sigma_r) else z.sigma_r, par.gate
    variance = sigma_r * sigma_r
    if len(bank) == 0 or isnan(m.psi):  # without a heading, a displacement has no direction
        seed(bank, z, par, variance, 0.0)
        return remember(mem, m.dt, nan, 0.0 if isnan(m.psi) else 1.0, 1.0)
    leg = flown(m, par)
    used, nis, carried, error = tried(bank, leg, z.r, variance, gate)
    if all_refuse(bank, nis, gate):
        carry_only(bank, leg, used, nis, carried, gate)
        settled = len(bank) <= 2 * len(STIRS) and mem.stood_s >= AGREE_S
        mem = refuse(mem, z.r, m.dt, 2.0 * par.V, 2.0 * gate * sigma_r, error)
        if mem.verdict == RESTARTED:
            falls = bank[0]
            seed(bank, z, par, variance, atan2(falls.py, falls.px))
            if settled:
                bank.append(again(falls, falls.stir, NEVER))
                return shelved(mem, 0.0, 0.0)
        return mem
    rated = not isnan(z.r_dot)
    for i in range(len(bank)):
        bank[i] = use_rate(used[i], z.r_dot, m, par.sigma_r_dot**2, gate) if rated else used[i]
    if len(bank) > len(STIRS):
        merge(bank, alike(bank))
    prune(bank)
    for stir in unflown(bank, STIRS):
        bank.append(again(bank[0], stir, bank[0].log_weight - TWIN))
    leader = nis[0]
    alarm = smoothed(mem.alarm, min(leader, gate * gate))
    if alarm > par.alarm or not possible(bank[0], par):
        seed_again(bank, mem, m, z, par, variance)
        return restarted(mem, leader, 1.0)
    return remember(mem, m.dt, leader, 1.0, alarm, error)


def tried(
    bank: list[Drift], leg: Leg, z: float, variance: float, gate: float
) -> tuple[list[Drift], list[float], list[bool], float]:
    """Return what a leg and a range at its end would make of each hypothesis, and how they stand to that range.

    That is: their normalised innovations squared, which of them stand at the end of the leg already, and the leader's
    innovation, m. What has become too long is cut in the bank, and its parts do; the others stay at the beginning.
    """
    used, nis = [], []
    carried, errors = [], []
    for i in range(len(bank)):
        after, n, error, too_long = use_range(bank[i], leg, z, variance, gate)
        too_long = too_long and len(bank) <= RING
        if too_long:
            bank[i], left, right = cut(predict(bank[i], leg))
            bank.append(left)
            bank.append(right)
            after, n, error, _ = use_range(bank[i], STILL, z, variance, gate)
        used.append(after)
        nis.append(n)
        carried.append(too_long)
        errors.append(error)
    for i in range(len(used), len(bank)):
        after, n, _, _ = use_range(bank[i], STILL, z, variance, gate)
        used.append(after)
        nis.append(n)
        carried.append(True)
    return used, nis, carried, errors[0]


def carry_only(
    bank: list[Drift], leg: Leg, used: list[Drift], nis: list[float], carried: list[bool], gate: float
) -> None:
    """Carry the bank over a leg whose range was tried, and refused."""
    for i in range(len(bank)):
        if not nis[i] <= gate * gate:  # it was carried, and had to pay
            bank[i] = again(used[i], used[i].stir, bank[i].log_weight)
        elif not carried[i]:
            bank[i] = predict(bank[i], leg)


def carry(bank: list[Drift], mem: Memory, m: Moved, par: Parameters) -> Estimate:
    """Return the leading hypothesis after a motion."""
    h = bank[0]
    dx, dy = displacement(m)
    V = (1.0 + h.s) * m.V
    px, py = h.px - (1.0 + h.s) * dx - h.wx * m.dt, h.py - (1.0 + h.s) * dy - h.wy * m.dt
    r = hypot(px, py)
    vx, vy = V * cos(m.psi) + h.wx, V * sin(m.psi) + h.wy
    r_dot = -(vx * px + vy * py) / r if r > 0.0 else 0.0
    theta = (m.psi - atan2(py, px) + pi) % (2.0 * pi) - pi
    return Estimate(r, r_dot, V, m.u, theta, m.psi, px, py, h.wx, h.wy)


def covariance(bank: list[Drift]) -> tuple[float, ...]:
    """Return (var r, var px, cov px py, var py [m^2], var wx, var wy [m^2/s^2], var s) of the leading hypothesis."""
    if not bank:
        return (nan, nan, nan, nan, nan, nan, nan)
    h = bank[0]
    r = max(hypot(h.px, h.py), 1e-3)
    c, s = h.px / r, h.py / r
    return (c * c * h.xx + 2.0 * s * c * h.xy + s * s * h.yy, h.xx, h.xy, h.yy, h.uu, h.vv, h.ss)


def places(bank: list[Drift]) -> list[tuple[float, float]]:
    """Return where each hypothesis has the target [m], east and north of the vehicle."""
    return [(h.px, h.py) for h in bank]


def rivals(bank: list[Drift], m: Moved) -> list[Rival]:
    """Return the likely hypotheses after a motion, while more than six are kept: three kinds of air of two places are
    left to the law. Covariances are as of the last range.
    """
    views = no_rivals(bank, m)
    if len(bank) <= 2 * len(STIRS):
        return views
    most, (dx, dy) = bank[best_of(bank)].log_weight, displacement(m)
    for h in bank:
        if h.log_weight > most - LIKELY:
            px, py, wx, wy, s, xx, xy, xu, xv, _, yy, yu, yv, _, uu, uv, _, vv, _, _, _, log_weight = h
            px, py = px - (1.0 + s) * dx - wx * m.dt, py - (1.0 + s) * dy - wy * m.dt
            views.append(Rival(exp(log_weight - most), px, py, wx, wy, xx, xy, xu, xv, yy, yu, yv, uu, uv, vv))
    return views


def parameters(options: Mapping[str, float], context: EstimatorContext) -> Parameters:
    """Return the kernel's parameters; priors and noises are shares of the airspeed, so that they suit any vehicle."""
    given = {**OPTIONS, **options}
    refuse_options(given, BOUNDS)
    V, omega = context.V, context.V / context.r_a
    return Parameters(
        V=V,
        sigma_r=given["sigma_m"],
        sigma_r_dot=given["sigma_rate_m_s"],
        sigma_w=given["drift_share"] * V,
        sigma_s=given["scale_sigma"],
        q_p=(given["wander_share"] * V) ** 2 / omega,
        q_w=(given["gust_share"] * V) ** 2 * omega,
        q_s=given["scale_wander"] ** 2 * omega,
        gate=given["gate_sigmas"],
        alarm=given["alarm_nis"],
        w_most=0.95 * V,
        s_most=S_MOST,
    )


S_MOST = 0.35
"""The greatest share by which the speed is believed to be wrong."""

OPTIONS = {
    "sigma_m": 0.3,
    "sigma_rate_m_s": 0.5,
    "drift_share": 0.3,
    "scale_sigma": 0.07,
    "wander_share": 0.002,
    "gust_share": 0.003,
    "scale_wander": 0.001,
    "gate_sigmas": 4.0,
    "alarm_nis": 3.0,
}
BOUNDS = {
    **NOISE,
    "alarm_nis": ALARM,
    "drift_share": Bound(high=1.0, most=2.0, large="expects a drift faster than the vehicle, which none can fly in"),
    "scale_sigma": Bound(high=S_MOST, most=1.0, large=f"expects a wronger speed than is ever believed, {S_MOST:g}"),
    "wander_share": forgets("the position", 0.1, 0.5),
    "gust_share": forgets("the drift", 0.1, 1.0),
    "scale_wander": forgets("how wrong the speed is", 0.1, 1.0),
}

ESTIMATOR = Estimator(
    name="drift",
    begin=begin,
    observe=observe,
    carry=carry,
    covariance=covariance,
    places=places,
    rivals=rivals,
    parameters=parameters,
    options=OPTIONS,
    bounds=BOUNDS,
    needs=frozenset({"range", "speed", "turn_rate", "heading"}),
    gives=frozenset({"r", "r_dot", "V", "u", "theta", "psi", "px", "py", "wx", "wy"}),
    source="ring of extended Kalman filters",
)
