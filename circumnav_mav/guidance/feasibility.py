"""What the paper's mathematics promises for an aircraft: radii, recurrent set, bounds, and the practical limits.

Source: Hashemi, Cao, Casbeer, Yin 2013 (the equation is named at each function). Where its text slips, the corrected
form stands here, and docs/paper_study.md says how it was found. Everything is a pure function of the primary gain
kappa = k r_a and of SI units; a quantity that does not exist for a gain is None.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, cbrt, cos, hypot, inf, pi, sin, sqrt, tan, tau

from circumnav_mav.guidance.laws.hashemi2013 import KAPPA_LEAST, inner_radius

KAPPA_INNER = sqrt(5.0)
"""Least gain with equilibria inside r_s. Below it the paper's recurrence proof has no set to recur to."""

LAG_WARNING = 0.35
"""k V T from which a total lag T begins to show."""

LAG_UNSTABLE = atan(sqrt((1 + sqrt(5)) / 2)) / sqrt((1 + sqrt(5)) / 2)
"""k V T = 0.711 from which a dead time T makes the orbit a limit cycle.

The loop linearised at the orbit is (s + 1) / s^2 in units of k V: it crosses 1 at the root of the golden ratio, and
this is its phase margin there over that frequency. A first-order lag alone is borne up to 1.
"""

HOLD_UNSTABLE = 2.0
"""k V T from which a control held for T makes the sampled loop unstable (trace and determinant of its exact step)."""

GRAVITY_M_S2 = 9.80665


def gain_per_m(r_a: float, kappa: float) -> float:
    """Return k [rad/m] = kappa / r_a. Raises ValueError where no orbit exists: kappa below 1, r_a not positive."""
    if not r_a > 0.0:
        raise ValueError(f"the orbit radius must be positive, not {r_a:g} m")
    if not KAPPA_LEAST <= kappa < inf:
        raise ValueError(f"kappa = k * radius_m is {kappa:.4g}, but an orbit needs a finite kappa of 1 or more")
    return kappa / r_a


def inner_orbits(r_a: float, kappa: float) -> tuple[float, float] | None:
    """Return the unstable equilibria (r_i-, r_i+) [m] at theta = 3 pi/2, or None for kappa < sqrt 5. eq. (riPM-defn).

    The text's first line shows the minus sign only. r_i- comes from the product of the roots, without cancellation.
    """
    k, r_s = gain_per_m(r_a, kappa), inner_radius(r_a, kappa)
    if kappa < KAPPA_INNER:
        return None
    outer = sqrt((r_s**2 + r_s * sqrt(max(0.0, r_s**2 - 4.0 / k**2))) / 2.0)
    return r_s / k / outer, outer


def inner_drift(r: float, r_a: float, kappa: float) -> float:
    """Return g(r) [1/m], the worst Lyapunov drift at a range r in (0, r_s) [m]: that at theta = 3 pi/2."""
    k, r_s = gain_per_m(r_a, kappa), inner_radius(r_a, kappa)
    return 1.0 / r - k / r_s * sqrt(r_s**2 - r**2)


def steepest_radius(r_a: float, kappa: float) -> float:
    """Return r* [m], where g is least: the real root of r^6 + (r_s/k)^2 r^2 - r_s^4/k^2 = 0 (remark on eps)."""
    k, r_s = gain_per_m(r_a, kappa), inner_radius(r_a, kappa)
    p, q = (r_s / k) ** 2, r_s**4 / k**2
    upper = cbrt(q / 2.0 + sqrt(q**2 / 4.0 + p**3 / 27.0))
    return sqrt(upper - p / (3.0 * upper)) if upper > 0.0 else 0.0


