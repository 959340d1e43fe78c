"""Ours: along the tangent onto the circle, in the target's frame, with the drift corrected and the turn fed forward.

The course wanted at range r makes the angle theta_d(r) = pi/2 - f(r) with the line of sight, in the frame that moves
with the target, where f is the smaller of
    acos(r_a / r)            the straight tangent to the circle, and
    atan((r - r_a) / reach)  the exponential run-in, distance constant `reach`,
joined smoothly (by the fourth-power mean of their tangents). The heading wanted is that course turned into the drift.
The command tracks it with its own rate of change and, because the vehicle's turn rate lags, with its acceleration.
docs/guidance_law.md derives it and argues for its stability.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import asin, atan, atan2, cos, exp, hypot, isfinite, isnan, nan, pi, sin, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.bounds import POSITIVE, refuse_options
from circumnav_mav.guidance.kernel import Estimate, Law, LawContext, Rival
from circumnav_mav.guidance.laws.escape import UNDER_WAY
from circumnav_mav.guidance.laws.escape import escape as way_out

STEPS = 12
"""Points at which a turn is looked at for its least range."""


ROOM = 0.8
"""Share of r_a that a turn should leave whatever r_min is: at the start the drift is unknown, and takes its part."""

LONG_TURN, HALF_TURN = 1.0, 2.6
"""Heading errors, rad, above which the side of the turn is chosen, and above which the turn under way decides it."""

NEAR = 0.4
"""Share of r_a: a turn that would pass nearer is given up for the other one, if that is better by what it costs."""


class Parameters(NamedTuple):
    r_a: float  # orbit radius, m
    reach: float  # distance constant of the run-in, m
    gain: float  # of the heading error, 1/s
    lag: float  # first-order lag of the turn rate that is fed forward, s
    limit: float  # turn rate that the vehicle can fly, rad/s
    r_min: float  # range that a turn should leave, m: the least range allowed, and at least ROOM of r_a


def run_in(r: float, r_a: float, reach: float) -> tuple[float, float]:
    """Return f [rad] and df/dr [rad/m]: how far inside the perpendicular to the line of sight to steer."""
    near, near_slope = (r - r_a) / reach, 1.0 / reach
    if r - r_a <= 1e-6 * r_a:
        return atan(near), near_slope / (1.0 + near * near)
    far = sqrt(r * r - r_a * r_a) / r_a
    far_slope = r / (r_a * r_a * far)
    f = (near**-4 + far**-4) ** -0.25
    return atan(f), f**5 * (near_slope * near**-5 + far_slope * far**-5) / (1.0 + f * f)


def heading(px: float, py: float, psi: float, est: Estimate, par: Parameters) -> tuple[float, float]:
    """Return the heading wanted [rad] and its rate [rad/s] for a target at (px, py) and the vehicle's heading psi."""
    r = max(hypot(px, py), 1e-3)
    f, slope = run_in(r, par.r_a, par.reach)
    vx, vy = est.V * cos(psi) + est.wx, est.V * sin(psi) + est.wy  # relative to the target
    r_dot, sight_rate = -(px * vx + py * vy) / r, (py * vx - px * vy) / (r * r)
    course = atan2(py, px) + 0.5 * pi - f
    c, s = cos(course), sin(course)
    crab = asin(min(max((est.wx * s - est.wy * c) / est.V, -0.95), 0.95))
    along = est.V * cos(crab)
    speed = max(along + est.wx * c + est.wy * s, 0.0)
    return course + crab, (sight_rate - slope * r_dot) * speed / along


def least_range(est: Estimate, turn: float, par: Parameters, roll: float) -> float:
    """Return the least range [m] over a turn by the angle `turn` at the limit: the drift goes on meanwhile.

    roll: for how long it goes straight on before, s: what the turn takes to build up.
    """
    R = est.V / par.limit
    side = 1.0 if turn > 0.0 else -1.0
    least = est.r
    for i in range(1, STEPS + 1):
        angle = turn * i / STEPS
        x = R * side * (sin(est.psi + angle) - sin(est.psi)) + est.V * roll * cos(est.psi)
        y = R * side * (cos(est.psi) - cos(est.psi + angle)) + est.V * roll * sin(est.psi)
        t = abs(angle) / par.limit + roll
        least = min(least, hypot(est.px - x - est.wx * t, est.py - y - est.wy * t))
    return least


