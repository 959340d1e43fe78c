"""A band of ranges that guidance must not leave: whatever the law wants, the vehicle turns away before it is too late.

Argument. A vehicle at speed V that turns as hard as it can (u_max) flies a circle of radius rho = V / u_max. Turning
away from the target, it comes no nearer than that circle does:

    h = sqrt((r cos theta)^2 + (r |sin theta| + rho)^2) - rho        while closing; h = r while opening

Under the hardest turn the circle stands still, so h does not change: a vehicle that starts this turn while h >= r_min
never comes nearer than r_min, whatever came before. So the law flies as it likes while h is more than two margins
above r_min, the turn is blended in over one margin, and at one margin it is all that is left. On any orbit h = r: the
barrier costs an orbit nothing. The far side is the same with the hardest turn towards the target, where the farthest
point of that circle counts. What the argument leaves out is paid for like this: a turn that builds up late, by looking
`reaction_s` ahead with the turn rate flown now, and by SWING; a turn that is not quite as hard as asked, by RESERVE;
noise, by three sigma.

In wind (or beside a moving target) the circle drifts, by a turn's worth of wind in every turn. Where the estimator
knows the drift, the hardest turn is walked along with it, until the range opens (closes), and the nearest (farthest)
point of that walk counts in the place of h. Without it the band holds in wind below a tenth of the speed only.

Where both limits speak the near one is obeyed: it is a turn nearer in time.
"""

from __future__ import annotations

from math import atan2, cos, hypot, inf, isfinite, pi, sin
from typing import NamedTuple

from circumnav_mav.guidance.kernel import Estimate

RESERVE = 0.9
"""Share of the turn-rate limit that the argument counts on."""
SWING = 0.25
"""Share of the way flown in reaction_s by which a late vehicle overshoots between law and barrier: found by trial with
laws that fly straight at the limit, on vehicles of 3 to 15 m/s; the tests hold it."""


class Band(NamedTuple):
    """r_min and r_max [m], -inf and inf for none; how hard [rad/s] and how late [s] the vehicle turns."""

    r_min: float
    r_max: float
    margin: float  # m
    u_max: float  # rad/s
    reaction_s: float
    side: float  # +1: the target is wanted on the right (clockwise orbit), -1: on the left


def margin_m(sigma_m: float, speed_m_s: float, reaction_s: float) -> float:
    """Return the margin for ranges of this noise and a vehicle this fast and this late."""
    return 3.0 * sigma_m + SWING * speed_m_s * reaction_s


OUTWARDS = 0.5
"""Cosine to the line of sight on which no drift of up to half the speed turns the range over again."""
TIE = 0.1
"""Share of the margin that the worse side may be worse by and count as equal: more of it, and the band pays for it."""
HEAD_ON = 0.1
"""Sine to the line of sight below which the target is on neither side."""


def least_room_m(speed_m_s: float, u_max: float) -> float:
    """Return how wide a band must be to be kept, m, and how far r_max must be off beside two margins.

    The hardest turn is a circle so far across: past the target it leads that far out, and between two limits nearer to
    each other the turn away from one leads into the other.
    """
    return 2.0 * speed_m_s / (RESERVE * u_max)


STEPS = 24
"""Points in which a turn that drifts is walked along: 1 % of its radius between them."""


class Drift(NamedTuple):
    """Of the vehicle past the target, m/s, in the axes of the heading."""

    ahead: float = 0.0
    left: float = 0.0


def drift_of(est: Estimate, turned: float = 0.0) -> Drift:
    """Return the drift after a change of heading; none where the estimator does not know it."""
    if not isfinite(est.wx + est.wy + est.psi):
        return Drift()
    c, s = cos(est.psi + turned), sin(est.psi + turned)
    return Drift(c * est.wx + s * est.wy, c * est.wy - s * est.wx)


