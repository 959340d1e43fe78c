"""Which wind, or which speed of the target, law and vehicle bear: part of `circumnav check`."""

from __future__ import annotations

from collections.abc import Iterator

from circumnav_mav.config import Config
from circumnav_mav.guidance.verdict import LOSES_IN, Finding

LOST_SHARE = 1.0 / 3.0
"""Wind, as a share of the speed, in which every law but tangent lost flights (docs/estimation.md, R_wind5)."""

TANGENT = "tangent"
HARDLY, NEVER = 0.8, 0.95
"""Shares of the speed: above the first tangent on drift hardly comes back (`tune` refuses it), above the second it
loses flights by the dozen (docs/estimation.md, which one do I choose)."""

BELIEVED = 1.0 / 3.0
"""Share of the speed above which what a tilt is believed to make of it is too wrong (docs/vehicles.md)."""


def _cure(config: Config) -> str:
    bears_m_s = HARDLY * config.orbit.speed_m_s
    if (config.study.wind_m_s or 0.0) > bears_m_s:
        return f"law tangent on estimator drift bears {bears_m_s:.3g} m/s, and no more: fly faster"
    return "law tangent on estimator drift does not (README, docs/estimation.md)"


def drifting(config: Config) -> Iterator[Finding]:
    """Yield what the law makes of study.wind_m_s, the strongest wind or the speed of the target."""
    if config.law.name == TANGENT:
        yield from _tangent(config)
    elif config.vehicle_class.speed == "ground":
        yield from _target_moves(config)
    else:
        yield _knows_no_wind(config)


def _knows_no_wind(config: Config) -> Finding:
    law, wind_m_s = config.law.name, config.study.wind_m_s
    lost = wind_m_s is not None and wind_m_s >= LOST_SHARE * config.orbit.speed_m_s
    here = f", and study.wind_m_s is {wind_m_s:g}" if lost else ""
    text = f"law {law} loses flights in wind above {LOSES_IN:g} of the speed{here}: {_cure(config)}"
    return Finding("error" if lost else "warning", "law", text)


def _target_moves(config: Config) -> Iterator[Finding]:
    """Yield a warning where the autopilot holds its speed against wind, and a target may go as fast as study says."""
    wind_m_s = config.study.wind_m_s
    if wind_m_s is not None and wind_m_s > LOSES_IN * config.orbit.speed_m_s:
        text = (
            f"if study.wind_m_s = {wind_m_s:g} is the speed of the target: law {config.law.name} loses flights about "
            f"one that goes faster than about a fifth of the vehicle's {config.orbit.speed_m_s:g} m/s, and "
            f"{_cure(config)}; if it is wind, the autopilot holds the speed over the ground, and nothing is lost"
        )
        yield Finding("warning", "law", text)


def _tangent(config: Config) -> Iterator[Finding]:
    wind_m_s, V, speed = config.study.wind_m_s, config.orbit.speed_m_s, config.vehicle_class.speed
    if wind_m_s is None:
        return
    what = f"if study.wind_m_s = {wind_m_s:g} is the speed of the target: " if speed == "ground" else ""
    if wind_m_s > NEVER * V:
        text = f"above {NEVER:g} of the speed ({NEVER * V:.3g} m/s) the vehicle does not come back: flights are lost"
        yield Finding("warning" if what else "error", "law", what + text)
    elif wind_m_s > HARDLY * V:
        text = (
            f"above {HARDLY:g} of the speed ({HARDLY * V:.3g} m/s) the vehicle hardly comes back: it takes long, and "
            "some flights are lost"
        )
        yield Finding("warning", "law", what + text)
    elif wind_m_s > BELIEVED * V and speed == "believed":
        text = (
            f"the speed is believed, from the tilt: do not fly in wind above a third of it ({BELIEVED * V:.3g} m/s; "
            "docs/vehicles.md)"
        )
        yield Finding("warning", "law", text)
