"""The paper's forerunner: tangent to an inner circle outside it, straight on inside it. Range and range rate only.

Source: Cao, Muse, Casbeer, Kingston, "Circumnavigation of an Unknown Target Using UAVs with Range and Range Rate
Measurements" (2013, arXiv 1308.6250): a smooth law and a saturated one, both zero inside. The smooth one is the outer
half u_o of Hashemi et al. 2013, eq. (u_o-defn), with the same r_s for an orbit of radius r_a; it is kept under both
names. The saturated one is written from the paper's description: full turn by the sign of the same error, here with
the circle r_a itself, where it slides, and with a thin layer in place of the jump.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite, nan, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.bounds import LAYER, TURN_SHARE, refuse_options
from circumnav_mav.guidance.kernel import Estimate, Law, LawContext
from circumnav_mav.guidance.laws.hashemi2013 import TINY, Parameters, parameters


def smooth(est: Estimate, par: Parameters) -> float:
    """Return u [rad/s, + counter-clockwise] for the clockwise orbit; 0 inside r_s. eq. (u_o-defn)."""
    if est.r < par.r_s:
        return 0.0
    return -par.k * (est.r_dot + est.V * sqrt(1.0 - (par.r_s / (est.r + TINY)) ** 2))


class Saturated(NamedTuple):
    r_a: float  # circle steered to the tangent of, m
    omega: float  # turn rate, rad/s
    layer: float  # range-rate error at which the turn is full, m/s


def saturated(est: Estimate, par: Saturated) -> float:
    """Return u [rad/s, + counter-clockwise]: a full turn by the sign of the range-rate error; 0 inside r_a."""
    if est.r < par.r_a:
        return 0.0
    error = est.r_dot + est.V * sqrt(1.0 - (par.r_a / est.r) ** 2)
    return -par.omega * min(max(error / par.layer, -1.0), 1.0)


def full_turn(share: float, context: LawContext) -> float:
    """Return the turn rate [rad/s] of a law that switches: a share of the limit, above that of the circle."""
    omega = share * context.turn_rate_limit
    if not isfinite(omega):
        raise ValueError("this law turns at a share of the turn-rate limit: limits.turn_rate_rad_s must be given")
    if omega <= context.V / context.r_a:
        raise ValueError(
            f"turn_share of the turn-rate limit is {omega:.3g} rad/s, but the circle needs more than "
            f"{context.V / context.r_a:.3g}: raise turn_share, fly slower, or wider"
        )
    return omega


def saturated_parameters(options: Mapping[str, float], context: LawContext) -> Saturated:
    """Return the kernel's parameters. ValueError, in words, for options that cannot fly."""
    given = {**SATURATED.options, **options}
    refuse_options(given, SATURATED.bounds)
    return Saturated(context.r_a, full_turn(given["turn_share"], context), given["layer_share"] * context.V)


SMOOTH = Law(
    name="cao2013_smooth",
    turn_rate=smooth,
    parameters=parameters,
    options={"kappa": nan, "k": nan},
    needs=("r", "r_dot", "V"),
    source="Cao, Muse, Casbeer, Kingston 2013; Hashemi et al. 2013, eq. (u_o-defn)",
)
OUTER = replace(SMOOTH, name="hashemi2013_outer", source="Hashemi et al. 2013, eq. (u_o-defn) alone")
SATURATED = Law(
    name="cao2013_saturated",
    turn_rate=saturated,
    parameters=saturated_parameters,
    options={"turn_share": 1.0, "layer_share": 0.1},
    bounds={"turn_share": TURN_SHARE, "layer_share": LAYER},
    needs=("r", "r_dot", "V"),
    source="after Cao, Muse, Casbeer, Kingston 2013",
)
