"""The README against the program: every key and command is in it, and every file it links exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from circumnav_mav.cli import app
from circumnav_mav.config import Config

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")

KEYS = [
    field.alias or key
    for section in Config.model_fields.values()
    for key, field in getattr(section.annotation, "model_fields", {}).items()
]


@pytest.mark.parametrize("key", sorted({*KEYS, "engage", "on_range_lost"}))
def test_every_key_of_the_configuration_is_described(key):
    assert re.search(rf"`(\w+\.)?{key}`", README), f"the README does not describe {key}"


@pytest.mark.parametrize("command", [c.name or c.callback.__name__ for c in app.registered_commands])
def test_every_command_is_described(command):
    assert f"`circumnav {command}" in README


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_every_linked_file_exists(link):
    assert (ROOT / link).exists(), link
