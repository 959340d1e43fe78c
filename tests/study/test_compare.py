"""The rows of `circumnav compare`: quick samples always, 1,000 runs a row in the soak."""

import json
import math
import os
import pty
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from typer.testing import CliRunner

from circumnav_mav.cli import app
from circumnav_mav.study import compare
from circumnav_mav.study.estimation_claims import ENTRIES, claims, entries, pilot_s_time
from circumnav_mav.study.noise import draw
from circumnav_mav.study.plant import World
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot, simulate

SEED = int(os.environ.get("SOAK_SEED", "1"))
RUNS = max(20, int(1000 * float(os.environ.get("SOAK_SHARE", "1"))))
P_ROWS = ("P_calm", "P_wind25", "P_wind50", "P_moving")
R_ROWS = {
    "R_wind5": 0.6,
    "R_wind7": 0.6,
    "R_moving": 0.6,
    "R_outliers": 0.6,
    "R_dropout": 0.6,
    "R_lag1": 0.6,
    "R_airspeed_high": 0.8,
    "R_airspeed_low": 0.8,
    "R_sigma5": 1.2,
    "R_1Hz": 1.5,
    "R_2Hz_sigma5": 3.0,
    "X_echo_constant": 0.6,
    "X_echo_bursts": 0.6,
}
KEEPS_OFF = ("R_wind5", "R_wind7", "R_moving", "R_outliers", "R_dropout", "R_lag1", "X_echo_constant", "X_echo_bursts")


def check_row(name, runs, seed):
    (row,) = compare.compare([name], runs=runs, seed=seed)
    assert row.lost == 0.0, f"seed {seed}"
    if name in P_ROWS:
        assert row.tail_ms_m2 <= 0.0015
        assert 0.01 * row.u2_ratio <= 0.0115
    else:
        assert row.tail_rms_m <= R_ROWS[name], f"seed {seed}"
    if name in KEEPS_OFF:
        assert row.least_range_m >= 0.25 * 80.0, f"seed {seed}"


@pytest.mark.parametrize("name", [*P_ROWS, *R_ROWS])
def test_a_sample_of_the_figures(name):
    check_row(name, 24, 1)


@pytest.mark.soak
@pytest.mark.parametrize("name", [*P_ROWS, *R_ROWS])
def test_the_figures(name):
    check_row(name, RUNS, SEED)


@pytest.mark.soak
def test_polar_makes_the_paper_s_law_smooth():
    pilot = Pilot("hashemi2013", "polar", {"kappa": 10.0})
    row = compare.row(SCENARIOS["P_calm"], pilot, RUNS, SEED)
    assert row.tail_ms_m2 <= 0.005
    assert 0.01 * row.u2_ratio <= 0.015


def test_settles_nearly_as_fast_as_a_pilot_who_sees_the_target():
    runs, seed = 200, 5
    flown = simulate(SCENARIOS["R_calm"], Pilot(*compare.BEST), runs, seed)
    pilots = np.array([pilot_s_time(draw(SCENARIOS["R_calm"], seed, i).start) for i in range(runs)])
    assert np.mean(flown["settle_s"] <= 1.5 * pilots) >= 0.95


def test_the_pilot_who_sees_flies_the_length_of_the_tangent_and_the_turn():
    """From 400 m, heading right onto the tangent: no turn, and the time is its length up to the edge of the band."""
    heading = math.pi + math.asin(80.0 / 400.0)
    start = World(0.0, 400.0, 0.0, heading, 0.0, *(math.nan,) * 6)
    length_m = math.sqrt(400.0**2 - 80.0**2) - math.sqrt(84.0**2 - 80.0**2)
    assert pilot_s_time(start) == pytest.approx(length_m / 15.0, abs=0.3)
    back = pilot_s_time(start._replace(psi=heading + math.pi))
    assert back == pytest.approx(length_m / 15.0 + math.pi / 0.458, abs=6.0)


def test_the_claims_of_the_page_are_printed():
    lines = list(claims(3, 1))
    assert [line.split(",")[0] for line in lines] == ["P_calm", "P_calm", "R_calm", "R_calm", "R_wind5", "X_gusts"]


