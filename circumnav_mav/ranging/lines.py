"""Any device that speaks in lines: say where the range stands, by a regular expression or JSON paths, and its units.

    {source: lines, pattern: 'D=(?P<range>[0-9.]+)', range_unit: cm}
    {source: lines, json: {range: data.0.dist, rate: data.0.v, beacon_id: tag}, range_unit: mm, rate_unit: cm/s}

Fields: range, rate (+ opening), sigma (in range_unit), time, beacon_id, quality (percent).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from circumnav_mav.ranging.framing import LineDecoder, not_understood
from circumnav_mav.ranging.plug import (
    FARTHEST_M,
    NAN,
    ByteDecoder,
    ByteSource,
    Reading,
    check_all,
    finite,
    number,
    refuse,
)
from circumnav_mav.ranging.units import LENGTH, SPEED, TIME
from circumnav_mav.types import Rejected

FIELDS = ("range", "rate", "sigma", "time", "beacon_id", "quality")
CARRIED_AS = {"time": "stamp_s", "beacon_id": "beacon_id", "quality": "quality_pct"}

UNITS = {"range_unit": (LENGTH, "m"), "rate_unit": (SPEED, "m/s"), "time_unit": (TIME, "s")}
"""The tables of the keys that name units, and what stands where a key is not given."""
NOTHING = r"(?!)"

Extract = Callable[[str], Mapping[str, Any] | None]


def decoder(options: Mapping[str, Any]) -> ByteDecoder:
    """Return what reads the lines. Raises Faults, all of them at once."""
    check_all(
        lambda: _extractor(options),
        lambda: _regex(options, "ignore"),
        lambda: _base(options),
        *(partial(_unit, options, key) for key in UNITS),
    )
    extract, ignore, base = _extractor(options), _regex(options, "ignore"), _base(options)
    range_si, rate_si, time_si = (_unit(options, key) for key in UNITS)

    def parse(line: str, now_s: float) -> list[Reading | Rejected]:
        if ignore.search(line):
            return []
        fields = extract(line)
        if fields is None or fields.get("range") is None:
            return [not_understood(line, now_s)]

        def si(name: str, factor: float) -> float:
            value = fields.get(name)
            return NAN if value is None else finite(value) * factor

        beacon_id = fields.get("beacon_id")
        try:
            return [
                Reading(
                    range_m=si("range", range_si),
                    range_rate_m_s=si("rate", rate_si),
                    sigma_m=si("sigma", range_si),
                    beacon_id=None if beacon_id is None else _id(beacon_id, base),
                    quality_pct=si("quality", 1.0),
                    stamp_s=si("time", time_si),
                )
            ]
        except ValueError:
            return [not_understood(line, now_s)]

    return LineDecoder(parse)


def _id(value: Any, base: int) -> int:
    """Return a beacon's number. Some JSON writers know no integers: 3.0 is 3. ValueError where it is not whole."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return int(str(value), base)


def _extractor(options: Mapping[str, Any]) -> Extract:
    found = {key: build(options) for key, build in EXTRACTORS.items() if key in options}
    if len(found) != 1:
        raise ValueError(
            "ranging: the source lines needs either a pattern or json, and not both, as in "
            "pattern: 'D=(?P<range>[0-9.]+)'"
        )
    (extract,) = found.values()
    return extract


def _by_pattern(options: Mapping[str, Any]) -> Extract:
    pattern = _regex(options, "pattern")
    refuse(_field_faults("pattern", pattern.groupindex))

    def by_pattern(line: str) -> Mapping[str, Any] | None:
        match = pattern.search(line)
        return match.groupdict() if match else None

    return by_pattern


def _by_json(options: Mapping[str, Any]) -> Extract:
    paths = options["json"]
    if not isinstance(paths, Mapping) or not all(isinstance(path, str) and path for path in paths.values()):
        raise ValueError("ranging.json must map fields to paths, such as {range: data.0.distance}")
    steps = {name: path.split(".") for name, path in paths.items()}
    empty = (f"ranging.json: the path {paths[name]!r} has an empty step" for name in steps if "" in steps[name])
    refuse([*_field_faults("json", paths), *empty])

    def by_path(line: str) -> Mapping[str, Any] | None:
        try:
            document = json.loads(line)
        except (ValueError, RecursionError):
            return None
        return {name: _walk(document, path) for name, path in steps.items()}

    return by_path


EXTRACTORS: dict[str, Callable[[Mapping[str, Any]], Extract]] = {"pattern": _by_pattern, "json": _by_json}


def named(options: Mapping[str, Any]) -> frozenset[str]:
    """Return the fields of a Reading that the pattern or the paths name, other than range, rate and sigma."""
    names = re.compile(str(options["pattern"])).groupindex if "pattern" in options else options["json"]
    return frozenset(CARRIED_AS[name] for name in names if name in CARRIED_AS)


def _walk(document: Any, path: list[str]) -> Any:
    for step in path:
        if isinstance(document, dict):
            document = document.get(step)
        elif isinstance(document, list) and step.isdecimal() and int(step) < len(document):
            document = document[int(step)]
        else:
            return None
    return document


def _field_faults(key: str, names: Mapping[str, Any]) -> Iterator[str]:
    unknown = sorted(str(name) for name in set(names) - set(FIELDS))
    if unknown:
        yield f"ranging.{key} names {', '.join(unknown)}; the fields are {', '.join(FIELDS)}"
    elif "range" not in names:
        yield f"ranging.{key} does not say where the range is: name a field `range`"


def _regex(options: Mapping[str, Any], key: str) -> re.Pattern[str]:
    """Return the expression; where none is given, one that finds nothing."""
    try:
        return re.compile(str(options[key]) if key in options else NOTHING)
    except re.error as error:
        raise ValueError(f"ranging.{key} is no regular expression: {error}") from error


def _unit(options: Mapping[str, Any], key: str) -> float:
    units, default = UNITS[key]
    unit = options.get(key, default)
    if not isinstance(unit, str) or unit not in units:
        raise ValueError(f"ranging.{key} is {unit!r}, but must be one of {', '.join(units)}")
    return units[unit]


def _base(options: Mapping[str, Any]) -> int:
    wanted = number(options, "id_base", 10, least=2)
    if wanted > 36:
        raise ValueError("ranging.id_base must be at most 36")
    if int(wanted) != wanted:
        raise ValueError(f"ranging.id_base is {wanted:g}, but must be a whole number")
    return int(wanted)


SOURCE = ByteSource(
    name="lines",
    summary="any device that sends lines: by a regular expression or JSON paths, with units",
    decoder=decoder,
    lines=True,
    resolution_m=0.01,
    carries=frozenset({"beacon_id", "quality_pct", "stamp_s"}),
    most_m=FARTHEST_M,
    has_rate=True,
    named=named,
    options={
        "pattern": "regular expression with named groups: range, and if present rate, sigma, time, beacon_id, quality",
        "json": "the same fields as paths into one JSON object a line, such as {range: data.0.distance}",
        "range_unit": f"unit of range and sigma: {', '.join(LENGTH)}",
        "rate_unit": f"unit of rate: {', '.join(SPEED)}",
        "time_unit": f"unit of time: {', '.join(TIME)}",
        "id_base": "number base of beacon_id, 10 unless given",
        "ignore": "regular expression of lines to pass over in silence",
    },
)
