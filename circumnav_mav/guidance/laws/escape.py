"""The way out: which full turn is flown near a target whose bearing is still several.

While the hypotheses of an estimator do not agree, a law that flies on the likeliest one may turn into another. So
before the last way out is lost, the two full turns, to the left and to the right, are held against every likely
hypothesis, each with its share of the belief and its uncertainty. As long as one of the turns is harmless the law flies
as it likes; once neither is, the safer of them is flown until one is again. docs/guidance_law.md ("Several targets")
says what that buys.
"""

from __future__ import annotations

from math import cos, exp, isfinite, sin, sqrt

from circumnav_mav.guidance.kernel import Estimate, Rival

HARMLESS = 0.01
"""Risk up to which a turn counts as a way out. 1: it surely leads onto the target; 0: surely nowhere in the room."""

CHANGE = 0.6
"""Share of its risk to which the other turn must bring it down before a turn under way is given up."""

UNDER_WAY = 0.2
"""Share of the turn-rate limit from which on a turn counts as under way."""

TURN = 3.4
"""How far the turns are looked at, rad: half a circle and some."""

STEPS = 12
"""Points at which they are."""

SPREAD = 1.3
"""Each hypothesis is looked at in three places along the sight: so many standard deviations to either side weigh 0.3
each, the mean 0.4. That is a Gaussian to its second moment."""


def escape(u: float, est: Estimate, rivals: list[Rival], room: float, limit: float, lag: float) -> float:
    """Return u [rad/s], or the full turn that is safer, where no way out would be left.

    room: range that a turn should leave, m. limit: the full turn, rad/s. lag: first-order lag of the turn rate, s.
    """
    if not isfinite(u + est.r + est.V + est.psi + est.u):
        return u  # the limits refuse what is not finite, and say so: it must not become a turn here
    if len(rivals) == 0 or est.r - room > 2.0 * est.V * (TURN / limit + lag):  # a drift is slower than the vehicle
        return u
    turning = est.u if abs(est.u) > UNDER_WAY * limit else u
    side = 1.0 if turning > 0.0 else -1.0
    here = risk(side, est, rivals, room, limit, lag)
    if here <= HARMLESS:
        return u
    other = risk(-side, est, rivals, room, limit, lag)
    if other <= HARMLESS:
        return u
    return -side * limit if other < CHANGE * here else side * limit


def risk(side: float, est: Estimate, rivals: list[Rival], room: float, limit: float, lag: float) -> float:
    """Return the risk of a full turn to a side, +1 left and -1 right: how deep it is expected to lead into the room."""
    path = full_turn(side, est, limit, lag)
    share = deep = 0.0
    for h in rivals:
        share += h.share
        deep += h.share * depth(h, path, room)
    return deep / share


def full_turn(side: float, est: Estimate, limit: float, lag: float) -> list[tuple[float, float, float]]:
    """Return points (t, x, y) of a full turn to a side through the air, from the turn rate flown now, s and m."""
    dt, u, psi = TURN / limit / STEPS, est.u, est.psi
    keep = exp(-dt / lag) if lag > 0.0 else 0.0
    t = x = y = 0.0
    path = [(t, x, y)]
    for _ in range(STEPS):
        turn = side * limit * dt + (u - side * limit) * lag * (1.0 - keep)
        u = side * limit + (u - side * limit) * keep
        x += est.V * dt * cos(psi + 0.5 * turn)
        y += est.V * dt * sin(psi + 0.5 * turn)
        psi += turn
        t += dt
        path.append((t, x, y))
    return path


def depth(h: Rival, path: list[tuple[float, float, float]], room: float) -> float:
    """Return how deep into the room a path leads by a hypothesis, 0 to 1, beyond what the vehicle is in it already.

    It is ((room - r) / room)^2, squared since half as deep is less than half as bad; the mean over its Gaussian.
    """
    px, py, wx, wy = h.px, h.py, h.wx, h.wy
    least, at, ex, ey = 1e300, 0.0, 0.0, 0.0
    for t, x, y in path:
        dx, dy = px - x - wx * t, py - y - wy * t
        square = dx * dx + dy * dy
        if square < least:
            least, at, ex, ey = square, t, dx, dy
    r = max(sqrt(least), 1e-3)
    ex, ey = ex / r, ey / r
    xx = h.xx - 2.0 * at * h.xu + at * at * h.uu  # of p - w t
    xy = h.xy - at * (h.xv + h.yu) + at * at * h.uv
    yy = h.yy - 2.0 * at * h.yv + at * at * h.vv
    off = SPREAD * sqrt(max(ex * ex * xx + 2.0 * ex * ey * xy + ey * ey * yy, 0.0))
    if r - off >= room:
        return 0.0
    now = inside(sqrt(px * px + py * py), room)
    return max(0.3 * inside(r - off, room) + 0.4 * inside(r, room) + 0.3 * inside(r + off, room) - now, 0.0)


def inside(r: float, room: float) -> float:
    """Return the square of how deep a range lies in the room, 0 at its edge and 1 at the target."""
    deep = min(max(1.0 - r / room, 0.0), 1.0)
    return deep * deep
