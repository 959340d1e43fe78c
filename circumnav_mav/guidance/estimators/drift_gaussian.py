"""One Gaussian of the drift filter: how it moves, and what a range or a range rate does to it. drift.py has the ring.

State (p, w, s) and equations as in drift.py.
"""

from __future__ import annotations

from math import cos, hypot, log, nan, sin, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.estimators.ring import log_likelihood
from circumnav_mav.guidance.kernel import Moved

SPLIT = 0.16
"""A hypothesis longer across the line of sight than this share of the range is cut: a Gaussian cannot bend around the
target."""


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


class Leg(NamedTuple):
    """What was flown between two readings, and the noise that it brings: the same for every hypothesis."""

    dx: float  # reckoned displacement east, m
    dy: float  # north, m
    dt: float  # s
    q_p: float  # what the variances of p gain, m^2
    q_w: float  # those of w, for each of `stir`, m^2/s^2
    q_s: float  # that of s, for each of `stir`


STILL = Leg(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


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
    stir: float  # how many times the usual noise drives w and s
    log_weight: float


def gained(
    h: Drift, gx: float, gy: float, gu: float, gv: float, gs: float, inv: float, error: float, log_weight: float
) -> Drift:
    """Return the Kalman update with the covariance column g of the innovation and its inverse variance.

    p moves along the sight and around the vehicle, and its covariance turns with the sight: in polar coordinates a
    range is linear, so that a hypothesis that is unsure of the bearing does not take the curvature of the circle of
    equal range for knowledge.
    """
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, stir, _ = h
    kx, ky, ku, kv, ks = gx * inv, gy * inv, gu * inv, gv * inv, gs * inv
    r = max(hypot(px, py), 1e-3)
    swing = (px * ky - py * kx) * error / (r * r)
    c, n = cos(swing), sin(swing)
    longer = max(1.0 + (px * kx + py * ky) * error / (r * r), 0.0)
    xx, xy, yy = xx - kx * gx, xy - kx * gy, yy - ky * gy
    xu, xv, xs = xu - kx * gu, xv - kx * gv, xs - kx * gs
    yu, yv, ys = yu - ky * gu, yv - ky * gv, ys - ky * gs
    cc, cn, nn = c * c, c * n, n * n
    return Drift(
        longer * (c * px - n * py),
        longer * (n * px + c * py),
        wx + ku * error,
        wy + kv * error,
        s + ks * error,
        cc * xx - 2.0 * cn * xy + nn * yy,
        cn * (xx - yy) + (cc - nn) * xy,
        c * xu - n * yu,
        c * xv - n * yv,
        c * xs - n * ys,
        nn * xx + 2.0 * cn * xy + cc * yy,
        n * xu + c * yu,
        n * xv + c * yv,
        n * xs + c * ys,
        uu - ku * gu,
        uv - ku * gv,
        us - ku * gs,
        vv - kv * gv,
        vs - kv * gs,
        ss - ks * gs,
        stir,
        log_weight,
    )


def again(h: Drift, stir: float, log_weight: float) -> Drift:
    """Return the hypothesis with another noise and weight."""
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, _, _ = h
    return Drift(px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, stir, log_weight)


def use_range(h: Drift, leg: Leg, z: float, variance: float, gate: float) -> tuple[Drift, float, float, bool]:
    """Return the hypothesis after a leg and a range at its end, and how it stood to that range at the end of the leg.

    That is its normalised innovation squared, its innovation [m] and whether it was too long to use it (SPLIT). Beyond
    the gate a range only costs.

    The ring's whole cost is this: so the leg, which is linear and therefore exact, and `gained` for a measurement along
    the sight are one, and what is made is made once.
    """
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, stir, log_weight = h
    dx, dy, dt, q_p, q_w, q_s = leg
    # cov(p') = cov(p - s d - w dt), the cross terms first
    xu1, xv1, xs1 = xu - dx * us - dt * uu, xv - dx * vs - dt * uv, xs - dx * ss - dt * us
    yu1, yv1, ys1 = yu - dy * us - dt * uv, yv - dy * vs - dt * vv, ys - dy * ss - dt * vs
    xx += q_p - dx * (xs + xs1) - dt * (xu + xu1)
    xy -= dy * xs + dx * ys1 + dt * (xv + yu1)
    yy += q_p - dy * (ys + ys1) - dt * (yv + yv1)
    uu += stir * q_w
    vv += stir * q_w
    ss += stir * q_s
    scale = 1.0 + s
    px -= scale * dx + wx * dt
    py -= scale * dy + wy * dt

    r = sqrt(px * px + py * py)
    if r < 1e-3:  # above the target every direction is that of the sight: take one
        px, py, r = 1e-3, 0.0, 1e-3
    per_m = 1.0 / r
    c, n = px * per_m, py * per_m
    gx, gy = c * xx + n * xy, c * xy + n * yy
    along, most = c * gx + n * gy, SPLIT * r
    long = xx + yy - along > most * most
    inv, error = 1.0 / (along + variance), z - r
    nis, most = error * error * inv, gate * gate
    if not nis <= most:  # nor for a range of NaN
        log_weight -= 0.5 * (most - log(inv))
        after = Drift(
            px, py, wx, wy, s, xx, xy, xu1, xv1, xs1, yy, yu1, yv1, ys1, uu, uv, us, vv, vs, ss, stir, log_weight
        )
        return after, nis, error, long
    gu, gv, gs = c * xu1 + n * yu1, c * xv1 + n * yv1, c * xs1 + n * ys1
    kx, ky = gx * inv, gy * inv
    ku, kv, ks = gu * inv, gv * inv, gs * inv
    share = error * per_m
    swing, longer = (c * ky - n * kx) * share, 1.0 + along * inv * share
    if longer < 0.0:
        longer = 0.0
    c, n = cos(swing), sin(swing)
    xx, xy, yy = xx - kx * gx, xy - kx * gy, yy - ky * gy
    xu, xv, xs = xu1 - kx * gu, xv1 - kx * gv, xs1 - kx * gs
    yu, yv, ys = yu1 - ky * gu, yv1 - ky * gv, ys1 - ky * gs
    d, b = xx - yy, 2.0 * xy
    turned = n * (n * d + c * b)
    after = Drift(
        longer * (c * px - n * py),
        longer * (n * px + c * py),
        wx + ku * error,
        wy + kv * error,
        s + ks * error,
        xx - turned,
        xy + n * (c * d - n * b),
        c * xu - n * yu,
        c * xv - n * yv,
        c * xs - n * ys,
        yy + turned,
        n * xu + c * yu,
        n * xv + c * yv,
        n * xs + c * ys,
        uu - ku * gu,
        uv - ku * gv,
        us - ku * gs,
        vv - kv * gv,
        vs - kv * gs,
        ss - ks * gs,
        stir,
        log_weight - 0.5 * (nis - log(inv)),
    )
    return after, nis, error, long


def predict(h: Drift, leg: Leg) -> Drift:
    """Return the hypothesis after a leg."""
    after = use_range(h, leg, nan, 1.0, 0.0)[0]
    return again(after, h.stir, h.log_weight)


def cut(h: Drift) -> tuple[Drift, Drift, Drift]:
    """Return three hypotheses for one that is too long across the line of sight, the likeliest first.

    Three Gaussians of 0.70 times the length, 1.06 standard deviations apart, that weigh 0.55, 0.225 and 0.225 have the
    variance of the one; what is correlated with the position across moves along.
    """
    r = max(hypot(h.px, h.py), 1e-3)
    c, s = -h.py / r, h.px / r
    gx, gy = c * h.xx + s * h.xy, c * h.xy + s * h.yy
    gu, gv, gs = c * h.xu + s * h.yu, c * h.xv + s * h.yv, c * h.xs + s * h.ys
    across = c * gx + s * gy
    inv, step = 0.5037 / across, 1.0575 / 0.5037 * sqrt(across)
    return (
        gained(h, gx, gy, gu, gv, gs, inv, 0.0, h.log_weight - 0.5985),
        gained(h, gx, gy, gu, gv, gs, inv, step, h.log_weight - 1.4908),
        gained(h, gx, gy, gu, gv, gs, inv, -step, h.log_weight - 1.4908),
    )


def use_rate(h: Drift, z: float, m: Moved, variance: float, gate: float) -> Drift:
    """Return the hypothesis after a range rate -(v . p) / |p|, v the velocity relative to the target."""
    r = max(hypot(h.px, h.py), 1e-3)
    c, n = h.px / r, h.py / r
    ex, ey = m.V * cos(m.psi), m.V * sin(m.psi)
    vx, vy = (1.0 + h.s) * ex + h.wx, (1.0 + h.s) * ey + h.wy
    closing = vx * c + vy * n
    ax, ay, ac = -(vx - closing * c) / r, -(vy - closing * n) / r, -(ex * c + ey * n)
    gx = ax * h.xx + ay * h.xy - c * h.xu - n * h.xv + ac * h.xs
    gy = ax * h.xy + ay * h.yy - c * h.yu - n * h.yv + ac * h.ys
    gu = ax * h.xu + ay * h.yu - c * h.uu - n * h.uv + ac * h.us
    gv = ax * h.xv + ay * h.yv - c * h.uv - n * h.vv + ac * h.vs
    gs = ax * h.xs + ay * h.ys - c * h.us - n * h.vs + ac * h.ss
    variance += ax * gx + ay * gy - c * gu - n * gv + ac * gs
    error = z + closing
    nis = error * error / variance
    log_weight = h.log_weight + log_likelihood(nis, variance, gate)
    if nis > gate * gate:
        return again(h, h.stir, log_weight)
    return gained(h, gx, gy, gu, gv, gs, 1.0 / variance, error, log_weight)
