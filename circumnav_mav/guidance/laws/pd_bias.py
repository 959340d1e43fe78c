"""The turn of the circle as a constant bias, plus a proportional and a derivative term on range.

Source: Dong, You, Xie, Hu, "Coordinate-free circumnavigation of a moving target via a PD-like controller"
(arXiv 2002.06507): u = V / r_d + c1 r_dot + c2 sat(r - r_d), here with the sign of the clockwise orbit. Exact orbit,
reached exponentially. Linearised at the orbit, e = r - r_a:  e'' + V c1 e' + (V c2 + V^2 / r_a^2) e = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import NamedTuple

from circumnav_mav.guidance.kernel import Estimate, Law, LawContext
from circumnav_mav.guidance.laws.hashemi2013 import gain


class Parameters(NamedTuple):
    r_a: float  # m
    c1: float  # rad/m
    c2: float  # rad/(s m)
    reach: float  # error at which the proportional term saturates, m


def turn_rate(est: Estimate, par: Parameters) -> float:
    """Return u [rad/s, + counter-clockwise] for the clockwise orbit."""
    e = min(max(est.r - par.r_a, -par.reach), par.reach)
    return -(est.V / par.r_a + par.c1 * est.r_dot + par.c2 * e)


def parameters(options: Mapping[str, float], context: LawContext) -> Parameters:
    """Return the kernel's parameters: c1 = kappa / r_a, c2 for the damping wanted.

    Far away the law closes in at (V / r_a + c2 reach) / c1, which must stay below V: `reach` goes 0.8 of the way.
    """
    given = {**OPTIONS, **options}
    kappa = gain({"kappa": given["kappa"]}, context.r_a)
    zeta, V, r_a = given["damping"], context.V, context.r_a
    stiffness = (kappa / (2.0 * zeta)) ** 2 - 1.0 if zeta > 0.0 else 0.0
    if stiffness <= 0.0 or kappa <= 1.0:
        raise ValueError(
            f"kappa {kappa:.3g} with damping {zeta:.3g} leaves no proportional term: kappa must be above 1 "
            "and above 2 * damping"
        )
    return Parameters(r_a, kappa / r_a, stiffness * V / r_a**2, 0.8 * (kappa - 1.0) / stiffness * r_a)


OPTIONS = {"kappa": nan, "damping": 0.7}

LAW = Law(
    name="pd_bias",
    turn_rate=turn_rate,
    parameters=parameters,
    options=OPTIONS,
    needs=("r", "r_dot", "V"),
    source="Dong, You, Xie, Hu, arXiv 2002.06507",
)
