"""Which estimator suits a vehicle, and what the chosen one means for the gain: part of `circumnav check`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil, inf, isnan, nan, sqrt

from circumnav_mav.config import Config, guidance_settings
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.barrier import least_room_m
from circumnav_mav.guidance.computer import band_of
from circumnav_mav.guidance.lag import loop_of
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import DEFAULT_KAPPA
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


GAINS = {
    "pd_bias": ("kappa", 0.9),
    "tangent": ("gain_per_s", 0.9),
    "sliding_mode": ("layer_share", 1.1),
    "cao2013_saturated": ("layer_share", 1.1),
}
"""What calms a law, and the factor of a step of it. The paper's family has a bound of its own (verdict.py)."""
CALM, MOST_STEPS = 0.5, 40
"""Share of the dead time borne from where on the circle swings; steps of the gain that a cure is looked for in."""


def _time(seconds: float) -> str:
    return "any time" if seconds == inf else f"{seconds:.3g} s"


def bears_lag(config: Config, late_s: float) -> Iterator[Finding]:
    """Yield how much lag the law bears with its options, taken from its kernel: lag.py.

    late_s: dead time in the loop besides the lag of the turn rate, s. A law with a layer weaves where it is unstable,
    and stays near the circle: that is a warning. Any other leaves it.
    """
    name, lag_s, V = config.law.name, config.turn_lag_s, config.orbit.speed_m_s
    if config.estimator.name == "raw":
        late_s += sampling.held_s(1.0 / config.study.range_rate_hz, SOURCES[config.ranging.source].has_rate)
    law, context = LAWS[name], config.law_context()

    def share(options: Mapping[str, float]) -> tuple[float, float, float]:
        loop = loop_of(law, law.parameters({**law.options, **options}, context), config.orbit.radius_m, V)
        borne_s, most_s = max(loop.lag_s(), 0.0), loop.dead_time_s(lag_s)
        used = (lag_s / borne_s if borne_s > 0.0 else inf, late_s / most_s if most_s > 0.0 else inf)
        return max(used), borne_s, most_s

    used, borne_s, beside_s = share(config.law.options)
    text = (
        f"law {name} as set bears a turn rate that lags by {_time(borne_s)}, or beside the vehicle's lag of "
        f"{lag_s:.2g} s a dead time of {_time(beside_s)}; here it is {late_s:.2g} s"
    )
    if used <= CALM:
        yield Finding("info", "lag", text)
        return
    key, factor = GAINS[name]
    value = config.law.options.get(key, nan)
    value = start = (DEFAULT_KAPPA if key == "kappa" else law.options[key]) if isnan(value) else value
    for _ in range(MOST_STEPS):
        value *= factor
        try:
            calm = share({**config.law.options, key: value})[0] <= CALM
        except ValueError:
            break
        if calm:
            text += f": {key} {value:.2g} in place of {start:.2g} is calm"
            break
    if used < 1.0:
        yield Finding("warning", "lag", f"the circle will swing: {text}")
    elif "layer_share" in law.options:
        yield Finding("warning", "lag", f"the vehicle will weave about the circle: {text}")
    else:
        yield Finding("error", "lag", f"the circle is unstable: {text}")


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
