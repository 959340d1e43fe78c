"""What the loop of a law that is not the paper's bears: part of `circumnav check`. The paper's: guidance/verdict.py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf, isnan, nan

from circumnav_mav.config import Config
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.lag import loop_of
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import DEFAULT_KAPPA
from circumnav_mav.guidance.verdict import Finding
from circumnav_mav.ranging import SOURCES

GAINS = {
    "pd_bias": ("kappa", 0.9),
    "tangent": ("gain_per_s", 0.9),
    "sliding_mode": ("layer_share", 1.1),
    "cao2013_saturated": ("layer_share", 1.1),
}
"""What calms a law, and the factor of a step of it. The paper's family has a bound of its own (verdict.py)."""
CALM, MOST_STEPS = 0.5, 40
"""Share of the dead time borne from where on the circle swings; steps of the gain that a cure is looked for in."""


OFF_SHARE = 0.005
"""How far from the circle, as a share of its radius, a law may fly in still air without a word."""
SWINGS = 5.0
"""A law with a layer weaves where a swing from one full turn to the other takes so many times the dead time that it
bears. Flown on exact estimates (docs/guidance_law.md): calm up to 8.7, weaving from 9.0; on the stub, with noise and a
filter, calm at 4.2 and weaving at 6.8."""


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


def told_by_its_loop(config: Config) -> Iterator[Finding]:
    """Yield where a law that is not the paper's circles, and what wind and the rate of its turns do there."""
    name, orbit, wind_m_s = config.law.name, config.orbit, config.study.wind_m_s
    law, context = LAWS[name], config.law_context()
    loop = loop_of(law, law.parameters({**law.options, **config.law.options}, context), orbit.radius_m, orbit.speed_m_s)
    flown_m = orbit.speed_m_s / loop.omega
    if abs(flown_m - orbit.radius_m) > OFF_SHARE * orbit.radius_m:
        yield Finding("info", "off", f"law {name} as set circles at {flown_m:.4g} m, not at {orbit.radius_m:g}")
    if name != "tangent" and wind_m_s and wind_m_s < orbit.speed_m_s and config.vehicle_class.speed != "ground":
        text = (
            f"study.wind_m_s = {wind_m_s:g} moves the circle by about {loop.shift_m(wind_m_s):.3g} m with this law "
            f"(first order in wind / speed{'; on polar by more' * (config.estimator.name == 'polar')})"
        )
        yield Finding("info", "shift", text)
    if "layer_share" not in law.options:
        return
    borne_s = loop.dead_time_s(config.turn_lag_s)
    swing_s = 2.0 * config.turn_rate_limit_rad_s / config.limits.turn_accel_rad_s2
    if borne_s > 0.0 and swing_s > SWINGS * borne_s:  # 0: `bears_lag` says that it weaves
        text = (
            f"law {name} as set will weave about the circle: from one full turn to the other the vehicle takes "
            f"{swing_s:.2g} s (limits.turn_accel_rad_s2), and it bears that up to about {SWINGS * borne_s:.2g} s: "
            "raise layer_share, or turn_accel_rad_s2 if the vehicle can"
        )
        yield Finding("warning", "weave", text)
