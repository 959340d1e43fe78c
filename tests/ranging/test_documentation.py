"""docs/ranging.md names every source, every option and every reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from circumnav_mav.ranging import SOURCES, ByteSource
from circumnav_mav.ranging.plug import Reason

TEXT = (Path(__file__).parent.parent.parent / "docs" / "ranging.md").read_text()
OPTIONS = [(s.name, key) for s in SOURCES.values() if isinstance(s, ByteSource) for key in s.options]


@pytest.mark.parametrize("name", SOURCES)
def test_every_source(name):
    assert f"| `{name}` |" in TEXT


@pytest.mark.parametrize(("source", "key"), OPTIONS)
def test_every_option(source, key):
    assert any(line.startswith(f"| `{source}` |") and f"`{key}`" in line for line in TEXT.splitlines())


@pytest.mark.parametrize("reason", Reason)
def test_every_reason(reason):
    assert f"`{reason}`" in TEXT
