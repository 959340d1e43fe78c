"""What follows from a configuration, in words and figures, before anything flies."""

from __future__ import annotations

from collections.abc import Iterator

from circumnav_mav.config import Config
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import DEFAULT_KAPPA, gain
from circumnav_mav.guidance.verdict import Finding, Flight, report, verdict

MARK = {"error": "ERROR  ", "warning": "warning", "info": "       "}


def findings(config: Config) -> list[Finding]:
    """Return what the theory says of this configuration, gravest first."""
    orbit = config.orbit
    kappa = gain(config.law.options, orbit.radius_m) if "kappa" in LAWS[config.law.name].options else DEFAULT_KAPPA
    flight = Flight(
        r_a=orbit.radius_m,
        kappa=kappa,
        V=orbit.speed_m_s,
        turn_rate_limit=config.turn_rate_limit_rad_s,
        # What the velocity lead does not take out of the vehicle's lag, and half a tick of holding a command.
        lag_s=config.vehicle_class.turn_lag_s + abs(config.vehicle_class.lead_s - config.lead_s),
        update_s=1.0 / config.loop.rate_hz,
    )
    return report(flight)


def consequences(config: Config) -> Iterator[str]:
    """Yield the lines that `circumnav check` prints."""
    orbit, ranging = config.orbit, config.ranging
    law, estimator = LAWS[config.law.name], ESTIMATORS[config.estimator.name]
    yield f"vehicle    {config.vehicle.kind} on {config.vehicle.link}, engage: {config.engage}"
    yield f"it needs   {', '.join(' or '.join(group) for group in config.vehicle_class.needs)} from the autopilot"
    where = ranging.endpoint or "the vehicle's link"
    yield f"range      {ranging.source} on {where}"
    late = f"stale after {ranging.max_age_s:g} s, carried for {ranging.coast_s:g} s"
    yield f"range lost {late}, then {config.on_range_lost}"
    yield f"orbit      {orbit.radius_m:g} m {orbit.direction} at {orbit.speed_m_s:g} m/s"
    yield f"guidance   {law.name} ({law.source}) on estimator {estimator.name}"
    found = findings(config)
    for finding in found:
        yield f"{MARK[finding.severity]}    {finding.text}"
    yield verdict(found)
