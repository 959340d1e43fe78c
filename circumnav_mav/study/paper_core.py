"""The paper's plant, stepped in batches: exact arcs between control instants, noise read from an array, laws untouched.

Heading is carried as a unit vector and turned by short polynomials of our own, so that the inner loops, which run over
the trajectories of a block, vectorise; the law's kernel is inlined into them as it stands. Without numba the same
functions run as plain Python, slowly. Axes and signs as in guidance/kernel.py; the target is the origin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circumnav_mav.guidance.kernel import Estimate
from circumnav_mav.study.kernels import compiled

Floats = NDArray[np.float64]

LANES = 16
"""Trajectories flown side by side. Short batches are padded: a trajectory's arithmetic never depends on its company."""

TILE = 128
"""Steps of noise turned from trajectory-major to step-major at a time."""

SUMS = ("error", "error2", "rdot2", "u2")
"""What a block sums over the control instants: r - r_a, its square, r_dot^2 (the true one) and u^2."""


def _unbound(*_: Any) -> float:
    raise NotImplementedError("bound by `program`")


LAW: Callable[..., float] = _unbound
"""The law that flies, in `batch` and in setwise.visit: `program` binds it."""


@cache
def program(kernel: Callable[..., Any], turn_rate: Callable[..., float]) -> Callable[..., Any]:
    """Return a kernel of the study compiled around a registered law: the very function that flies."""
    return compiled(kernel, {"LAW": turn_rate}, side_by_side=True)


# Taylor series of sin(g)/g and cos(g) in g^2, to the last bit for |g| <= pi/2.
S0, S1, S2, S3, S4, S5, S6, S7, S8, S9, S10 = ((-1.0) ** n / math.factorial(2 * n + 1) for n in range(11))
C0, C1, C2, C3, C4, C5, C6, C7, C8, C9, C10, C11 = ((-1.0) ** n / math.factorial(2 * n) for n in range(12))
ONE_BY_PI = 1.0 / math.pi
PI_REST = 1.2246467991473532e-16  # pi less the float nearest to it
ROUND = 1.5 * 2.0**52  # adding and taking away this rounds to the nearest whole number


def sin_cos(angle: float) -> tuple[float, float]:
    """Return sin and cos [error below 1e-15 while |angle| < 1e3 rad], without a branch or a library call."""
    turns = (angle * ONE_BY_PI + ROUND) - ROUND
    g = (angle - turns * math.pi) - turns * PI_REST
    half = 0.5 * turns
    sign = 1.0 - 4.0 * abs(half - ((half + ROUND) - ROUND))
    z = g * g
    s = (((((((((S10 * z + S9) * z + S8) * z + S7) * z + S6) * z + S5) * z + S4) * z + S3) * z + S2) * z + S1) * z + S0
    c = ((((((C11 * z + C10) * z + C9) * z + C8) * z + C7) * z + C6) * z + C5) * z
    c = (((((c + C4) * z + C3) * z + C2) * z + C1) * z) + C0
    return sign * g * s, sign * c


def advance(
    x: float, y: float, c: float, s: float, u: float, V: float, hold_s: float, wx: float, wy: float
) -> tuple[float, float, float, float]:
    """Return position [m] and heading (c, s) after turning at u [rad/s] for hold_s [s]: exact arc, plus wind."""
    half = 0.5 * hold_s * u
    sin_h, cos_h = sin_cos(half)
    chord = V * hold_s * (sin_h / half if half != 0.0 else 1.0)
    x += chord * (c * cos_h - s * sin_h) + wx * hold_s
    y += chord * (s * cos_h + c * sin_h) + wy * hold_s
    cos_2h, sin_2h = 1.0 - 2.0 * sin_h * sin_h, 2.0 * sin_h * cos_h
    c, s = c * cos_2h - s * sin_2h, s * cos_2h + c * sin_2h
    scale = 1.5 - 0.5 * (c * c + s * s)  # keeps the unit vector a unit vector
    return x, y, c * scale, s * scale


def batch(
    par: Any,
    plant: tuple[float, float, float, float, float],  # V, hold_s, wx, wy, r_a
    start: Floats,  # (4, n): x, y, cos psi, sin psi; n a multiple of LANES
    noise: Floats,  # (n, steps), m/s, on r_dot
    delay: int,  # control instants from a measurement to the turn that it causes
    tail_from: int,  # first control instant of the tail
    sums: Floats,  # (2, 4, n), out: before the tail, and in it; in the order of SUMS
) -> None:
    """Fly n trajectories, LANES at a time. u is asked for at each control instant and held until the next."""
    V, hold_s, wx, wy, r_a = plant
    n, steps = noise.shape
    x, y, c, s = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    total, held, tile = np.empty((4, LANES)), np.empty((delay + 1, LANES)), np.empty((TILE, LANES))
    error, error2, rdot2, u2 = total[0], total[1], total[2], total[3]
    for block in range(0, n, LANES):
        for j in range(LANES):
            x[j], y[j], c[j], s[j] = start[0, block + j], start[1, block + j], start[2, block + j], start[3, block + j]
        held[:] = 0.0
        for m in range(steps):
            row = m % TILE
            if row == 0:
                for j in range(LANES):
                    for i in range(min(TILE, steps - m)):
                        tile[i, j] = noise[block + j, m + i]
            if m == 0 or m == tail_from:
                for q in range(4):
                    for j in range(LANES):
                        sums[0, q, block + j] = total[q, j] if m > 0 else 0.0
                        total[q, j] = 0.0
            asked, turned, nu = held[m % (delay + 1)], held[(m + 1) % (delay + 1)], tile[row]
            for j in range(LANES):
                r = math.sqrt(x[j] * x[j] + y[j] * y[j])
                r_dot = (x[j] * (V * c[j] + wx) + y[j] * (V * s[j] + wy)) / r
                # asked[j] still holds the turn rate flown until now
                u = LAW(Estimate(r, r_dot + nu[j], V, asked[j], math.nan, math.nan, -x[j], -y[j], wx, wy), par)
                asked[j] = u
                e = r - r_a
                error[j] += e
                error2[j] += e * e
                rdot2[j] += r_dot * r_dot
                u2[j] += u * u
            for j in range(LANES):
                x[j], y[j], c[j], s[j] = advance(x[j], y[j], c[j], s[j], turned[j], V, hold_s, wx, wy)
        for q in range(4):
            for j in range(LANES):
                sums[1, q, block + j] = total[q, j]


def plain_step(
    law: Callable[..., float],
    par: Any,
    state: tuple[float, float, float],  # x, y, psi
    nu: float,
    u_flown: float,
    plant: tuple[float, float, float, float, float],
) -> tuple[tuple[float, float, float], float, float, float]:
    """Return the next (x, y, psi), and r, r_dot, u at this one: the same plant by the library's sin and cos."""
    V, hold_s, wx, wy, _ = plant
    x, y, psi = state
    r = math.hypot(x, y)
    r_dot = (x * (V * math.cos(psi) + wx) + y * (V * math.sin(psi) + wy)) / r
    u = law(Estimate(r=r, r_dot=r_dot + nu, V=V, u=u_flown, px=-x, py=-y, wx=wx, wy=wy), par)
    turn = u * hold_s
    if abs(turn) > 1e-9:
        east, north = (math.sin(psi + turn) - math.sin(psi)) / u, (math.cos(psi) - math.cos(psi + turn)) / u
    else:
        east, north = math.cos(psi + 0.5 * turn) * hold_s, math.sin(psi + 0.5 * turn) * hold_s
    return (x + V * east + wx * hold_s, y + V * north + wy * hold_s, psi + turn), r, r_dot, u
