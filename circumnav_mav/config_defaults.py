"""What a file leaves open and the vehicle class decides: law, estimator, and the numbers that an airframe needs.

Explicit values win, key by key. A law or an estimator that the class would choose gives way to one that goes with what
the file names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.mavlink.vehicles import VEHICLES

if TYPE_CHECKING:
    from circumnav_mav.config import Config

USUAL_VEHICLE = "px4_multirotor"
SIMPLE_LAW = "hashemi2013"
"""Needs range and range rate only: every estimator gives them."""
SIMPLE_ESTIMATORS = ("direct", "drift")
PLUGS = ("law", "estimator")
HEIGHT = "ranging.target_height_m"
"""Where a class would find it out (auto), that is for its own estimator to do: with another, ranges are horizontal."""
SPEEDS = {"ground": "measured over the ground", "air": "measured airspeed", "believed": "believed, from the tilt"}


def with_defaults(data: Mapping[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the settings with the class's defaults filled in, and the paths of those that were.

    What is wrong in `data` is left as it is, for the validation to find.
    """
    named = str(_get(data.get("vehicle"), "class", "kind"))
    vehicle = VEHICLES.get(named, VEHICLES[USUAL_VEHICLE])
    filled, paths = dict(data), []
    for section, values in vehicle.defaults.items():
        if section in PLUGS:
            continue
        given = filled.get(section, {} if isinstance(values, Mapping) else None)
        if isinstance(values, Mapping) and isinstance(given, Mapping):
            missing = {key: value for key, value in values.items() if key not in given}
            filled[section] = {**given, **missing}
            paths += [f"{section}.{key}" for key in missing]
        elif section not in data:
            filled[section] = values
            paths.append(section)
    names = {plug: _get(data.get(plug), "name") for plug in PLUGS}
    usual = {plug: vehicle.defaults[plug] for plug in PLUGS}
    chosen = _pair(names, {plug: str(usual[plug]["name"]) for plug in PLUGS})
    for plug in PLUGS:
        given = data.get(plug, {})
        if not isinstance(given, Mapping) or names[plug] is not None:
            continue
        # The class's own options go with its own law, and only where the file gives none.
        own = usual[plug] if not given and chosen[plug] == usual[plug]["name"] else {}
        filled[plug] = {**own, **given, "name": chosen[plug]}
        paths.append(f"{plug}.name")
    if HEIGHT in paths and (names["estimator"] or chosen["estimator"]) != usual["estimator"]["name"]:
        filled["ranging"] = {key: value for key, value in filled["ranging"].items() if key != "target_height_m"}
        paths.remove(HEIGHT)
    return filled, tuple(paths)


def _pair(names: Mapping[str, Any], usual: Mapping[str, str]) -> dict[str, str]:
    """Return a law and an estimator that go together: those named, else those of the class, else simple ones."""
    law, estimator = names["law"], names["estimator"]
    if law is None:
        law = usual["law"] if fits(usual["law"], estimator or usual["estimator"]) else SIMPLE_LAW
    if estimator is None:
        candidates = (usual["estimator"], *SIMPLE_ESTIMATORS)
        estimator = next((name for name in candidates if fits(law, name)), usual["estimator"])
    return {"law": str(law), "estimator": str(estimator)}


def told(config: Config) -> Iterator[tuple[str, str]]:
    """Yield (heading, words): what steers this flight, and what the vehicle class decided of it."""
    vehicle, open_ = config.vehicle_class, config.defaulted
    words = [f"law {config.law.name}", f"estimator {config.estimator.name}"]
    marks = [" (default)" if f"{plug}.name" in open_ else "" for plug in PLUGS]
    pair = " on ".join(word + mark for word, mark in zip(words, marks, strict=True))
    yield "guidance", f"{pair}, speed: {SPEEDS[vehicle.speed]}"
    others = [path for path in open_ if path.partition(".")[0] not in PLUGS]
    if others:
        values = ", ".join(f"{path} {_value(config, path)}" for path in others)
        yield "defaults", f"of {vehicle.name}: {values}"


def _value(config: Config, path: str) -> str:
    section, _, key = path.partition(".")
    value = getattr(config, section)
    value = getattr(value, key) if key else value
    return f"{value:g}" if isinstance(value, float) else str(value)


def fits(law: Any, estimator: Any) -> bool:
    """Return whether the estimator gives all that the law needs; also for names that are not registered: no fault."""
    if law not in LAWS or estimator not in ESTIMATORS:
        return True
    return set(LAWS[law].needs) <= ESTIMATORS[estimator].gives | {"V"}


def _get(section: Any, *keys: str) -> Any:
    """Return the first of `keys` that a section (as read, or validated) has; None where it has none."""
    for key in keys:
        value = section.get(key) if isinstance(section, Mapping) else getattr(section, key, None)
        if value is not None:
            return value
    return None