def walk(r: float, theta: float, rho: float, turn: float, time_s: float, drift: Drift, sign: float) -> float:
    """Return the nearest (sign +1) or farthest (-1) point of the hardest turn in a drift, m.

    It ends where the range opens (closes) and goes on to do so on a straight course, whatever the drift: a turn towards
    the target that opens at first is not taken for a way out. time_s: of a full turn. Other arguments as for `nearest`.
    """
    best = r
    for i in range(1, STEPS + 1):
        angle, time = 2.0 * pi * i / STEPS, time_s * i / STEPS
        x = r * cos(theta) - rho * sin(angle) - drift.ahead * time
        y = -r * sin(theta) - turn * rho * (1.0 - cos(angle)) - drift.left * time
        now = hypot(x, y)
        if sign * (now - best) < 0.0:
            best = now
        elif sign * (x * cos(angle) + turn * y * sin(angle)) < -OUTWARDS * now:
            break
    return best


def nearest(r: float, theta: float, rho: float, turn: float) -> float:
    """Return how near the hardest turn comes to the target, m. turn: +1 left, -1 right.

    theta: from the line of sight to the heading, counter-clockwise [rad]; rho: radius of the turn [m].
    """
    return r if cos(theta) <= 0.0 else hypot(r * cos(theta), r * sin(theta) * turn + rho) - rho


def farthest(r: float, theta: float, rho: float, turn: float) -> float:
    """Return how far from the target the hardest turn leads, m. Arguments as for `nearest`."""
    return r if cos(theta) >= 0.0 else hypot(r * cos(theta), r * sin(theta) * turn + rho) + rho


def within(u: float, est: Estimate, band: Band) -> float:
    """Return the turn rate [rad/s, + counter-clockwise] that keeps the band: u itself, wherever u is no danger."""
    if not (isfinite(est.theta) and est.V > 0.0) or (band.r_min == -inf and band.r_max == inf):
        return u
    r, theta = ahead(est, band.reaction_s)
    rho, drift = est.V / (RESERVE * band.u_max), drift_of(est, est.u * band.reaction_s)
    still = drift == Drift()
    time_s = 2.0 * pi / (RESERVE * band.u_max)

    def near(turn: float) -> float:
        return nearest(r, theta, rho, turn) if still else walk(r, theta, rho, turn, time_s, drift, 1.0)

    def far(turn: float) -> float:
        return farthest(r, theta, rho, turn) if still else walk(r, theta, rho, turn, time_s, drift, -1.0)

    left, right = far(+1.0), far(-1.0)
    # Away from the target, to the side that stays further off; head on, to the side where the orbit lies.
    aside = band.side if abs(sin(theta)) < HEAD_ON else (1.0 if sin(theta) > 0.0 else -1.0)
    back = (1.0 if left < right else -1.0) if abs(left - right) > TIE * band.margin else -aside
    most = left if back > 0.0 else right
    u = _blend(u, back * band.u_max, (most + 2.0 * band.margin - band.r_max) / band.margin)
    # The near limit has the last word: that a turn away from the target will lead too far out is a turn later.
    left, right = near(+1.0), near(-1.0)
    away = (1.0 if left > right else -1.0) if abs(left - right) > TIE * band.margin else aside
    least = left if away > 0.0 else right
    return _blend(u, away * band.u_max, (band.r_min + 2.0 * band.margin - least) / band.margin)


def ahead(est: Estimate, time_s: float) -> tuple[float, float]:
    """Return (r, theta) after flying on for a while at the speed, turn rate and drift of now: an exact arc."""
    turned = est.u * time_s
    if abs(turned) > 1e-6:
        forward, left = est.V / est.u * sin(turned), est.V / est.u * (1.0 - cos(turned))
    else:
        forward, left = est.V * time_s, 0.0
    drift = drift_of(est)
    x = est.r * cos(est.theta) - forward - drift.ahead * time_s
    y = -est.r * sin(est.theta) - left - drift.left * time_s
    return hypot(x, y), turned - atan2(y, x)


def _blend(u: float, hardest: float, share: float) -> float:
    share = min(1.0, max(0.0, share))
    return u + share * (hardest - u)
