"""What follows from a configuration, in words and figures, before anything flies."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan, radians

from circumnav_mav.advice import handing_over, slant, suits
from circumnav_mav.config import Config, Limits, Ranging, Vehicle
from circumnav_mav.config_defaults import told
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import DEFAULT_KAPPA, gain
from circumnav_mav.guidance.verdict import Finding, Flight, Severity, report, report_plain, verdict
from circumnav_mav.lag_advice import bears_lag, told_by_its_loop
from circumnav_mav.option_advice import odd_options
from circumnav_mav.range_advice import ages, carried_far, jumps, rate_of_ranges, seldom
from circumnav_mav.ranging import SOURCES, MessageSource, carried
from circumnav_mav.ranging.plug import Source
from circumnav_mav.wind_advice import drifting

PROVEN = "hashemi2013"
"""The law that the paper's recurrence bound is about: its outer half alone has none."""

CHOOSES_BY = (
    ("sensor_id", "sensor_id", "sensor's id"),
    ("beacon_id", "beacon_id", "beacon's id"),
    ("orientation", "orientation", "orientation"),
    ("min_quality_pct", "quality_pct", "quality"),
)
"""Keys of `ranging:`, the field of a reading that each is compared with, and that in words."""

MARK: dict[Severity, str] = {"error": "ERROR  ", "warning": "warning", "info": "       "}


def findings(config: Config) -> list[Finding]:
    """Return what the theory says of this configuration, and which keys do nothing in it, gravest first."""
    orbit = config.orbit
    of_paper = "k" in LAWS[config.law.name].options  # the paper's gain and r_s; pd_bias has a kappa of its own
    kappa = gain(config.law.options, orbit.radius_m) if of_paper else DEFAULT_KAPPA
    flight = Flight(
        r_a=orbit.radius_m,
        kappa=kappa,
        V=orbit.speed_m_s,
        turn_rate_limit=config.turn_rate_limit_rad_s,
        # What the velocity lead does not take out of the vehicle's lag, and half a tick of holding a command.
        lag_s=config.turn_lag_s + abs(config.vehicle_class.lead_s - config.lead_s),
        update_s=1.0 / config.loop.rate_hz,
        bank_limit=radians(config.limits.bank_deg) if config.vehicle_class.banks else nan,
        wind=nan if config.study.wind_m_s is None else config.study.wind_m_s,
        over_ground=config.vehicle_class.speed == "ground",
    )
    idle = [Finding("warning", "idle", text) for text in idle_keys(config)]
    found = report(flight) if of_paper else report_plain(flight)
    if config.law.name != PROVEN:
        found = [finding for finding in found if finding.topic != "recurrence"]
    if of_paper:
        found += rate_of_ranges(config, kappa, flight.lag_s + 0.5 * flight.update_s)
    else:
        found += bears_lag(config, abs(config.vehicle_class.lead_s - config.lead_s) + 0.5 * flight.update_s)
        found += told_by_its_loop(config)
    found += [*suits(config), *drifting(config), *slant(config), *ages(config), *seldom(config), *jumps(config)]
    found += [*carried_far(config), *handing_over(config), *odd_options(config), *idle]
    return sorted(found, key=lambda finding: list(MARK).index(finding.severity))


def idle_keys(config: Config) -> Iterator[str]:
    """Yield a line for each key that is set and does nothing with the vehicle class or the source chosen."""
    kind, given, source = config.vehicle_class, config.vehicle, SOURCES[config.ranging.source]
    yield from _idle_ranging_keys(config.ranging, source)
    defaults = Vehicle.model_fields
    for key in ("pitch_deg", "thrust"):
        if getattr(given, key) != defaults[key].default and not kind.attitude:
            yield f"vehicle.{key} does nothing: {kind.name} does not fly by attitude"
    if config.limits.bank_deg != Limits.model_fields["bank_deg"].default and not kind.banks:
        yield f"limits.bank_deg does nothing: {kind.name} does not turn by a bank"


def _idle_ranging_keys(ranging: Ranging, source: Source) -> Iterator[str]:
    carries, of_messages = carried(source, ranging.options), isinstance(source, MessageSource)
    if ranging.sender is not None and not of_messages:
        yield f"ranging.from does nothing: {source.name} is a device on a line of its own, which nobody else sends on"
    for key, field, what in CHOOSES_BY:
        if getattr(ranging, key) is not None and field not in carries:
            yield f"ranging.{key} does nothing: {source.name} carries no {what}"
    if not ranging.use_stamps and "stamp_s" not in carries:
        yield f"ranging.use_stamps does nothing: {source.name} carries no time of its own"
    if ranging.stamped_by == "autopilot":
        if not of_messages:
            yield f"ranging.stamped_by does nothing: {source.name} is a device with a clock of its own"
        elif "stamp_s" not in carries or not ranging.use_stamps:
            why = f"{source.name} carries no time of its own" if ranging.use_stamps else "use_stamps is false"
            yield f"ranging.stamped_by does nothing: {why}"


def holds(found: list[Finding]) -> bool:
    """Return whether nothing speaks against holding the orbit."""
    return all(finding.severity != "error" for finding in found)


def consequences(config: Config, found: list[Finding]) -> Iterator[str]:
    """Yield the lines that `circumnav check` prints, with what `findings` found."""
    orbit, ranging = config.orbit, config.ranging
    law = LAWS[config.law.name]
    yield f"vehicle    {config.vehicle.kind} on {config.vehicle.link}, engage: {config.engage}"
    yield f"it needs   {', '.join(' or '.join(group) for group in config.vehicle_class.needs)} from the autopilot"
    where = ranging.endpoint or "the vehicle's link"
    yield f"range      {ranging.source} on {where}"
    late = f"stale after {ranging.max_age_s:g} s, carried for {ranging.coast_s:g} s"
    yield f"range lost {late}, then {config.on_range_lost}"
    yield f"orbit      {orbit.radius_m:g} m {orbit.direction} at {orbit.speed_m_s:g} m/s"
    yield from (f"{heading:<10} {words}" for heading, words in told(config))
    yield f"law        {law.name}: {law.source}"
    needs = ", ".join(sorted(ESTIMATORS[config.estimator.name].needs)).replace("_", " ")
    yield f"estimator  {config.estimator.name}: needs {needs}; {config.vehicle.kind} has them"
    for finding in found:
        yield f"{MARK[finding.severity]}    {finding.text}"
    yield verdict(found)
