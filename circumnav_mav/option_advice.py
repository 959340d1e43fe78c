"""Options of law and estimator that are odd, by themselves or for this circle and sensor: part of `circumnav check`.

How the thresholds were measured: docs/estimation.md and docs/guidance_law.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isnan, tau

from circumnav_mav.config import Config
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.verdict import Finding
from circumnav_mav.ranging import SOURCES

SLOW_LAPS, NEVER_LAPS = 1.0, 3.0
"""Time constants of the run-in, in laps: from where on it takes long, and the circle is not reached."""
SLUGGISH, ADRIFT = 0.1, 0.03
"""gain_per_s over V / r_a: below the first the heading lags behind, below the second flights are lost."""
NEVER_KNOWN = 1.5
"""accel_m_s2 over sampling.most_accel_m_s2: measured, it flies up to 1.1 and never from 1.3 on."""


def odd_options(config: Config) -> Iterator[Finding]:
    """Yield what is odd in the options that the file gives."""
    for section, plug, given in (
        ("law", LAWS[config.law.name], config.law.options),
        ("estimator", ESTIMATORS[config.estimator.name], config.estimator.options),
    ):
        for key, value in given.items():
            if (bound := plug.bounds.get(key)) and (odd := bound.odd(value)):
                usual = "" if isnan(plug.options[key]) else f" ({plug.options[key]:g} unless given)"
                yield Finding("warning", "option", f"{section}.{key} = {value:g} {odd}{usual}")
    yield from _unheard_alarm(config)
    if config.law.name == "tangent":
        yield from _slow_tangent(config)
    if config.estimator.name == "direct" and not SOURCES[config.ranging.source].has_rate:
        yield from _restless_direct(config)


def _unheard_alarm(config: Config) -> Iterator[Finding]:
    """Yield a warning where nothing starts the ring again: a range that the gate refuses counts as one at its edge."""
    options = {**ESTIMATORS[config.estimator.name].options, **config.estimator.options}
    if "alarm_nis" in options and options["alarm_nis"] >= options["gate_sigmas"] ** 2:
        text = (
            f"estimator.alarm_nis = {options['alarm_nis']:g} is never reached: a range counts with at most gate_sigmas "
            f"squared, {options['gate_sigmas'] ** 2:g}; a belief that is wrong then lasts until ranges vote it out"
        )
        yield Finding("warning", "option", text)


def _slow_tangent(config: Config) -> Iterator[Finding]:
    law = LAWS["tangent"].parameters(config.law.options, config.law_context())
    V, r_a = config.orbit.speed_m_s, config.orbit.radius_m
    reach_s, lap_s, circle_rad_s = law.reach / V, tau * r_a / V, V / r_a
    if reach_s > SLOW_LAPS * lap_s:
        never = reach_s > NEVER_LAPS * lap_s
        text = (
            f"law.reach_s = {reach_s:g} is the time constant of the run-in, and a lap takes {lap_s:.3g} s: "
            f"{'flights end beside the circle' if never else 'the circle is reached late'}; give less"
        )
        yield Finding("error" if never else "warning", "option", text)
    if law.gain < SLUGGISH * circle_rad_s:
        adrift = law.gain < ADRIFT * circle_rad_s
        text = (
            f"law.gain_per_s = {law.gain:g} takes {1.0 / law.gain:.3g} s to turn a heading error away, and a lap takes "
            f"{lap_s:.3g} s: {'flights are lost' if adrift else 'the circle is reached late'}; give more"
        )
        yield Finding("error" if adrift else "warning", "option", text)


def _restless_direct(config: Config) -> Iterator[Finding]:
    """Yield where the range rate is believed to change so fast that ranges never show it well enough to fly on."""
    accel = config.estimator.options.get("accel_m_s2")
    period_s = 1.0 / config.study.range_rate_hz
    most = sampling.most_accel_m_s2(config.orbit.speed_m_s, config.ranging.sigma_m, period_s)
    if accel is not None and accel > most:
        text = (
            f"estimator.accel_m_s2 = {accel:g} forgets the range rate sooner than ranges of ranging.sigma_m = "
            f"{config.ranging.sigma_m:g}, {config.study.range_rate_hz:g} a second, show it: above {most:.3g} the "
            "estimate is not fit to fly on"
        )
        yield Finding("error" if accel > NEVER_KNOWN * most else "warning", "option", text)
