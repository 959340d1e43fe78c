"""The stub beside recorded flights of the real PX4: see docs/conformance.md."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stub.capture import CAPTURES, DATA, frames, load
from tests.stub.conformance import compare

REPORT = Path(__file__).parents[2] / "docs" / "conformance.md"
SHARED = Path(__file__).parents[2].parent / "shared" / "captures"


@pytest.mark.parametrize("name", CAPTURES)
def test_the_stub_shows_what_px4_showed(name: str) -> None:
    rows = compare(name)
    assert len(rows) > 40
    assert [r for r in rows if not r.ok] == []


def test_the_report_tells_of_these_rows() -> None:
    """Whoever changes the vehicle writes docs/conformance.md anew."""
    kept = [
        line.strip("| ").split(" | ") for line in REPORT.read_text(encoding="utf-8").splitlines() if line[:1] == "|"
    ]
    rows = [row for name in CAPTURES for row in compare(name)]
    assert [(k[0], k[1], k[3]) for k in kept[2:]] == [(r.capture, r.what, r.stub) for r in rows]
    assert f"{len(rows)} of {len(rows)} rows agree" in REPORT.read_text(encoding="utf-8")


def test_the_extract_is_small() -> None:
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 300_000


@pytest.mark.parametrize("name", CAPTURES)
def test_the_extract_is_what_was_recorded(name: str) -> None:
    path = SHARED / CAPTURES[name]
    if not path.exists():
        pytest.skip(f"the whole captures are not here ({SHARED}); the extract is used without them")
    flight = load(name)
    there = {(round(t, 4), raw) for t, raw in frames(path)}
    assert {(t, raw) for t, raw in flight.sent} <= there
