"""A configuration file: every fault in it at once, with its line, before anything moves."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from circumnav_mav.config import Config, Ranging, guidance_settings
from circumnav_mav.config_checks import cross_checks, nearest, range_number_checks, range_source_checks

Where = tuple[str | int, ...]
S = TypeVar("S", bound=BaseModel)
Look = Callable[[S], Iterator[tuple[str, str]]]
"""Looks at a section and yields (path, what is wrong)."""
NO_LOOKS: Mapping[str, Look[Any]] = {}


class Fault(NamedTuple):
    """One thing that is wrong: where (dotted path, line; 0 = the file as a whole) and what."""

    path: str
    line: int
    text: str


class ConfigError(Exception):
    """All faults of a file at once."""

    def __init__(self, file: str, faults: list[Fault]) -> None:
        self.file, self.faults = file, faults
        super().__init__("\n".join(self.lines()))

    def lines(self) -> Iterator[str]:
        """Yield one line a fault, `file:line: path: what`."""
        for fault in self.faults:
            place = f"{self.file}:{fault.line}" if fault.line else self.file
            yield f"{place}: {fault.path}: {fault.text}" if fault.path else f"{place}: {fault.text}"


def load(path: str | Path, looks: Mapping[str, Look[Any]] = NO_LOOKS) -> Config:
    """Return the settings of a file. Raises ConfigError with every fault in it; looks: what else finds some."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(str(path), [Fault("", 0, f"cannot read the configuration: {reason}")]) from error
    return parse(text, str(path), looks)


def parse(text: str, file: str = "config", looks: Mapping[str, Look[Any]] = NO_LOOKS) -> Config:
    """Return the settings in `text`. Raises ConfigError with every fault in it; looks: by section."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        lines = _Lines(tree)
        if lines.endless:
            raise ConfigError(
                file, [Fault(path, line, "an alias that contains itself") for path, line in lines.endless]
            )
        data = yaml.safe_load(text)
    except RecursionError as error:
        raise ConfigError(file, [Fault("", 0, "nested too deeply")]) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        what = getattr(error, "problem", None) or str(error)
        raise ConfigError(file, [Fault("", mark.line + 1 if mark else 0, f"not YAML: {what}")]) from error
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise ConfigError(file, [Fault("", 1, "a configuration is a list of sections such as 'orbit: {radius_m: 50}'")])
    faults = [Fault(path, line, "given twice") for path, line in lines.twice]
    config = None
    found: list[tuple[str, str]] = []
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        faults += [_fault(e, lines) for e in error.errors()]
        wrong = {(str(e["loc"][0]), str(e["loc"][1])) for e in error.errors() if len(e["loc"]) > 1}
        sections = _without(wrong, data)
        if isinstance(ranging := sections.get("ranging"), Ranging):
            found += _ranging_beside(ranging, {key for section, key in wrong if section == "ranging"})
    else:
        sections = dict(config)
        found += cross_checks(config, guidance_settings(config))
    found += [fault for name, look in looks.items() if name in sections for fault in look(sections[name])]
    faults += [Fault(path, lines.of(tuple(path.split("."))), text) for path, text in found]
    if faults or config is None:
        raise ConfigError(file, sorted(faults, key=lambda f: f.line))
    return config


def _without(wrong: set[tuple[str, str]], data: dict[str, Any]) -> dict[str, BaseModel]:
    """Return the sections of a faulty file as far as they can be had, without the (section, key) that are wrong."""
    sections: dict[str, BaseModel] = {}
    for name, field in Config.model_fields.items():
        given, kind = data.get(name, {}), field.annotation
        if isinstance(given, dict) and isinstance(kind, type) and issubclass(kind, BaseModel):
            with suppress(ValidationError):
                right = {key: value for key, value in given.items() if (name, str(key)) not in wrong}
                sections[name] = kind.model_validate(right)
    return sections


def _ranging_beside(ranging: Ranging, wrong: set[str]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong together in the ranging section, as far as it can be told without the keys `wrong` alone."""
    told = [*range_number_checks(ranging), *(range_source_checks(ranging) if "source" not in wrong else ())]
    for path, text in told:
        if not wrong & {path.split(".")[1], *re.findall(r"\w+_\w+", text)}:  # else it may speak of a default
            yield path, text


def _fault(error: Any, lines: _Lines) -> Fault:
    where: Where = tuple(error["loc"])
    path = ".".join(str(p) for p in where)
    if error["type"] == "extra_forbidden":
        known = _keys_at(where[:-1])
        return Fault(path, lines.of(where), f"no such key{nearest(str(where[-1]), known) or '; ' + _listed(known)}")
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "literal_error":
        message = f"must be {error['ctx']['expected']}{nearest(str(error['input']), _quoted(error))}"
    elif error["type"] != "value_error":
        message = f"{message[0].lower()}{message[1:]}, not {error['input']!r}"
    return Fault(path, lines.of(where), message)


def _quoted(error: Any) -> list[str]:
    return str(error["ctx"]["expected"]).replace("'", "").replace(" or ", ", ").split(", ")


def _listed(known: list[str]) -> str:
    return "there are: " + ", ".join(known)


def _keys_at(where: Where) -> list[str]:
    model: type[BaseModel] = Config
    for part in where:
        field = model.model_fields.get(str(part)) or next(
            (f for f in model.model_fields.values() if f.alias == part), None
        )
        inner = field.annotation if field else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


class _Lines:
    """Which line of the file each key stands on, which keys stand there twice, and which aliases contain themselves."""

    def __init__(self, tree: yaml.Node | None) -> None:
        self._at: dict[Where, int] = {}
        self._open: set[int] = set()  # ids of the nodes that the walk is inside of
        self._seen: set[int] = set()  # ids of all nodes: what an alias repeats is walked once
        self.twice: list[tuple[str, int]] = []
        self.endless: list[tuple[str, int]] = []
        if tree is not None:
            self._walk(tree, ())

    def _walk(self, node: yaml.Node, where: Where) -> None:
        if id(node) in self._open:
            self.endless.append((".".join(str(p) for p in where), self.of(where)))
        if id(node) in self._seen:
            return
        self._seen.add(id(node))
        self._open.add(id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                here = (*where, str(key.value))
                line = key.start_mark.line + 1
                if here in self._at:
                    self.twice.append((".".join(str(p) for p in here), line))
                self._at[here] = line
                self._walk(value, here)
        elif isinstance(node, yaml.SequenceNode):
            for n, item in enumerate(node.value):
                self._walk(item, (*where, n))
        self._open.discard(id(node))

    def of(self, where: Where) -> int:
        """Return the line of a path, or of the nearest part of it that stands in the file; 0 for none."""
        texts = tuple(str(p) for p in where)
        while texts:
            if texts in self._at:
                return self._at[texts]
            texts = texts[:-1]
        return 0
