"""What is wrong with settings that are right alone and wrong together."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from circumnav_mav import endpoint
from circumnav_mav.guidance.computer import GuidanceSettings, band_of, estimator_context
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.estimators.flying import TRAIL_S
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.mavlink.link import COMPANION_COMPONENT
from circumnav_mav.ranging import SOURCES, ByteSource, carried
from circumnav_mav.ranging.plug import Faults, Source

if TYPE_CHECKING:
    from circumnav_mav.config import Config, Ranging

LEAST_PITCH_DEG = -0.5
"""A flatter nose than this pulls nothing along."""


def nearest(word: str, known: Iterable[object]) -> str:
    """Return `, did you mean '...'?` for the known word that is most like it; empty where none is."""
    close = difflib.get_close_matches(word, [str(k) for k in known], n=1)
    return f", did you mean '{close[0]}'?" if close else ""


def cross_checks(config: Config, guidance: GuidanceSettings) -> Iterator[tuple[str, str]]:
    """Yield (path, what is wrong) for values that are right alone and wrong together."""
    orbit = config.orbit
    yield from _vehicle_checks(config)
    room_m = 2.0 * band_of(guidance).margin
    if orbit.r_min_m is not None and orbit.r_min_m > orbit.radius_m - room_m:
        yield (
            "orbit.r_min_m",
            f"must be at least {room_m:.1f} m below the radius: the barrier would bend the orbit itself",
        )
    if orbit.r_max_m is not None and orbit.r_max_m < orbit.radius_m + room_m:
        yield (
            "orbit.r_max_m",
            f"must be at least {room_m:.1f} m above the radius: the barrier would bend the orbit itself",
        )
    yield from _law_checks(config)
    yield from _estimator_checks(config, guidance)
    if config.ranging.max_age_s * config.loop.rate_hz < 2:
        yield "ranging.max_age_s", "shorter than two ticks of loop.rate_hz: every range would be stale"
    yield from range_number_checks(config.ranging)
    if config.engage == "auto" and orbit.height_m is None:
        yield "engage", "auto takes off by itself and needs orbit.height_m, the height to climb to"
    yield from range_source_checks(config.ranging)
    if config.ranging.endpoint and endpoint.parse(config.ranging.endpoint) == endpoint.parse(config.vehicle.link):
        yield "ranging.endpoint", "is vehicle.link: leave it out, and ranges are taken from that link"
    yield from _study_checks(config)
    if config.ranging.sender == (config.vehicle.system_id, COMPANION_COMPONENT) and not config.ranging.endpoint:
        yield "ranging.from", "is this app itself: a program that speaks with its ids keeps it from engaging"
    if config.ranging.sender and config.ranging.sender == (config.vehicle.system_id, 1):
        yield "ranging.from", "is the autopilot that is flown: its own range finder and its echoes are never flown on"


def _law_checks(config: Config) -> Iterator[tuple[str, str]]:
    law, given = LAWS[config.law.name], config.law.options
    whose = f", the law of {config.vehicle.kind}; to fly another, give law.name" * ("law.name" in config.defaulted)
    unknown = sorted(set(given) - set(law.options))
    yield from (("law." + k, f"no option of {law.name}{nearest(k, law.options) or whose}") for k in unknown)
    context = config.law_context()
    known = {key: value for key, value in given.items() if key in law.options}
    for path, text in _refused("law", known, lambda options: law.parameters({**law.options, **options}, context)):
        if path != "law.name" or context.V / context.r_a <= context.turn_rate_limit:  # else said of orbit.radius_m
            yield path, text


CHOOSES_HEIGHT = "drift"
"""The estimator that sees whether ranges are slant: it knows from heading and airspeed how wide a circle was flown."""


def _estimator_checks(config: Config, guidance: GuidanceSettings) -> Iterator[tuple[str, str]]:
    law, estimator, given = LAWS[config.law.name], ESTIMATORS[config.estimator.name], config.estimator.options
    missing = sorted(set(law.needs) - estimator.gives - {"V"})
    if missing:
        able = [name for name, other in ESTIMATORS.items() if set(law.needs) <= other.gives | {"V"}]
        yield "estimator.name", f"law {law.name} needs {', '.join(missing)}, which only {' or '.join(able)} gives"
    blind = sorted(estimator.needs - config.vehicle_class.senses - {"range"})
    if blind:
        lacking = ", ".join(blind).replace("_", " ")
        yield "estimator.name", f"{estimator.name} needs {lacking}, which {config.vehicle.kind} does not have"
    unknown = sorted(set(given) - set(estimator.options))
    yield from (("estimator." + k, f"no option of {estimator.name}{nearest(k, estimator.options)}") for k in unknown)
    if "sigma_m" in given:
        yield "estimator.sigma_m", "set ranging.sigma_m instead: a flight gives the estimator that, range by range"
    if guidance.choose_height and estimator.name != CHOOSES_HEIGHT:
        yield (
            "ranging.target_height_m",
            f"auto needs estimator {CHOOSES_HEIGHT}, not {estimator.name}: give the target's height above the take-off "
            "(0 = on the ground), or null where ranges are horizontal",
        )
    known = {key: value for key, value in given.items() if key in estimator.options and key != "sigma_m"}
    context = estimator_context(guidance)
    yield from _refused("estimator", known, lambda options: estimator.parameters(options, context))


def _refused(
    section: str, given: dict[str, float], build: Callable[[dict[str, float]], object]
) -> Iterator[tuple[str, str]]:
    """Yield every fault that `build` finds in the options: those it names are set aside, for it to find the next."""
    left = dict(given)
    while True:
        try:
            build(left)
        except ValueError as error:
            named = [word for word in re.findall(r"\w+", str(error)) if word in left]
            yield f"{section}.{named[0] if named else 'name'}", str(error)
            if not named:
                return
            left = {key: value for key, value in left.items() if key not in named}
        else:
            return


def _mavsdk_checks(config: Config) -> Iterator[tuple[str, str]]:
    if config.vehicle_class.words.autopilot != "PX4":
        yield "vehicle.library", "mavsdk was flown with PX4 only: use pymavlink"
    if config.vehicle.signing_key_file is not None:
        yield "vehicle.signing_key_file", "not with library mavsdk: use pymavlink"


def _vehicle_checks(config: Config) -> Iterator[tuple[str, str]]:
    orbit, limits, vehicle = config.orbit, config.limits, config.vehicle_class
    needed, most = orbit.speed_m_s / orbit.radius_m, config.turn_rate_limit_rad_s
    if needed > most:
        limit = f"limits.turn_rate_rad_s = {limits.turn_rate_rad_s:g}"
        if most < limits.turn_rate_rad_s:
            limit = f"the {most:.3f} rad/s that " + (
                f"limits.bank_deg = {limits.bank_deg:g} gives" if vehicle.banks else f"{vehicle.name} accelerates to"
            )
        yield (
            "orbit.radius_m",
            f"flying {orbit.speed_m_s:g} m/s on {orbit.radius_m:g} m turns at {needed:.3f} rad/s, above {limit}: "
            "raise the radius or the limit, or fly slower",
        )
    if vehicle.wants_pitch and config.vehicle.pitch_deg is None:
        yield (
            "vehicle.pitch_deg",
            f"{vehicle.name} measures no speed: give the pitch (nose up, so below 0) at which the vehicle flies "
            f"orbit.speed_m_s = {orbit.speed_m_s:g} through still air",
        )
    elif vehicle.wants_pitch and config.vehicle.pitch_deg is not None and config.vehicle.pitch_deg > LEAST_PITCH_DEG:
        yield (
            "vehicle.pitch_deg",
            f"{config.vehicle.pitch_deg:g} does not fly forward: nose down, below {LEAST_PITCH_DEG:g} degrees",
        )
    if config.vehicle.library == "mavsdk":
        yield from _mavsdk_checks(config)
    if vehicle.words.land is None:
        for key, action in config.safety:
            if action == "land" and (key != "on_estimates_lost" or vehicle.estimates):
                yield f"safety.{key}", f"{vehicle.words.autopilot} has no landing mode: hold, return or stop"
    if config.engage == "auto" and vehicle.take_off is None:
        yield "engage", f"auto takes off, and {vehicle.name} does not: engage: pilot"
    if config.on_range_lost == "land" and vehicle.words.land is None:
        yield "on_range_lost", f"{vehicle.words.autopilot} has no landing mode: hold, return or stop"


def _study_checks(config: Config) -> Iterator[tuple[str, str]]:
    wind_m_s, speed_m_s = config.study.wind_m_s, config.orbit.speed_m_s
    if wind_m_s is not None and wind_m_s >= speed_m_s and config.vehicle_class.speed != "ground":
        yield (
            "study.wind_m_s",
            f"a wind of {wind_m_s:g} m/s is as fast as orbit.speed_m_s = {speed_m_s:g}: no circle over the ground can "
            "be held; fly faster, or not in such a wind",
        )


def range_number_checks(ranging: Ranging) -> Iterator[tuple[str, str]]:
    """Yield what is wrong between the numbers of the section, whatever the source."""
    if ranging.latency_s >= TRAIL_S:
        yield (
            "ranging.latency_s",
            f"{ranging.latency_s:g} s: what was flown is remembered for {TRAIL_S:g} s, so every range would be too "
            "old to be used; give less, or take a quicker sensor",
        )
    elif ranging.latency_s >= ranging.max_age_s:
        yield (
            "ranging.latency_s",
            f"{ranging.latency_s:g} s is not below max_age_s, {ranging.max_age_s:g} s: every range would be stale",
        )
    if ranging.coast_s < ranging.max_age_s:
        yield (
            "ranging.coast_s",
            f"{ranging.coast_s:g} s is below max_age_s, {ranging.max_age_s:g} s: both count from the last range",
        )
    if ranging.min_m is not None and ranging.max_m is not None and ranging.min_m >= ranging.max_m:
        yield "ranging.min_m", f"{ranging.min_m:g} m is not below ranging.max_m, {ranging.max_m:g} m"


def range_source_checks(ranging: Ranging) -> Iterator[tuple[str, str]]:
    """Yield what does not go with the source."""
    source = SOURCES[ranging.source]
    own = list(source.options) if isinstance(source, ByteSource) else []
    unknown = [key for key in ranging.options if key not in own]
    known = [*(field.alias or key for key, field in type(ranging).model_fields.items()), *own]
    yield from ((f"ranging.{key}", f"no such key for {source.name}{nearest(key, known)}") for key in unknown)
    if isinstance(source, ByteSource):
        known_options = {key: value for key, value in ranging.options.items() if key in own}
        for path, words in _option_faults(source, known_options):
            if path != "ranging.source" or not unknown:  # what is missing may be the key that is misspelt
                yield path, words
        if ranging.endpoint is None:
            yield (
                "ranging.endpoint",
                f"{source.name} is a device of its own: say where, as in serial:///dev/ttyUSB0:{source.baud}",
            )
    if ranging.endpoint and endpoint.parse(ranging.endpoint).kind == "file" and source.name != "replay":
        yield "ranging.endpoint", f"a file is read by the source replay, not by {source.name}"
    if ranging.beacon_id is not None:
        yield from _beacon_id_faults(ranging.beacon_id, source, ranging.options)


def _beacon_id_faults(beacon_id: int, source: Source, options: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield why no range of the source could ever be of this beacon."""
    if beacon_id > source.most_beacon_id:
        yield (
            "ranging.beacon_id",
            f"{beacon_id} never comes: {source.name} carries ids up to {source.most_beacon_id:.0f} only",
        )
    faulty = any(True for _ in _option_faults(source, options))
    if "beacon_id" in source.carries and not faulty and "beacon_id" not in carried(source, options):
        yield (
            "ranging.beacon_id",
            f"{beacon_id} never comes: ranging.{'pattern' if 'pattern' in options else 'json'} names no beacon_id, "
            "so that every range would be turned away",
        )


def _option_faults(source: Source, options: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what the source itself says of its options; its words begin with `ranging.KEY` or `ranging:`."""
    try:
        if isinstance(source, ByteSource):
            source.decoder(options)
    except ValueError as error:
        for fault in error.faults if isinstance(error, Faults) else (str(error),):
            match = re.match(r"ranging(?:\.(\w+))?:? (.*)", fault, re.DOTALL)
            key, words = (match[1], match[2]) if match else (None, fault)
            yield f"ranging.{key or 'source'}", words
