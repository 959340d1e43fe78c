"""How much lag a law bears at its circle: any law's, taken from the kernel itself by differences.

In still air, about its own circle (r_e, theta = pi/2, u = -V / r_e), with omega = V / r_e,
    r' = -V cos(theta), theta' = V sin(theta) / r + u, so dr = V / (s^2 + omega^2) du, dtheta = s / (s^2 + omega^2) du
and the law answers with du_c = K_r dr + K_theta dtheta + K_u du. Opened at the command, the loop is
    L(s) = K_u + (K_r V + K_theta s) / (s^2 + omega^2)
A first-order lag T gives  T s^3 + (1 - K_u) s^2 + (T omega^2 - K_theta) s + (1 - K_u) omega^2 - K_r V = 0,  by Routh
stable for T < (1 - K_u) K_theta / (K_r V). Beside it a dead time D is borne up to the least of arg(G) / w at the
crossings |G(j w)| = 1 of G = L / (T s + 1). docs/guidance_law.md has both for each law, tests/theory/test_lag.py flies
them.
"""

from __future__ import annotations

from cmath import phase
from dataclasses import dataclass
from math import cos, hypot, inf, pi
from typing import Any

from circumnav_mav.guidance.kernel import Estimate, Law

STEP = 1e-5
"""Of the differences, as a share of the radius, of 1 rad and of V / r_a."""

NEAREST, FARTHEST, RATIO = 1e-6, 1e9, 1.02
"""Angular frequencies that are looked at for crossings: so far above V / r_a, in V / r_a, and each so many times as far
as the one before. A loop that is still above 1 at the end bears no dead time that anything could keep."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A law linearised at its circle. SI units."""

    V: float
    omega: float  # rad/s
    k_r: float  # rad/s / m
    k_theta: float  # 1/s
    k_u: float

    def lag_s(self) -> float:
        """Return the first-order lag [s] of the turn rate at which the circle becomes unstable."""
        return (1.0 - self.k_u) * self.k_theta / (self.k_r * self.V) if self.k_r < 0.0 else inf

    def dead_time_s(self, lag_s: float = 0.0) -> float:
        """Return the dead time [s] at which the circle becomes unstable, beside a first-order lag of the turn rate."""
        if lag_s >= self.lag_s():
            return 0.0
        least = 0.0 if lag_s <= 0.0 and abs(self.k_u) >= 1.0 else inf  # it answers the turn it hears of with more of it
        far, above = NEAREST, True
        while far < FARTHEST:
            if (abs(self._gain((1.0 + far) * self.omega, lag_s)) > 1.0) is not above:
                w, above = self._crossing(far / RATIO, far, lag_s), not above
                least = min(least, phase(self._gain(w, lag_s)) % (2.0 * pi) / w)
            far *= RATIO
        return 0.0 if above else least

    def shift_m(self, wind_m_s: float) -> float:
        """Return how far [m] wind moves the circle, to the first order, for a law on exact range and range rate.

        rho'' - K_theta rho' + (omega^2 - K_r V) rho = 2 W omega sin(chi), chi' = -omega, as in feasibility.orbit_shift.
        """
        stiffness = hypot(self.k_r * self.V, self.omega * self.k_theta)
        return 2.0 * wind_m_s * self.omega / stiffness if stiffness > 0.0 else inf

    def _crossing(self, low: float, high: float, lag_s: float) -> float:
        """Return the angular frequency between two (as NEAREST counts) at which |G| passes 1, by bisection."""
        above = abs(self._gain((1.0 + low) * self.omega, lag_s)) > 1.0
        for _ in range(30):
            middle = 0.5 * (low + high)
            if (abs(self._gain((1.0 + middle) * self.omega, lag_s)) > 1.0) is above:
                low = middle
            else:
                high = middle
        return (1.0 + low) * self.omega

    def _gain(self, w: float, lag_s: float) -> complex:
        answer = self.k_u + (self.k_r * self.V + 1j * w * self.k_theta) / (self.omega**2 - w * w)
        return answer / (1.0 + 1j * w * lag_s)


def loop_of(law: Law, parameters: Any, r_a: float, V: float) -> Loop:
    """Return the law's loop at the circle that it flies on exact estimates, r_a or near it."""
    r = _circle(law, parameters, r_a, V)
    omega = V / r

    def slope(dr: float, dtheta: float, du: float) -> float:
        ahead, behind = (seen(r + h * dr, 0.5 * pi + h * dtheta, -omega + h * du, V) for h in (1.0, -1.0))
        change = law.turn_rate(ahead, parameters) - law.turn_rate(behind, parameters)
        return change / (2.0 * (dr + dtheta + du))

    return Loop(V, omega, slope(STEP * r, 0.0, 0.0), slope(0.0, STEP, 0.0), slope(0.0, 0.0, STEP * omega))


def seen(r: float, theta: float, u: float, V: float) -> Estimate:
    """Return the exact estimate of a target due east of the vehicle, in still air."""
    return Estimate(r, -V * cos(theta), V, u, theta, theta, r, 0.0, 0.0, 0.0)


def _circle(law: Law, parameters: Any, r_a: float, V: float) -> float:
    """Return the range at which the law turns as the circle does: a law with a layer flies a little outside r_a."""
    low, high = 0.8 * r_a, 1.25 * r_a

    def short(r: float) -> bool:  # turns less than the circle of that range: it flies outwards
        return law.turn_rate(seen(r, 0.5 * pi, -V / r, V), parameters) > -V / r

    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if short(middle) else (low, middle)
    return 0.5 * (low + high)