def test_the_entries_that_come_too_near_are_counted_and_the_nearest_is_named():
    """Against the rows themselves: least_range of a whole run is that of its entry."""
    lines = list(entries(2, 12, 7))
    assert [line.split(",")[0] for line in lines] == list(ENTRIES)
    least = [simulate(SCENARIOS["R_moving"], Pilot(*compare.BEST), 12, seed)["least_range"] for seed in (7, 8)]
    seed, index = np.unravel_index(np.argmin(least), (2, 12))
    assert f"0 entries come nearer than a quarter of the radius; the nearest comes to {np.min(least):.1f} m" in lines[0]
    assert f"(seed {7 + seed}, entry {index})" in lines[0]


def run(*arguments):
    return CliRunner().invoke(app, list(arguments))


FIELDS = (
    "scenario law estimator runs settled lost settle_time_s tail_ms_m2 tail_rms_m tail_bias_m worst_rms_m u2_ratio "
    "least_range_m"
)


def test_the_command_writes_the_rows_as_json(tmp_path):
    path = tmp_path / "rows.json"
    done = run("compare", *["--scenario", "P_calm"] * 2, "--runs", "5", "--seed", "3", "--json", str(path))
    assert done.exit_code == 0
    (row,) = json.loads(path.read_text())
    assert " ".join(row) == FIELDS
    assert (row["scenario"], row["law"], row["estimator"], row["runs"]) == ("P_calm", "tangent", "drift", 5)
    assert row["tail_rms_m"] == pytest.approx(math.sqrt(row["tail_ms_m2"]))
    assert "P_calm" in done.stdout


def test_a_row_that_never_settles_is_still_json():
    pilot = Pilot("hashemi2013", "raw", {"kappa": 1.0})
    row = compare.row(SCENARIOS["P_wind50"], pilot, 3, 1)
    assert row.settled == 0.0
    assert json.loads(compare.to_json([row]))[0]["settle_time_s"] is None
    assert "nan" in compare.line(row)


def test_the_table_has_every_column_of_a_row_and_fits_the_screen():
    above, below = compare.header().splitlines()
    assert " ".join(above.split()) == "settle tail tail tail worst u2 least"
    names = "scenario law estimator runs settled lost time_s ms_m2 rms_m bias_m rms_m ratio range_m"
    assert " ".join(below.split()) == names
    assert [name for name, *_ in compare.COLUMNS] == FIELDS.split()
    far = (4321098.7654, 2078.7255, -2078.6543, 54321.987, 1.0441, 1234.56)
    lost = compare.Row("R_airspeed_high", "cao2013_saturated", "direct", 1000, 0.0, 1.0, None, *far)
    for row in (lost, compare.Row("P_calm", "tangent", "drift", 1000, 1.0, 0.0, 14.5, 0.00117, *[0.034] * 5)):
        assert max(map(len, (above, below, compare.line(row)))) <= 120
        cells = compare.line(row).split()
        assert len(cells) == len(compare.COLUMNS)
    assert cells[3] == "1000" and cells[7] == "0.00117"


def test_each_row_is_printed_and_kept_as_soon_as_it_is_flown(tmp_path, monkeypatch):
    """Ctrl-C in the third row: two stand in the table and in the file, one line says so, and the exit code is 130."""
    path, whole, seen = tmp_path / "rows.json", compare.row, []

    def row(scenario, *rest):
        seen.append([one["scenario"] for one in json.loads(path.read_text())] if path.exists() else [])
        if scenario.name == "P_wind50":
            raise KeyboardInterrupt
        return whole(scenario, *rest)

    monkeypatch.setattr(compare, "row", row)
    names = ("P_calm", "P_wind25", "P_wind50", "P_moving")
    done = run("compare", *(f"--scenario={name}" for name in names), "--runs", "3", "--json", str(path))
    assert done.exit_code == 130
    assert done.stderr == "circumnav: interrupted\n"
    assert seen == [[], ["P_calm"], ["P_calm", "P_wind25"]]
    assert [one["scenario"] for one in json.loads(path.read_text())] == ["P_calm", "P_wind25"]
    assert [line.split()[0] for line in done.stdout.splitlines()[2:]] == ["P_calm", "P_wind25"]
    assert list(tmp_path.iterdir()) == [path]


