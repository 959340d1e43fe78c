"""The shipped plane on both kinds of range, which it is not told: two flights always, more in the soak.

tests/height_rows.py draws direction, place, course and wind; errors are the stub's truth.
"""

from __future__ import annotations

import os

import pytest

from tests.height_rows import LEAST_SHARE, ROWS, fly, main

SHARE, SEED = float(os.environ.get("SOAK_SHARE", "1")), int(os.environ.get("SOAK_SEED", "1"))
SEEDS = range(SEED, SEED + max(1, round(5 * SHARE)))


def flies_well(row: str, seed: int) -> None:
    flight = fly(row, seed)
    assert flight.good, flight
    assert flight.least_m > LEAST_SHARE * 80.0, flight
    if "outliers" not in row:
        assert not any("noisier" in words for words in flight.said), flight


@pytest.mark.parametrize("row", ["ground", pytest.param("level_outliers", marks=pytest.mark.soak)])
def test_the_shipped_plane_finds_out_what_its_ranges_are(row):
    flies_well(row, 1)


@pytest.mark.soak
@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_shipped_plane_finds_it_out_from_anywhere(row, seed):
    flies_well(row, seed)


def test_the_command_names_the_rows_there_are(capsys):
    assert main(["nothing"]) == 2
    assert "level_outliers" in capsys.readouterr().err
