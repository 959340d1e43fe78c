"""docs/ranging.md names every source, every option and every reason."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from circumnav_mav.ranging import SOURCES, ByteSource
from circumnav_mav.ranging.plug import Reason

ROOT = Path(__file__).parent.parent.parent
APP = ROOT / "circumnav_mav"
TEXT = (ROOT / "docs" / "ranging.md").read_text()
OPTIONS = [(s.name, key) for s in SOURCES.values() if isinstance(s, ByteSource) for key in s.options]


@pytest.mark.parametrize("name", SOURCES)
def test_every_source(name):
    assert f"| `{name}` |" in TEXT


@pytest.mark.parametrize(("source", "key"), OPTIONS)
def test_every_option(source, key):
    assert any(line.startswith(f"| `{source}` |") and f"`{key}`" in line for line in TEXT.splitlines())


def reasons():
    """Every reason the app can give: those of the sources, and what the rest of it passes to Rejected as a string."""
    yield from Reason
    for path in APP.rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text())):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Rejected":
                assert len(call.args) >= 2, f"{path}:{call.lineno} gives its reason in a way this test does not read"
                if isinstance(call.args[1], ast.Constant):
                    yield call.args[1].value


def test_every_reason():
    given, section = set(reasons()), TEXT.split("## Why a range is turned away")[1].split("\n## ")[0]
    first_cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    told = {word for cell in first_cells for word in re.findall("`([a-z_]+)`", cell)}
    assert {"outlier", "overhead", "no_height", "too_old", "out_of_order", *Reason} <= given
    assert told == given