def eps_max(r_a: float, kappa: float) -> float | None:
    """Return the bound [1/m] that eps must stay below: min(-g(r*), 1/r_a), or None for kappa <= sqrt 5.

    The text prints g(r*) without its minus sign; g(r*) is negative.
    """
    if inner_orbits(r_a, kappa) is None:
        return None
    least = -inner_drift(steepest_radius(r_a, kappa), r_a, kappa)
    return min(least, 1.0 / r_a) if least > 0.0 else None


def outer_edge(r_a: float, kappa: float, eps: float) -> float | None:
    """Return r_a,eps [m]: from there outwards the drift is below -eps whatever theta; None for eps >= k."""
    k = gain_per_m(r_a, kappa)
    if not 0.0 <= eps < k:
        return None
    return (eps + sqrt(k**2 * r_a**2 * (k**2 - eps**2) + eps**2)) / (k**2 - eps**2)


def inner_edges(r_a: float, kappa: float, eps: float) -> tuple[float, float] | None:
    """Return (r_i-,eps, r_i+,eps) [m], between which g <= -eps, or None where eps is at or beyond eps_max.

    They are the roots of r^4 + (r_s/k)^2 (eps^2 - k^2) r^2 + 2 eps (r_s/k)^2 r + (r_s/k)^2 = 0 between r_i- and r_i+:
    the text prints - 2 eps, whose roots solve g = +eps. Found by bisection of g + eps on both sides of r*.
    """
    limit, orbits = eps_max(r_a, kappa), inner_orbits(r_a, kappa)
    if limit is None or orbits is None or not 0.0 <= eps < limit:
        return None
    if eps == 0.0:
        return orbits
    least = steepest_radius(r_a, kappa)

    def excess(r: float) -> float:
        return inner_drift(r, r_a, kappa) + eps

    return _bisect(excess, orbits[0], least), _bisect(excess, orbits[1], least)


def _bisect(f: Callable[[float], float], positive: float, negative: float) -> float:
    """Return the root of f between an argument where f > 0 and one where f < 0, to the last bit."""
    while True:
        middle = 0.5 * (positive + negative)
        if middle in (positive, negative):
            return middle
        if f(middle) > 0.0:
            positive = middle
        else:
            negative = middle


@dataclass(frozen=True, slots=True)
class RecurrentSet:
    """U_k,eps of eq. (U_ep-defn), corrected: outside it the Lyapunov drift is at most -eps.

    The core (0, r_i-,eps) counts for theta in (pi, 2 pi). The annulus (r_i+,eps, r_a,eps) counts for every theta: with
    the text's theta in (0, pi) only, the drift is positive at theta = 3 pi/2 between r_i+ and r_s.
    """

    eps: float  # 1/m
    core_m: float  # r_i-,eps
    inside_m: float  # r_i+,eps
    outside_m: float  # r_a,eps

    def contains(self, r: float, theta: float) -> bool:
        """Say whether (r [m], theta [rad], any turn) lies in the set."""
        return self.inside_m < r < self.outside_m or (0.0 <= r < self.core_m and theta % tau > pi)


def recurrent_set(r_a: float, kappa: float, eps: float) -> RecurrentSet | None:
    """Return U_k,eps for eps [1/m] in [0, eps_max); None where the theorem gives none. eps = 0: the minimal set."""
    edges, outer = inner_edges(r_a, kappa, eps), outer_edge(r_a, kappa, eps)
    return None if edges is None or outer is None else RecurrentSet(eps, *edges, outer)


def lyapunov(r: float, theta: float, r_a: float, kappa: float, V: float) -> float:
    """Return the paper's V(r, theta) [s/m] for r != r_s [m], theta [rad] taken to [0, 2 pi). eq. (sgn-lya-fcn)."""
    side = r - inner_radius(r_a, kappa)
    sign = float(side > 0.0) - float(side < 0.0)
    return (gain_per_m(r_a, kappa) * abs(side) + theta % tau * sign + tau) / V