def test_a_signal_ends_a_long_row_at_once_and_the_bar_leaves_the_rows_alone(tmp_path):
    """As a person does it, on a terminal: a thousand hours of runs, Ctrl-C after the first row."""
    path, (here, there) = tmp_path / "rows.json", pty.openpty()
    arguments = ["compare", "--scenario", "P_calm", "--scenario", "R_2Hz_sigma5", "--runs", "20", "--json", str(path)]
    program = "from circumnav_mav.study import compare as c; r = c.row\n" + (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # in the background: ignored
        "c.row = lambda s, p, n, *a: r(s, p, n if s.name == 'P_calm' else 10**5, *a)\n"
        f"import sys; from circumnav_mav.cli import main; sys.argv = ['circumnav', *{arguments}]; main()"
    )
    env = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=there, env=env) as child:
        os.close(there)
        drawn = Thread(target=read_all, args=(here, shown := bytearray()))
        drawn.start()
        lines = [child.stdout.readline().decode() for _ in range(3)]
        child.send_signal(signal.SIGINT)
        rest = child.stdout.read()
        assert child.wait() == 130
    drawn.join()
    os.close(here)
    assert lines[2].split()[0] == "P_calm" and rest == b""
    assert b"flying" in shown and b"P_calm" not in shown and b"Traceback" not in shown
    assert shown.rstrip().endswith(b"circumnav: interrupted")
    assert [one["scenario"] for one in json.loads(path.read_text())] == ["P_calm"]


def read_all(descriptor, into):
    with suppress(OSError):  # a terminal that has been left
        while data := os.read(descriptor, 4096):
            into += data


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--scenario", "Q"], "P_calm"),
        (["--law", "q"], "hashemi2013"),
        (["--estimator", "q"], "drift"),
        (["--law", "tangent", "--estimator", "raw"], "cannot fly"),
        (["--runs", "0"], "--runs"),
    ],
)
def test_a_wrong_name_is_answered_with_the_right_ones(arguments, word):
    done = run("compare", *arguments)
    assert done.exit_code == 2
    assert word in done.stderr


def test_a_law_that_cannot_fly_is_said_to_be_left_out(monkeypatch):
    flown = []
    some = compare.Row("P_calm", "", "", 1, 0, 0, None, 0, 0, 0, 0, 0, 0)
    monkeypatch.setattr(compare, "row", lambda scenario, pilot, *_: flown.append(pilot.law) or some)
    names = ["--law", "tangent", "--law", "hashemi2013", "--estimator", "polar", "--scenario", "P_calm", "--runs", "1"]
    done = run("compare", *names)
    assert flown == ["hashemi2013"]
    assert "left out: tangent cannot fly on polar, which does not give" in done.stderr
    assert "left out" not in run("compare", *names[2:]).stderr
    assert "left out" not in run("compare", *names[4:], "--all").stderr


PAIRS_TABLE = re.findall(
    r"^\| (\w+) \| (raw|direct|polar|drift) \| (.*\d.*) \|$",
    (Path(__file__).parents[2] / "docs" / "estimation.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)[:9]


@pytest.mark.soak
def test_a_row_of_the_table_of_pairs_is_what_its_command_prints():
    """docs/estimation.md, 100 runs of seed 1, rounded as there; another row for another SOAK_SEED."""
    assert len(PAIRS_TABLE) == 9
    law, estimator, cells = PAIRS_TABLE[SEED % 9]
    names = ["P_calm", "P_wind25", "R_calm", "R_wind5", "R_outliers"]
    for row, cell in zip(compare.compare(names, [law], [estimator], 100, 1), cells.split(" | "), strict=True):
        if row.lost:
            assert cell == f"lost {100.0 * row.lost:.0f} %", row
        else:
            rms_m, u2 = map(float, cell.split(", "))
            assert row.tail_rms_m == pytest.approx(rms_m, abs=0.0006 if row.scenario[0] == "P" else 0.006), row
            assert row.u2_ratio == pytest.approx(u2, abs=0.006), row


def test_only_what_can_fly_is_paired():
    flown = compare.pairs(["hashemi2013", "tangent"], ["raw", "direct", "polar", "drift"])
    assert ("tangent", "drift") in flown
    assert ("tangent", "polar") not in flown
    assert len(flown) == 5


def test_progress_ends_at_the_whole():
    told = []
    compare.compare(["P_calm"], ["hashemi2013"], ["raw"], 25, 1, lambda *what: told.append(what))
    assert told[-1][1:] == (25, 25)
    assert told[-1][0] == "P_calm hashemi2013 raw"
