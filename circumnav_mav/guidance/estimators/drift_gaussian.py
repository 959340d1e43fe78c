"""One Gaussian of the drift filter: how it moves, and what a range or a range rate does to it. drift.py has the ring.

State (p, w, s) and equations as in drift.py.
"""

from __future__ import annotations

from math import cos, hypot, log, sin, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.estimators.ring import log_likelihood
from circumnav_mav.guidance.kernel import Moved


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
    stir: float  # how many times the usual noise drives w and s
    log_weight: float


def predict(h: Drift, dx: float, dy: float, dt: float, q_p: float, par: Parameters) -> Drift:
    """Return the hypothesis after the reckoned displacement (dx, dy) in dt. Exact: the motion is linear.

    q_p: density of the noise that drives p, m^2/s.
    """
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, stir, log_weight = h
    # cov(p') = cov(p - s d - w dt), the cross terms first
    xu1, xv1, xs1 = xu - dx * us - dt * uu, xv - dx * vs - dt * uv, xs - dx * ss - dt * us
    yu1, yv1, ys1 = yu - dy * us - dt * uv, yv - dy * vs - dt * vv, ys - dy * ss - dt * vs
    q = stir * par.q_w * dt
    return Drift(
        px - (1.0 + s) * dx - wx * dt,
        py - (1.0 + s) * dy - wy * dt,
        wx,
        wy,
        s,
        xx - dx * (xs + xs1) - dt * (xu + xu1) + q_p * dt,
        xy - dy * xs - dt * xv - dx * ys1 - dt * yu1,
        xu1,
        xv1,
        xs1,
        yy - dy * (ys + ys1) - dt * (yv + yv1) + q_p * dt,
        yu1,
        yv1,
        ys1,
        uu + q,
        uv,
        us,
        vv + q,
        vs,
        ss + stir * par.q_s * dt,
        stir,
        log_weight,
    )


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


def use_range(h: Drift, z: float, variance: float, gate: float) -> tuple[Drift, float]:
    """Return the hypothesis after a range, and its normalised innovation squared; beyond the gate it only costs.

    `gained` for a measurement along the sight, written out: the ring's whole cost is this and `predict`.
    """
    px, py, wx, wy, s, xx, xy, xu, xv, xs, yy, yu, yv, ys, uu, uv, us, vv, vs, ss, stir, log_weight = h
    r = max(sqrt(px * px + py * py), 1e-3)
    c, n = px / r, py / r
    gx, gy = c * xx + n * xy, c * xy + n * yy
    along = c * gx + n * gy
    inv, error = 1.0 / (along + variance), z - r
    nis = error * error * inv
    log_weight -= 0.5 * (min(nis, gate * gate) - log(inv))
    if nis > gate * gate:
        return again(h, stir, log_weight), nis
    gu, gv, gs = c * xu + n * yu, c * xv + n * yv, c * xs + n * ys
    kx, ky, ku, kv, ks = gx * inv, gy * inv, gu * inv, gv * inv, gs * inv
    swing, longer = (c * ky - n * kx) * error / r, max(1.0 + along * inv * error / r, 0.0)
    xx -= kx * gx
    xy -= kx * gy
    yy -= ky * gy
    xu -= kx * gu
    xv -= kx * gv
    xs -= kx * gs
    yu -= ky * gu
    yv -= ky * gv
    ys -= ky * gs
    c, n = cos(swing), sin(swing)
    a, b = c * xx - n * xy, c * xy - n * yy
    d, e = n * xx + c * xy, n * xy + c * yy
    moved = Drift(
        longer * (c * px - n * py),
        longer * (n * px + c * py),
        wx + ku * error,
        wy + kv * error,
        s + ks * error,
        c * a - n * b,
        n * a + c * b,
        c * xu - n * yu,
        c * xv - n * yv,
        c * xs - n * ys,
        n * d + c * e,
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
    return moved, nis


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
