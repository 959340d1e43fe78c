"""Which estimator suits a vehicle, what its height means, and who takes over: part of `circumnav check`."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, sqrt

from circumnav_mav.config import Config, guidance_settings
from circumnav_mav.guidance.barrier import least_room_m
from circumnav_mav.guidance.computer import band_of
from circumnav_mav.guidance.slant import least_level
from circumnav_mav.guidance.verdict import Finding

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
    """Yield which estimator suits the vehicle class and whether it can keep the band: warnings where it does not."""
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
    band = band_of(guidance_settings(config))
    room_m = least_room_m(config.orbit.speed_m_s, band.u_max)
    least_m = max(room_m + 2.0 * band.margin, band.r_min + room_m)
    if band.r_max < least_m:
        text = (
            f"the barrier cannot promise a band this narrow, nor this near: the hardest turn is {room_m:.3g} m across; "
            f"raise orbit.r_max_m to {ceil(least_m)} m, or leave it out"
        )
        yield Finding("warning", "band", text)


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


MODES = frozenset({"hold", "return", "land"})


def handing_over(config: Config) -> Iterator[Finding]:
    """Yield a warning for each cause on which a mode is asked for that the vehicle class cannot have."""
    kind, safety = config.vehicle_class, config.safety
    if kind.hands_over:
        return
    keys = {f"safety.{key}": action for key, action in safety if key.startswith("on_")}
    if not kind.estimates:
        del keys["safety.on_estimates_lost"]  # never happens
    for key, action in {"on_range_lost": config.on_range_lost, **keys}.items():
        if action in MODES:
            text = f"{key}: {action} needs a position, which {kind.name} flies without: it is asked for in vain: stop"
            yield Finding("warning", "hand_over", text)


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