def lyapunov_drift(r: float, theta: float, r_a: float, kappa: float) -> float:
    """Return L V(r, theta) [1/m] for r > 0 [m]. eq. (LopV). The noise does not enter: V is linear in theta."""
    k, r_s = gain_per_m(r_a, kappa), inner_radius(r_a, kappa)
    if r >= r_s:
        return sin(theta) / r - k / r * sqrt(r**2 - r_s**2)
    return -sin(theta) / r - k / r_s * sqrt(r_s**2 - r**2)


def recurrence_bound_s(r0: float, theta0: float, r_a: float, kappa: float, V: float, eps: float) -> float | None:
    """Return the bound [s] on the mean time to reach U_k,eps from (r0 [m], theta0 [rad]); None where there is none.

    Corollary (Recurrence Time Bound), with the sign of r0 - r_s that its last line leaves out of the theta term.
    """
    target = recurrent_set(r_a, kappa, eps)
    if target is None or eps <= 0.0:
        return None
    return 0.0 if target.contains(r0, theta0) else lyapunov(r0, theta0, r_a, kappa, V) / eps


def lap_time_s(r_a: float, V: float) -> float:
    """Return the time [s] of one lap of the orbit at speed V [m/s] without wind."""
    return tau * r_a / V


def greatest_turn_rate(r_a: float, kappa: float, V: float) -> float:
    """Return the bound 2 k V [rad/s] on |u| while |r_dot| <= V; the vehicle then turns on a radius of 1 / (2 k)."""
    return 2.0 * gain_per_m(r_a, kappa) * V


def least_turn_radius(r_a: float, kappa: float) -> float:
    """Return 1 / (2 k) [m], the tightest turn that the law can ask for in calm air."""
    return 0.5 / gain_per_m(r_a, kappa)


def unsaturated_kappa(r_a: float, V: float, turn_rate_limit: float) -> float:
    """Return the largest kappa whose 2 k V stays within the limit [rad/s]; below 1, every gain can saturate."""
    return turn_rate_limit * r_a / (2.0 * V)


def lag_number(r_a: float, kappa: float, V: float, lag_s: float) -> float:
    """Return k V T, the total lag T [s] against the loop's natural frequency k V (damping one half)."""
    return gain_per_m(r_a, kappa) * V * lag_s


def least_orbit_radius(V: float, bank_limit: float, wind: float = 0.0) -> float:
    """Return the least radius [m] that a coordinated turn holds at airspeed V and wind [m/s], bank limit in rad.

    The sharpest place is downwind, where the ground speed is V + wind: r = (V + wind)^2 / (g tan bank).
    """
    return (V + wind) ** 2 / (GRAVITY_M_S2 * tan(bank_limit))


@dataclass(frozen=True, slots=True)
class OrbitShift:
    """Where the centre of the orbit goes in a steady wind: the clockwise orbit, seen from the target."""

    size_m: float
    from_wind: float  # rad, counter-clockwise from the direction that the wind blows to

    def centre(self, wind_towards: float) -> tuple[float, float]:
        """Return the centre (east, north) [m] for a wind blowing towards an angle [rad, + from east to north]."""
        angle = wind_towards + self.from_wind
        return self.size_m * cos(angle), self.size_m * sin(angle)


def orbit_shift(r_a: float, kappa: float, wind_ratio: float) -> OrbitShift:
    """Return the shift of the orbit's centre for wind_ratio = W / V, to the first order in it (not in the paper).

    With omega = V / r_a and chi = bearing of the vehicle from the target less the wind's direction, r - r_a obeys
    rho'' + k V rho' + (k V)^2 rho = 2 W omega sin(chi), chi' = -omega. kappa = 1 gives 2 r_a W / V straight downwind;
    a large gain 2 r_a W / (V kappa^2) to the left of the wind (the anticlockwise orbit: to its right).
    """
    gain_per_m(r_a, kappa)
    real, imaginary = kappa**2 - 1.0, kappa
    return OrbitShift(2.0 * r_a * wind_ratio / hypot(real, imaginary), atan(real / imaginary))
