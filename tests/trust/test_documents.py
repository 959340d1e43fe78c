"""The guides speak of files, keys and phases that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from circumnav_mav.config import Config
from circumnav_mav.guidance.phases import Phase

ROOT = Path(__file__).parents[2]
GUIDES = [ROOT / "docs" / "field_guide.md", ROOT / "docs" / "safety.md"]


def known_keys() -> set[str]:
    keys = set(Config.model_fields)
    for name, field in Config.model_fields.items():
        for key, inner in getattr(field.annotation, "model_fields", {}).items():
            keys.add(f"{name}.{inner.alias or key}")
    return keys


@pytest.mark.parametrize("guide", GUIDES, ids=lambda p: p.name)
def test_every_key_and_file_that_a_guide_names_exists(guide):
    text = guide.read_text(encoding="utf-8")
    sections = "|".join(name for name, f in Config.model_fields.items() if hasattr(f.annotation, "model_fields"))
    named = set(re.findall(rf"`(?:{sections})\.[a-z_]+", text))
    assert named, "the guide names no key: mend the test"
    assert {key[1:] for key in named} <= known_keys()
    for path in re.findall(r"\bconfigs/[\w.]+\w", text):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"\]\((?!http)([^)]+)\)", text):
        assert (guide.parent / path).exists(), path


def test_the_field_guide_shows_every_phase():
    rows = re.findall(r"^\| (`[^|]+) \|", GUIDES[0].read_text(encoding="utf-8"), re.MULTILINE)
    assert {phase for row in rows for phase in re.findall(r"`(\w+)`", row)} == set(Phase)
