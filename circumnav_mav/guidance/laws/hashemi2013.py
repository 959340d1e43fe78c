"""The paper's law: tangent to an inner circle outside it, outwards inside it. Range and range rate only.

Source: Hashemi, Cao, Casbeer, Yin, "UAV Circumnavigation of an Unknown Target Without Location Information Using Noisy
Range-based Measurements" (2013), eq. (u-defn), with r_s from eq. (r_s-defn).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, isnan, nan, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.kernel import Estimate, Law, LawContext

KAPPA_LEAST = 1.0 - 1e-9
"""Least gain kappa = k r_a: below it no r_s exists. The slack is for a k that was computed as 1 / r_a."""

TINY = 1e-300
"""Added to a range [m] that is divided by: nothing to any but 0, which a reading can be and which at kappa = 1, where
r_s is 0, is outside it."""


class Parameters(NamedTuple):
    k: float  # gain, rad/m
    r_s: float  # radius of the circle steered to the tangent of, m


def turn_rate(est: Estimate, par: Parameters) -> float:
    """Return u [rad/s, + counter-clockwise] for the clockwise orbit; |u| <= 2 k V while |r_dot| <= V.

    Outside r_s, steer to the tangent of the circle of radius r_s; inside it, steer outwards. eq. (u-defn).
    """
    if est.r >= par.r_s:
        return -par.k * (est.r_dot + est.V * sqrt(1.0 - (par.r_s / (est.r + TINY)) ** 2))
    return -par.k * (est.r_dot - est.V * sqrt(1.0 - (est.r / par.r_s) ** 2))


def inner_radius(r_a: float, kappa: float) -> float:
    """Return r_s [m] of eq. (r_s-defn), r_s = sqrt(r_a^2 - 1/k^2), written so that kappa = 1 gives 0 and never NaN."""
    return r_a * sqrt(max(0.0, 1.0 - 1.0 / kappa**2))


def gain(options: Mapping[str, float], r_a: float) -> float:
    """Return kappa = k r_a from the options, where `kappa` is the primary gain and `k` [rad/m] the other spelling.

    Raises ValueError, in words, for a gain that is not finite, given twice, or below 1.
    """
    k, kappa = options.get("k", nan), options.get("kappa", nan)
    if not isnan(k):
        if not isnan(kappa):
            raise ValueError("give kappa or k, not both: they are one gain (kappa = k * radius_m)")
        kappa = k * r_a
    if isnan(kappa):
        kappa = DEFAULT_KAPPA
    if not isfinite(kappa):
        raise ValueError("kappa = k * radius_m must be a finite number")
    if kappa < KAPPA_LEAST:
        raise ValueError(
            f"kappa = k * radius_m is {kappa:.4g}, but no orbit exists below 1: "
            "raise kappa to 1 or more (k to 1/radius_m)"
        )
    return max(1.0, kappa)


def parameters(options: Mapping[str, float], context: LawContext) -> Parameters:
    """Return the kernel's parameters. Raises ValueError for a gain that no orbit exists for."""
    kappa = gain(options, context.r_a)
    return Parameters(k=kappa / context.r_a, r_s=inner_radius(context.r_a, kappa))


DEFAULT_KAPPA = 3.0

LAW = Law(
    name="hashemi2013",
    turn_rate=turn_rate,
    parameters=parameters,
    options={"kappa": nan, "k": nan},
    needs=("r", "r_dot", "V"),
    source="Hashemi, Cao, Casbeer, Yin 2013, eq. (u-defn)",
)
