"""docs/guidance_law.md and docs/estimation.md have a row for every option of every law and estimator."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS

DOCS = Path(__file__).parent.parent.parent / "docs"
OPTIONS = [
    (page, plug.name, key, default)
    for page, plugs in (("guidance_law.md", LAWS), ("estimation.md", ESTIMATORS))
    for plug in plugs.values()
    for key, default in plug.options.items()
]


@pytest.mark.parametrize(("page", "name", "key", "default"), OPTIONS)
def test_every_option(page, name, key, default):
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in (DOCS / page).read_text().splitlines()]
    (row,) = (row for row in rows if len(row) == 5 and f"`{name}`" in row[0].split(", ") and row[1] == f"`{key}`")
    if not math.isnan(default):
        assert row[2] == f"{default:g}"
    assert all(row)
