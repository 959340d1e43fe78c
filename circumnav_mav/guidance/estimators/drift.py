"""Where the target is, and how the vehicle is drifted past it, from range, heading and airspeed.

State (p, w, s): p = target minus vehicle, w = drift = wind minus target velocity, s = airspeed scale (true airspeed is
(1 + s) times the believed one). Over a motion of reckoned displacement d in time dt, exactly and linearly,
    p' = p - (1 + s) d - w dt,   w' = w,   s' = s
and a reading is |p|. Wind and a moving target are the same unknown, so a moving target costs nothing extra. One range
leaves a ring: it is covered with Gaussians, each a Kalman filter of second order in the curvature of the circle of
equal range, until the turns of the flight leave one. An alarm on its innovations starts the ring again.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, hypot, isnan, nan, pi, sin
from typing import NamedTuple

from circumnav_mav.guidance.estimators.gate import refuse, remember
from circumnav_mav.guidance.estimators.ring import LIKELY, best_of, log_likelihood, prune, smoothed
from circumnav_mav.guidance.kernel import (
    RESTARTED,
    Estimate,
    Estimator,
    EstimatorContext,
    Memory,
    Moved,
    Reading,
)

RING = 24
"""Gaussians over the bearing at the start."""


class Parameters(NamedTuple):
    V: float  # nominal airspeed, m/s
    sigma_r: float  # of a reading that claims none, m
    sigma_r_dot: float  # of a measured range rate, m/s
    sigma_w: float  # prior of each component of the drift, m/s
    sigma_s: float  # prior of the airspeed scale
    q_p: float  # density of the noise that drives p, m^2/s
    q_w: float  # that drives w, m^2/s^3
    q_s: float  # that drives s, 1/s
    gate: float  # standard deviations
    alarm: float  # smoothed normalised innovation squared that restarts the ring
    w_most: float  # greatest drift that is plausible, m/s
    s_most: float  # greatest scale that is plausible


class Drift(NamedTuple):
    """Mean and the upper triangle of the covariance. x east, y north; p m, w m/s."""

    px: float
    py: float
    wx: float
    wy: float
    s: float
    xx: float
    xy: float
    xu: float  # u, v: the two components of w
    xv: float
    xs: float
    yy: float
    yu: float
    yv: float
    ys: float
    uu: float
    uv: float
    us: float
    vv: float
    vs: float
    ss: float
    log_weight: float


def predict(h: Drift, dx: float, dy: float, dt: float, par: Parameters) -> Drift:
    """Return the hypothesis after the reckoned displacement (dx, dy) in dt. Exact: the motion is linear."""
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, log_weight = h
    # cov(p') = cov(p - s d - w dt), the cross terms first
    xu1, xv1, xs1 = xu - dx * us - dt * uu, xv - dx * vs - dt * uv, xs - dx * ss - dt * us
    yu1, yv1, ys1 = yu - dy * us - dt * uv, yv - dy * vs - dt * vv, ys - dy * ss - dt * vs
    q = par.q_w * dt
    return Drift(
        px - (1.0 + s) * dx - wx * dt,
        py - (1.0 + s) * dy - wy * dt,
        wx,
        wy,
        s,
        xx - dx * (xs + xs1) - dt * (xu + xu1) + par.q_p * dt,
        xy - dy * xs - dt * xv - dx * ys1 - dt * yu1,
        xu1,
        xv1,
        xs1,
        yy - dy * (ys + ys1) - dt * (yv + yv1) + par.q_p * dt,
        yu1,
        yv1,
        ys1,
        uu + q,
        uv,
        us,
        vv + q,
        vs,
        ss + par.q_s * dt,
        log_weight,
    )


def correct(h: Drift, error: float, a: tuple[float, float, float, float, float], variance: float, gate: float) -> Drift:
    """Return the update by the innovation `error` of the measurement a . state; beyond the gate it only costs."""
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, log_weight = h
    ax, ay, au, av, ac = a
    gx = ax * xx + ay * xy + au * xu + av * xv + ac * xs
    gy = ax * xy + ay * yy + au * yu + av * yv + ac * ys
    gu = ax * xu + ay * yu + au * uu + av * uv + ac * us
    gv = ax * xv + ay * yv + au * uv + av * vv + ac * vs
    gs = ax * xs + ay * ys + au * us + av * vs + ac * ss
    sv = ax * gx + ay * gy + au * gu + av * gv + ac * gs + variance
    nis = error * error / sv
    weight = log_weight + log_likelihood(nis, sv, gate)
    if nis > gate * gate:
        return Drift(px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, weight)
    return gained(h, gx, gy, gu, gv, gs, 1.0 / sv, error, weight)


def gained(
    h: Drift, gx: float, gy: float, gu: float, gv: float, gs: float, inv: float, error: float, weight: float
) -> Drift:
    """Return the Kalman update with the covariance column g of the innovation and its inverse variance."""
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, _ = h
    kx, ky, ku, kv, ks = gx * inv, gy * inv, gu * inv, gv * inv, gs * inv
    return Drift(
        px + kx * error,
        py + ky * error,
        wx + ku * error,
        wy + kv * error,
        s + ks * error,
        xx - kx * gx,
        xy - kx * gy,
        xu - kx * gu,
        xv - kx * gv,
        xs - kx * gs,
        yy - ky * gy,
        yu - ky * gu,
        yv - ky * gv,
        ys - ky * gs,
        uu - ku * gu,
        uv - ku * gv,
        us - ku * gs,
        vv - kv * gv,
        vs - kv * gs,
        ss - ks * gs,
        weight,
    )


def innovation(h: Drift, z: float, variance: float) -> tuple[float, float, float]:
    """Return (error, normalised innovation squared, variance of the curvature) of a range.

    |p| of a Gaussian p is longer than |mean p| by T / 2r and spreads by T / sqrt(2) r, T = variance across the sight.
    """
    r = max(hypot(h.px, h.py), 1e-3)
    c, s = h.px / r, h.py / r
    across = s * s * h.xx - 2.0 * s * c * h.xy + c * c * h.yy
    along = c * c * h.xx + 2.0 * s * c * h.xy + s * s * h.yy
    bend = across / (2.0 * r)
    error = z - r - bend
    return error, error * error / (along + 2.0 * bend * bend + variance), 2.0 * bend * bend


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
    px, py = (r - across / (2.0 * max(r, 1e-3))) * c, (r - across / (2.0 * max(r, 1e-3))) * s
    return Drift(px, py, 0.0, 0.0, 0.0, xx, xy, 0.0, 0.0, 0.0, yy, 0.0, 0.0, 0.0, ww, 0.0, 0.0, ww, 0.0, ss, log_weight)


def seed(bank: list[Drift], z: Reading, par: Parameters, variance: float) -> None:
    """Fill the ring."""
    bank.clear()
    for i in range(RING):
        bank.append(ring_member(z.r, 2.0 * pi * i / RING, variance, par, 0.0))


def merge(bank: list[Drift]) -> None:
    """Drop what has become the same as the best."""
    best = bank[best_of(bank)]
    for i in range(len(bank) - 1, -1, -1):
        h = bank[i]
        dx, dy = h.px - best.px, h.py - best.py
        du, dv = h.wx - best.wx, h.wy - best.wy
        if (
            h.log_weight < best.log_weight
            and dx * dx + dy * dy < 0.25 * (best.xx + best.yy)
            and du * du + dv * dv < 0.25 * (best.uu + best.vv)
        ):
            bank.pop(i)


def use(bank: list[Drift], i: int, m: Moved, z: Reading, variance: float, par: Parameters) -> None:
    """Update hypothesis i with a reading."""
    h = bank[i]
    r = max(hypot(h.px, h.py), 1e-3)
    c, s = h.px / r, h.py / r
    error, _, bend = innovation(h, z.r, variance)
    bank[i] = correct(h, error, (c, s, 0.0, 0.0, 0.0), variance + bend, par.gate)
    if not isnan(z.r_dot):
        h = bank[i]
        r = max(hypot(h.px, h.py), 1e-3)
        c, s = h.px / r, h.py / r
        ex, ey = m.V * cos(m.psi), m.V * sin(m.psi)
        vx, vy = (1.0 + h.s) * ex + h.wx, (1.0 + h.s) * ey + h.wy
        along = vx * c + vy * s
        row = (-(vx - along * c) / r, -(vy - along * s) / r, -c, -s, -(ex * c + ey * s))
        bank[i] = correct(h, z.r_dot + along, row, par.sigma_r_dot**2, par.gate)


def observe(bank: list[Drift], mem: Memory, m: Moved, z: Reading, par: Parameters) -> Memory:
    """Carry the bank to the reading, judge it and use it."""
    sigma_r = par.sigma_r if isnan(z.sigma_r) else z.sigma_r
    variance = sigma_r * sigma_r
    if len(bank) == 0:
        seed(bank, z, par, variance)
        return remember(mem, m.dt, nan, 1.0, 1.0)
    psi = m.psi - m.turn
    c, s = cos(psi), sin(psi)
    dx, dy = m.ahead * c - m.left * s, m.ahead * s + m.left * c
    least, best_nis, best = 1e300, 0.0, best_of(bank)
    top = bank[best].log_weight
    for i in range(len(bank)):
        bank[i] = predict(bank[i], dx, dy, m.dt, par)
        _, nis, _ = innovation(bank[i], z.r, variance)
        if bank[i].log_weight > top - LIKELY and nis < least:
            least = nis
        if i == best:
            best_nis = nis
    if least > par.gate**2:
        mem = refuse(mem, z.r, m.dt, 2.0 * par.V, 2.0 * par.gate * sigma_r)
        if mem.verdict == RESTARTED:
            seed(bank, z, par, variance)
        return mem
    for i in range(len(bank)):
        use(bank, i, m, z, variance, par)
    prune(bank)
    merge(bank)
    alarm = smoothed(mem.alarm, min(best_nis, par.gate**2))
    h = bank[best_of(bank)]
    if alarm > par.alarm or hypot(h.wx, h.wy) > par.w_most or abs(h.s) > par.s_most:
        seed(bank, z, par, variance)
        return Memory(mem.known, RESTARTED, best_nis, 1.0, nan, 0.0, 0.0)
    return remember(mem, m.dt, best_nis, 1.0, alarm)


def carry(bank: list[Drift], mem: Memory, m: Moved, par: Parameters) -> Estimate:
    """Return the likeliest hypothesis after a motion."""
    h = bank[best_of(bank)]
    psi = m.psi - m.turn
    c, s = cos(psi), sin(psi)
    dx, dy = m.ahead * c - m.left * s, m.ahead * s + m.left * c
    V = (1.0 + h.s) * m.V
    px, py = h.px - (1.0 + h.s) * dx - h.wx * m.dt, h.py - (1.0 + h.s) * dy - h.wy * m.dt
    r = hypot(px, py)
    vx, vy = V * cos(m.psi) + h.wx, V * sin(m.psi) + h.wy
    r_dot = -(vx * px + vy * py) / r if r > 0.0 else 0.0
    theta = (m.psi - atan2(py, px) + pi) % (2.0 * pi) - pi
    return Estimate(r, r_dot, V, m.u, theta, m.psi, px, py, h.wx, h.wy)


def covariance(bank: list[Drift]) -> tuple[float, ...]:
    """Return (var r, var px, cov px py, var py [m^2], var wx, var wy [m^2/s^2], var s) of the likeliest hypothesis."""
    if not bank:
        return (nan, nan, nan, nan, nan, nan, nan)
    h = bank[best_of(bank)]
    r = max(hypot(h.px, h.py), 1e-3)
    c, s = h.px / r, h.py / r
    return (c * c * h.xx + 2.0 * s * c * h.xy + s * s * h.yy, h.xx, h.xy, h.yy, h.uu, h.vv, h.ss)


def parameters(options: Mapping[str, float], context: EstimatorContext) -> Parameters:
    """Return the kernel's parameters; priors and noises are shares of the airspeed, so that they suit any vehicle."""
    given = {**OPTIONS, **options}
    for name, value in given.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be above 0, not {value}")
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
        s_most=0.35,
    )


OPTIONS = {
    "sigma_m": 0.3,
    "sigma_rate_m_s": 0.5,
    "drift_share": 0.3,
    "scale_sigma": 0.07,
    "wander_share": 0.003,
    "gust_share": 0.01,
    "scale_wander": 0.002,
    "gate_sigmas": 4.0,
    "alarm_nis": 2.5,
}

ESTIMATOR = Estimator(
    name="drift",
    begin=begin,
    observe=observe,
    carry=carry,
    covariance=covariance,
    parameters=parameters,
    options=OPTIONS,
    needs=frozenset({"range", "speed", "turn_rate", "heading", "airspeed"}),
    gives=frozenset({"r", "r_dot", "V", "u", "theta", "psi", "px", "py", "wx", "wy"}),
    source="ring of second-order extended Kalman filters",
)
