"""Full turn one way or the other, by the sign of a range-rate error that grows with the distance from the circle.

Source: Matveev, Teimoori, Savkin, "A method for guidance and control of an autonomous vehicle in problems of border
patrolling and obstacle avoidance" (Automatica 2011): u = -+omega sgn(r_dot + chi(r - r_d)), chi a saturated slope that
stays below the speed. Needs no speed, follows a moving target, and pays with full turns all the time; a thin layer
stands in for the jump.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from circumnav_mav.guidance.bounds import LAYER, TURN_SHARE, Bound, refuse_options
from circumnav_mav.guidance.kernel import Estimate, Law, LawContext
from circumnav_mav.guidance.laws.cao2013 import full_turn


class Parameters(NamedTuple):
    r_a: float  # m
    omega: float  # turn rate, rad/s
    slope: float  # of chi, 1/s
    most: float  # value that chi saturates at, m/s
    layer: float  # m/s


def turn_rate(est: Estimate, par: Parameters) -> float:
    """Return u [rad/s, + counter-clockwise] for the clockwise orbit, within +-omega."""
    chi = min(max(par.slope * (est.r - par.r_a), -par.most), par.most)
    return -par.omega * min(max((est.r_dot + chi) / par.layer, -1.0), 1.0)


def parameters(options: Mapping[str, float], context: LawContext) -> Parameters:
    """Return the kernel's parameters. ValueError, in words, for options that cannot fly."""
    given = {**OPTIONS, **options}
    refuse_options(given, BOUNDS)
    closing = given["closing_share"]
    if closing >= 1.0:
        raise ValueError(f"closing_share must stay below 1 (no vehicle closes faster than it flies), not {closing}")
    V, r_a = context.V, context.r_a
    omega = full_turn(given["turn_share"], context)
    return Parameters(r_a, omega, given["slope"] * V / r_a, closing * V, given["layer_share"] * V)


OPTIONS = {"turn_share": 1.0, "slope": 2.0, "closing_share": 0.8, "layer_share": 0.1}
BOUNDS = {
    "turn_share": TURN_SHARE,
    "slope": Bound(
        least=0.1,
        low=0.5,
        high=10.0,
        most=100.0,
        small="lets the vehicle fly beside the circle",
        large="makes the vehicle weave about the circle",
    ),
    "closing_share": Bound(low=0.2, small="closes in so slowly that any wind stops it"),
    "layer_share": LAYER,
}

LAW = Law(
    name="sliding_mode",
    turn_rate=turn_rate,
    parameters=parameters,
    options=OPTIONS,
    bounds=BOUNDS,
    needs=("r", "r_dot"),
    source="Matveev, Teimoori, Savkin 2011",
)