def turned(error: float, est: Estimate, par: Parameters) -> float:
    """Return the heading error [rad] taken by the left or by the right, whichever keeps the range.

    A turn that is under way is held to: near half a circle it decides the side, and the room that a turn must leave
    shrinks with the turn rate that is already there. Without that, the choice can chatter, and the vehicle then circles
    the wrong way round on the edge between two choices.
    """
    other = error - 2.0 * pi if error > 0.0 else error + 2.0 * pi
    under_way = est.u / par.limit if error > 0.0 else -est.u / par.limit
    if abs(error) > HALF_TURN and under_way < -UNDER_WAY:
        error, other, under_way = other, error, -under_way
    short = least_range(est, error, par, par.lag)
    if short >= par.r_min * (1.25 - 0.25 * under_way) or short >= est.r:
        return error
    return other if least_range(est, other, par, par.lag) > short else error


def held(vx: float, vy: float, est: Estimate, par: Parameters) -> bool:
    """Return whether the turn under way is held, whichever side the target is now said to lie on.

    On a course that would pass the target within r_min, from where the other turn, with all it takes to build up, would
    not keep r_min: judged by range and range rate, which all hypotheses share. While two of them, mirror images in the
    course, take the lead in turns, every change of sides would take the lag back that the last one has paid, and the
    vehicle would fly straight on to the target. Not held is a turn that would pass near, where the other one is better
    by more than the way that a change costs if it is a mistake: across, and on the mean half the way back.
    """
    ahead, across = est.px * vx + est.py * vy, est.px * vy - est.py * vx
    inwards = ahead > 0.0 and abs(across) < par.r_min * hypot(vx, vy)
    if not (inwards and abs(est.u) > UNDER_WAY * par.limit):
        return False
    half, built = (pi if est.u > 0.0 else -pi), min(abs(est.u) / par.limit, 1.0)
    other = least_range(est, -half, par, par.lag * (1.0 + built))
    if other > par.r_min:
        return False
    here = least_range(est, half, par, par.lag * (1.0 - built))
    return here > NEAR * par.r_a or other < here + ahead / max(est.r, 1e-3) * par.lag * (2.0 + built)


def turn_rate(est: Estimate, par: Parameters) -> float:
    """Return u [rad/s, + counter-clockwise] for the clockwise orbit, within the limit."""
    if est.V <= 0.0:
        return 0.0
    wanted, rate = heading(est.px, est.py, est.psi, est, par)
    error = (wanted - est.psi + pi) % (2.0 * pi) - pi
    if abs(error) > LONG_TURN:
        error = turned(error, est, par)
    h = max(par.lag, 0.1)
    vx, vy = est.V * cos(est.psi) + est.wx, est.V * sin(est.psi) + est.wy
    if held(vx, vy, est, par):
        return par.limit if est.u > 0.0 else -par.limit
    _, later = heading(est.px - vx * h, est.py - vy * h, est.psi + est.u * h, est, par)
    calm = exp(-4.0 * error * error)  # far from its heading the vehicle does not follow the field: no preview
    u = rate + par.gain * error + calm * par.lag * ((later - rate) / h + par.gain * (rate - est.u))
    return min(max(u, -par.limit), par.limit)


def escape(u: float, est: Estimate, rivals: list[Rival], par: Parameters) -> float:
    """Return u, or the safer full turn where the hypotheses of the estimator leave no way out."""
    return way_out(u, est, rivals, par.r_min, par.limit, par.lag)


def parameters(options: Mapping[str, float], context: LawContext) -> Parameters:
    """Return the kernel's parameters. ValueError, in words, for options that cannot fly."""
    given = {**OPTIONS, **options}
    lag = context.turn_lag_s if isnan(given["lag_s"]) else given["lag_s"]
    if not lag >= 0.0:
        raise ValueError(f"lag_s must be 0 or more, not {lag}")
    refuse_options(given, BOUNDS)
    limit = context.turn_rate_limit
    if not (isfinite(limit) and limit > 0.0):
        raise ValueError("this law plans its turns: limits.turn_rate_rad_s must be given")
    if context.V / context.r_a > limit:
        raise ValueError(
            f"the circle asks for a turn rate of {context.V / context.r_a:.3g} rad/s, the vehicle flies {limit:.3g}: "
            "fly slower, or wider"
        )
    r_min = ROOM * context.r_a if isnan(context.r_min) else max(context.r_min, ROOM * context.r_a)
    return Parameters(context.r_a, given["reach_s"] * context.V, given["gain_per_s"], lag, limit, r_min)


OPTIONS = {"reach_s": 1.5, "gain_per_s": 1.0, "lag_s": nan}
BOUNDS = {"reach_s": POSITIVE, "gain_per_s": POSITIVE}

LAW = Law(
    name="tangent",
    turn_rate=turn_rate,
    parameters=parameters,
    options=OPTIONS,
    bounds=BOUNDS,
    needs=("r", "V", "u", "psi", "px", "py", "wx", "wy"),
    source="docs/guidance_law.md",
    escape=escape,
)
