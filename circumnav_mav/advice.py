"""Which estimator suits a vehicle, and what the chosen one means for the gain: part of `circumnav check`."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

from circumnav_mav.config import Config
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.estimators.flying import TRAIL_S
from circumnav_mav.guidance.kernel import EstimatorContext
from circumnav_mav.guidance.slant import least_level
from circumnav_mav.guidance.verdict import Finding
from circumnav_mav.ranging import SOURCES

SUITS = {
    "air": (
        "drift",
        "it drifts with the wind, and only drift with law tangent knows the wind",
    ),
    "believed": (
        "drift",
        "it drifts with the wind and cannot measure its speed: drift with law tangent finds both",
    ),
    "ground": (
        "direct",
        "the autopilot holds the ground speed against the wind, so that range, speed and turn rate are enough; for a "
        "beacon that moves, or to see it on the map, drift with law tangent",
    ),
}
"""The estimator for each of VehicleClass.speed, and why."""


def suits(config: Config) -> Iterator[Finding]:
    """Yield which estimator suits the vehicle class: a warning where the chosen one does not know what it must."""
    kind = config.vehicle_class
    best, why = SUITS[kind.speed]
    chosen = config.estimator.name
    text = f"{best} suits {kind.name}: {why}"
    unfit = chosen == "raw" or (best == "drift" and chosen != "drift")
    yield Finding("warning" if unfit else "info", "estimator", text + (f" (chosen: {chosen})" if unfit else ""))
    banded = config.orbit.r_min_m is not None or config.orbit.r_max_m is not None
    if banded and best == "drift" and chosen != "drift":
        text = "orbit.r_min_m and r_max_m hold in wind below a tenth of the speed only: estimator drift counts it in"
        yield Finding("warning", "estimator", text)


def rate_of_ranges(config: Config, kappa: float, lag_s: float) -> Iterator[Finding]:
    """Yield how the rate of ranges and the filter bound the gain of the paper's law.

    No sensor's rate is configured: the slowest that counts as fresh is one range in ranging.max_age_s.
    """
    orbit, slowest_s = config.orbit, config.ranging.max_age_s
    r_a, V = orbit.radius_m, orbit.speed_m_s
    if config.estimator.name == "raw":
        measured = SOURCES[config.ranging.source].has_rate
        bears_s = sampling.slowest_period_s(r_a, kappa, V, lag_s, measured)
        most = sampling.largest_kappa(r_a, V, lag_s + sampling.held_s(slowest_s, measured))
        text = (
            f"raw holds a rate between ranges: kappa {kappa:.3g} bears them {max(bears_s, 0.0):.3g} s apart at most; "
            f"{slowest_s:.3g} s apart (ranging.max_age_s), only kappa below {most:.3g}"
        )
        yield Finding("warning" if bears_s < slowest_s else "info", "range_rate", text)
        return
    text = (
        f"{config.estimator.name} carries ranges on by the turn that was flown: however seldom they come, they add "
        "nothing to the lag of the loop"
    )
    if config.estimator.name != "direct":
        yield Finding("info", "range_rate", text)
        return
    context = EstimatorContext(r_a, V, config.turn_rate_limit_rad_s)
    noise = ESTIMATORS["direct"].parameters(config.estimator.options, context).q
    late_s = sampling.filter_lag_s(config.ranging.sigma_m, sqrt(noise), slowest_s)
    most = sampling.kappa_of_use(r_a, V, late_s)
    text += (
        f"; one in {slowest_s:.3g} s follows wind {late_s:.2g} s late, and kappa above {most:.3g} gains nothing then"
    )
    yield Finding("warning" if kappa > most else "info", "range_rate", text)


def ages(config: Config) -> Iterator[Finding]:
    """Yield a warning where ranging.max_age_s allows what the estimator cannot place any more."""
    if config.ranging.max_age_s > TRAIL_S:
        text = (
            f"a range that comes more than {TRAIL_S:g} s late is not used, though ranging.max_age_s allows "
            f"{config.ranging.max_age_s:g} s: what was flown is remembered no longer"
        )
        yield Finding("warning", "age", text)


STEEP = 1.0 / 3.0
"""Height above the target, as a share of the radius, from which taking a slant range as horizontal is a warning."""
EXAMPLE_M = 30.0
"""A height for people who have not chosen theirs."""


def slant(config: Config) -> Iterator[Finding]:
    """Yield what the height means for the ranges: an error where they are refused all along the circle."""
    radius_m, height_m, target_m = config.orbit.radius_m, config.orbit.height_m, config.ranging.target_height_m
    if target_m is None:
        yield _as_horizontal(radius_m, height_m)
    elif target_m == "auto":
        text = (
            "ranges are flown on as slant, to a target on the ground (at the height of the take-off), until the flight "
            "shows whether they are: ranging.target_height_m is auto; give it (0 = on the ground), or null where "
            "ranges are horizontal, if you know"
        )
        yield Finding("info", "slant", text)
    elif height_m is not None and radius_m < (least_m := least_level(height_m - target_m)):
        text = (
            f"ranges are refused within {least_m:.3g} m of a target {abs(height_m - target_m):g} m "
            f"{'below' if height_m > target_m else 'above'}, and the orbit is {radius_m:g} m: fly wider or lower"
        )
        yield Finding("error", "slant", text)


def _as_horizontal(radius_m: float, height_m: float | None) -> Finding:
    """Return what comes of taking ranges as horizontal to a target that is on the ground, in fact."""
    to_do = "set ranging.target_height_m (0 = on the ground)"
    if height_m is not None and height_m >= radius_m:
        text = (
            f"ranges are taken as horizontal: to a target on the ground none is shorter than the height, "
            f"{height_m:g} m, and the circle of {radius_m:g} m is never reached; {to_do}, unless the target is as high "
            "as the orbit"
        )
        return Finding("warning", "slant", text)
    example_m = min(EXAMPLE_M, 0.6 * radius_m) if height_m is None else height_m
    where = f"at {example_m:g} m of height" + (", say," if height_m is None else "")
    text = (
        f"ranges are taken as horizontal: if the target is on the ground, the circle flown {where} has a radius of "
        f"{sqrt(radius_m**2 - example_m**2):.1f} m instead of {radius_m:g}; {to_do}"
    )
    return Finding("warning" if height_m is not None and height_m >= STEEP * radius_m else "info", "slant", text)


LOST_SHARE = 1.0 / 3.0
"""Wind, as a share of the speed, in which every law but tangent lost flights (docs/estimation.md, R_wind5)."""


def drifting(config: Config) -> Iterator[Finding]:
    """Yield a warning, or with a strong wind an error, where the vehicle drifts and the law knows no wind."""
    law, wind_m_s = config.law.name, config.study.wind_m_s
    if config.vehicle_class.speed == "ground" or law == "tangent":
        return
    cure = "law tangent on estimator drift does not (README, docs/estimation.md)"
    lost = wind_m_s is not None and wind_m_s >= LOST_SHARE * config.orbit.speed_m_s
    here = f", and study.wind_m_s is {wind_m_s:g}" if lost else ""
    text = f"law {law} loses the target in wind above about a quarter of the speed{here}: {cure}"
    yield Finding("error" if lost else "warning", "law", text)
