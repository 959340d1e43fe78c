"""`circumnav demo` where something is amiss: a stub that does not start, a record that cannot be kept."""

from __future__ import annotations

import json

import pytest

from circumnav_mav.report import read_columns
from tests.app.test_realtime import run, written


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("--bogus", "unrecognized arguments: --bogus"),
        ("--wind=a,b", "--wind"),
    ],
)
def test_a_stub_that_does_not_start_ends_the_demo_at_once_in_its_own_words(tmp_path, argument, words):
    done = run("demo", "--config", written(tmp_path, ""), f"--stub-arg={argument}")
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert line.startswith("circumnav: the vehicle stub ended (exit code 2): ") and words in line
    (flight,) = (tmp_path / "flights").iterdir()
    assert float(read_columns(flight / "ticks.csv")["t_s"][-1]) < 140.0  # it waits 150 flight seconds for an autopilot


@pytest.mark.realtime
@pytest.mark.soak
def test_a_demo_without_a_record_flies_has_its_figures_and_says_so(tmp_path):
    (tmp_path / "flights").write_text("in the way")
    figures = tmp_path / "demo.json"
    done = run("demo", "--config", written(tmp_path, ""), "--duration", "20", "--json", str(figures))
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr
    assert f"the record is incomplete: {tmp_path}/flights: " in done.stderr
    assert json.loads(figures.read_text())["error_from"] == "truth"
