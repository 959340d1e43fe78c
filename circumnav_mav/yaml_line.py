"""Change one value in a YAML file's text and nothing else: comments, order, quotes and line ends stay. Pure."""

from __future__ import annotations

from typing import Any

import yaml


def with_value(text: str, section: str, key: str, value: str) -> str:
    """Return `text` with `section: {key: value}` set, where `value` is a plain scalar such as 0.312.

    The key's line is edited where it stands, added to its section where it does not, and the section added at the end
    where that is missing too. Raises ValueError, in words, where that cannot be done safely.
    """
    try:
        edited = _edit(text, section, key, value)
        before, after = yaml.safe_load(text) or {}, yaml.safe_load(edited)
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", error)
        raise ValueError(f"edited, it would not be YAML ({problem}): set {section}.{key} by hand") from error
    before[section] = {**(before.get(section) or {}), key: yaml.safe_load(value)}
    if after != before:
        raise ValueError(f"its form is too intricate to edit (anchors? merge keys?): set {section}.{key} by hand")
    return edited


def _edit(text: str, section: str, key: str, value: str) -> str:
    end_of_line = "\r\n" if "\r\n" in text else "\n"
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is None or _value_of(root, section) is None:
        if isinstance(root, yaml.MappingNode) and root.flow_style:  # the whole file stands in braces
            at = root.start_mark.index + 1
            return f"{text[:at]}{section}: {{{key}: {value}}}{', ' if root.value else ''}{text[at:]}"
        gap = "" if not text or text.endswith("\n") else end_of_line
        return f"{text}{gap}{section}:{end_of_line}  {key}: {value}{end_of_line}"
    body = _value_of(root, section)
    if isinstance(body, yaml.ScalarNode) and body.tag == "tag:yaml.org,2002:null":
        at = _after_key(root, section)  # `section:` with nothing in it
        return f"{text[:at]}{end_of_line}  {key}: {value}{text[body.end_mark.index :]}"
    if not isinstance(body, yaml.MappingNode):
        raise ValueError(f"{section} is no section: set {section}.{key} by hand")
    old = _value_of(body, key)
    if old is not None:
        return _replace(text, old, value)
    if body.flow_style:
        at = body.start_mark.index + 1
        return f"{text[:at]}{key}: {value}{', ' if body.value else ''}{text[at:]}"
    first = body.value[0][0].start_mark
    return f"{text[: first.index]}{key}: {value}{end_of_line}{' ' * first.column}{text[first.index :]}"


def _replace(text: str, old: yaml.Node, value: str) -> str:
    start, end = old.start_mark.index, old.end_mark.index
    space = "" if start == 0 or text[start - 1] in " \t" else " "  # `key:` with nothing behind it
    return f"{text[:start]}{space}{value}{text[end:]}"


def _value_of(node: yaml.Node, key: str) -> yaml.Node | None:
    if not isinstance(node, yaml.MappingNode):
        raise ValueError("it is no list of sections: set the value by hand")
    pairs: list[tuple[Any, Any]] = node.value
    return next((value for name, value in pairs if getattr(name, "value", None) == key), None)


def _after_key(node: yaml.Node, key: str) -> int:
    name = next(name for name, _ in node.value if name.value == key)
    return int(name.end_mark.index) + 1  # the colon
