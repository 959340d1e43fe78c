"""The command line: what it refuses before anything moves, and its exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import circumnav_mav
from circumnav_mav import cli
from circumnav_mav.report import summarise
from circumnav_mav.runtime.app import Result
from circumnav_mav.runtime.session import Outcome

ROOT = Path(__file__).parents[2]


def run(*arguments: str):
    return CliRunner().invoke(cli.app, list(arguments))


def written(tmp_path, text: str) -> str:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return str(path)


@pytest.fixture
def flown(monkeypatch):
    """Every flight ends at once, as `flown.append` says; without it none may start."""
    results: list[Result] = []

    def fly(config, *_, **__) -> Outcome:
        result = results.pop()
        return Outcome(result, summarise(config, result, {}, None), None, None, [])

    monkeypatch.setattr(cli, "fly", fly)
    return results


def test_check_says_by_its_exit_code_that_the_orbit_will_not_be_held(tmp_path):
    done = run("check", written(tmp_path, "law: {kappa: 20}"))
    assert done.exit_code == 1
    assert "This will not hold the orbit" in done.stdout


PLANE = "vehicle: {class: px4_fixed_wing}\norbit: {radius_m: 100, speed_m_s: 12}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLANE + "law: {name: hashemi2013, kappa: 1}\nestimator: {name: direct}", "by about 40 m"),
        (PLANE + "law: {name: sliding_mode}", "9.6 to 14.4 m/s over the ground"),
        ("law: {kappa: 1}", "if the autopilot can hold the speed over the ground: against the wind that is 7.4 m/s"),
    ],
)
def test_check_says_what_the_wind_that_is_expected_does(tmp_path, text, words):
    """2 r_a W / V straight downwind at kappa 1: 40 m."""
    assert " wind of " not in run("check", written(tmp_path, text)).stdout
    done = run("check", written(tmp_path, text + "\nstudy: {wind_m_s: 2.4}"))
    (line,) = [line for line in done.stdout.splitlines() if " wind of " in line]
    assert words in line


def test_a_wind_as_fast_as_the_aircraft_is_a_fault_of_the_file(tmp_path):
    done = run("check", written(tmp_path, PLANE + "study: {wind_m_s: 12}"))
    assert isinstance(done.exception, cli.ConfigError) and "study.wind_m_s" in str(done.exception)


def test_the_lag_that_the_file_gives_is_the_one_that_is_checked(tmp_path):
    assert "a total lag of 2.01 s" in run("check", written(tmp_path, "study: {turn_lag_s: 2.0}")).stdout


@pytest.mark.parametrize(("law", "told"), [("hashemi2013", True), ("hashemi2013_outer", False), ("pd_bias", False)])
def test_the_bound_is_promised_for_the_law_that_it_was_proven_for(tmp_path, law, told):
    done = run("check", written(tmp_path, f"law: {{name: {law}, kappa: 3}}"))
    assert done.exit_code == 0
    assert ("by the paper's bound" in done.stdout) is told
    assert ("r_s = " in done.stdout) is (law != "pd_bias")


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.name)
def test_check_passes_every_shipped_configuration_without_a_warning(path):
    done = run("check", str(path))
    assert "does nothing" not in done.stdout
    errors = [line for line in done.stdout.splitlines() if line.startswith("ERROR")]
    # What tune starts from loses flights in its wind: docs/tuning.md counts them.
    assert len(errors) == done.exit_code == (path.name == "scenario_r.yaml")
    assert all("law hashemi2013 loses flights in wind" in line for line in errors)
    if path.name != "scenario_r.yaml":
        assert not [line for line in done.stdout.splitlines() if line.startswith("warning")]


LINES = "source: lines, endpoint: /dev/ttyUSB0, pattern: "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ranging: {beacon_id: 3}", "ranging.beacon_id does nothing: distance_sensor"),
        (
            "ranging: {source: us_d1, endpoint: /dev/ttyUSB0, stamped_by: autopilot}",
            "ranging.stamped_by does nothing: us_d1",
        ),
        ("ranging: {source: ranging_beacon, sensor_id: 3}", "ranging.sensor_id does nothing: ranging_beacon"),
        ("ranging: {source: landing_target, orientation: 0}", "ranging.orientation does nothing: landing_target"),
        ("ranging: {source: landing_target, min_quality_pct: 9}", "ranging.min_quality_pct does nothing: landing_tar"),
        ("ranging: {source: rangefinder, use_stamps: false}", "ranging.use_stamps does nothing: rangefinder"),
        ("ranging: {source: rangefinder, stamped_by: autopilot}", "ranging.stamped_by does nothing: rangefinder"),
        ("ranging: {use_stamps: false, stamped_by: autopilot}", "ranging.stamped_by does nothing: use_stamps is false"),
        (f"ranging: {{{LINES}'(?P<range>.)', from: [1, 158]}}", "ranging.from does nothing: lines is a device"),
        (f"ranging: {{{LINES}'(?P<range>.)', min_quality_pct: 5}}", "ranging.min_quality_pct does nothing: lines"),
        ("vehicle: {pitch_deg: -4}", "vehicle.pitch_deg does nothing: px4_multirotor"),
        ("vehicle: {thrust: 0.4}", "vehicle.thrust does nothing: px4_multirotor"),
        ("limits: {bank_deg: 20}", "limits.bank_deg does nothing: px4_multirotor"),
    ],
)
def test_check_warns_of_a_key_that_does_nothing(tmp_path, text, words):
    done = run("check", written(tmp_path, text))
    assert done.exit_code == 0
    (line,) = [line for line in done.stdout.splitlines() if "does nothing" in line]
    assert line.startswith("warning") and words in line
    assert "with 1 thing to know" in done.stdout


@pytest.mark.parametrize(
    "text",
    [
        "ranging: {source: ranging_beacon, beacon_id: 3}",
        "ranging: {sensor_id: 7, orientation: 0, from: [1, 158], min_quality_pct: 5, stamped_by: autopilot}",
        f"ranging: {{{LINES}'(?P<range>.)(?P<beacon_id>.)(?P<quality>.)', beacon_id: 3, min_quality_pct: 5}}",
        "vehicle: {class: px4_multirotor_attitude, pitch_deg: -4, thrust: 0.4}\nlimits: {bank_deg: 20}",
    ],
)
def test_keys_that_are_used_are_not_complained_of(tmp_path, text):
    done = run("check", written(tmp_path, text))
    assert "This" in done.stdout and "does nothing" not in done.stdout


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ranging: {source: ranging_beacon, beacon_id: 65536}", "ranging_beacon carries ids up to 65535 only"),
        ("ranging: {source: linktrack, endpoint: /dev/ttyUSB0, beacon_id: 0x1151}", "linktrack carries ids up to 255"),
        (f"ranging: {{{LINES}'(?P<range>.)', beacon_id: 3}}", "ranging.pattern names no beacon_id"),
        ("ranging: {source: lines, endpoint: /dev/ttyUSB0, json: {range: r}, beacon_id: 3}", "ranging.json names no"),
        ("vehicle: {system_id: 7}\nranging: {from: [7, 191]}", "is this app itself"),
    ],
)
def test_what_no_range_can_ever_match_is_a_fault_of_the_file(tmp_path, text, words):
    done = run("check", written(tmp_path, text))
    assert isinstance(done.exception, cli.ConfigError)
    (line,) = str(done.exception).splitlines()
    assert words in line


@pytest.mark.parametrize("duration", ["-5", "0"])
def test_a_flight_lasts_longer_than_nothing(tmp_path, flown, duration):
    done = run("fly", written(tmp_path, ""), "--duration", duration)
    assert done.exit_code == 2
    assert "--duration" in done.output


@pytest.mark.parametrize("command", ["fly", "demo"])
def test_a_place_that_takes_no_figures_is_found_before_take_off(tmp_path, flown, command, monkeypatch):
    monkeypatch.setattr(cli, "run_demo", lambda *_, **__: pytest.fail("it took off"))
    (tmp_path / "file").write_text("")
    config = [written(tmp_path, "")] if command == "fly" else []
    for bad, words in (
        (tmp_path, "Is a directory"),
        (tmp_path / "file" / "f.json", f"{tmp_path}/file is no folder"),
        (tmp_path / "fligths" / "f.json", f"{tmp_path}/fligths does not exist: make that folder, or mend the name"),
    ):
        done = run(command, *config, "--json", str(bad))
        assert done.exit_code == 2
        assert done.stderr == f"circumnav: cannot write {bad}: {words}\n"
    assert not (tmp_path / "fligths").exists()


def test_the_trial_leaves_no_trace(tmp_path):
    new, old, folder = tmp_path / "new.json", tmp_path / "old.json", tmp_path / "figures"
    old.write_text("kept")
    cli.before_the_work([new, old, Path("/dev/stdout"), None], folder)
    assert list(tmp_path.iterdir()) == [old] and old.read_text() == "kept"


@pytest.mark.parametrize(("outcome", "code"), [("range_lost", 1), ("completed", 2)])
def test_figures_that_cannot_be_written_do_not_hide_how_it_ended(tmp_path, flown, outcome, code):
    flown.append(Result(outcome, "so it went", "finished", 1.0, 2.0))
    done = run("fly", written(tmp_path, ""), "--json", "/dev/full")
    assert done.exit_code == code
    complaints = [line for line in done.stderr.splitlines() if line.startswith("circumnav: ")]
    assert complaints[0] == "circumnav: cannot write /dev/full: No space left on device"
    assert ("circumnav: range_lost: so it went" in complaints) is (outcome == "range_lost")


def test_the_readme_has_every_exit_code_and_outcome():
    readme = (ROOT / "README.md").read_text()
    codes = readme[readme.index("Exit codes:") :].split("\n\n")[0]
    assert all(f"{code} " in codes for code in (0, cli.EXIT_FLIGHT, cli.EXIT_USAGE, cli.EXIT_LINK, cli.EXIT_WARNINGS))
    assert f"{cli.EXIT_CRASH} " in codes
    for outcome in " ".join((Result.__doc__ or "").split()).rsplit("outcome: ")[-1].rstrip(".").split(", "):
        assert f"`{outcome}`" in readme, outcome


@pytest.mark.parametrize("module", ["circumnav_mav", "circumnav_mav.cli"])
def test_it_runs_as_a_module_too(module):
    done = subprocess.run([sys.executable, "-m", module, "--version"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"circumnav_mav {circumnav_mav.__version__}\n"), done.stderr


@pytest.mark.parametrize(("estimator", "warned"), [("direct", True), ("drift", False)])
def test_check_warns_of_a_band_that_the_wind_breaks(tmp_path, estimator, warned):
    law = "tangent" if estimator == "drift" else "hashemi2013"
    text = f"""
vehicle: {{class: px4_fixed_wing}}
orbit: {{radius_m: 100, speed_m_s: 12, r_min_m: 60}}
law: {{name: {law}}}
estimator: {{name: {estimator}}}
limits: {{turn_accel_rad_s2: 0.5}}
"""
    done = run("check", written(tmp_path, text))
    assert ("hold in wind below a tenth" in done.stdout) == warned


def test_a_calibration_without_a_range_says_so_in_one_line_and_writes_nothing(tmp_path):
    file = written(tmp_path, text := "vehicle: {link: 'udpin://127.0.0.1:0'}\nranging: {bias_m: 0.1}\n")
    done = run("ranging", file, "--calibrate", "10", "--duration", "0.1")
    assert done.exit_code == 1
    assert f"no range could be used: nothing is written to {file}" in done.output
    assert "nan" not in done.output and "calibrated" not in done.output
    assert Path(file).read_text() == text


def test_what_a_sensor_says_is_not_listened_to_where_it_cannot_be_kept(tmp_path, monkeypatch):
    """The ranges, or the bias, were lost at the end of the listening."""
    monkeypatch.setattr(
        "circumnav_mav.runtime.ranging_session.run_ranging", lambda *_, **__: pytest.fail("it listened")
    )
    file = written(tmp_path, "vehicle: {link: 'udpin://127.0.0.1:0'}")
    done = run("ranging", file, "--record", str(tmp_path / "none" / "r.csv"))
    assert done.exit_code == 2 and "none/r.csv: " in done.stderr and "none does not exist" in done.stderr
    reading, writing = os.pipe()
    os.write(writing, b"ranging: {bias_m: 0.1}")
    os.close(writing)
    done = run("ranging", f"/dev/fd/{reading}", "--calibrate", "10")  # <(something)
    os.close(reading)
    assert done.exit_code == 2 and done.stderr.startswith("circumnav: cannot write into /proc/")


def test_a_bias_that_cannot_be_written_is_found_before_the_listening(tmp_path, monkeypatch):
    monkeypatch.setattr("circumnav_mav.runtime.ranging_session.RangingApp", lambda *_: pytest.fail("it listened"))
    file = written(tmp_path, "ranging: {sigma_m: &s 1, bias_m: *s}")
    done = run("ranging", file, "--calibrate", "10")
    assert done.exit_code == 1
    assert done.stderr.startswith(f"circumnav: cannot write ranging.bias_m to {file}: edited, it would not be YAML (")
    assert done.stderr.endswith(": set ranging.bias_m by hand\n")


def test_check_shows_what_the_estimator_needs(tmp_path):
    done = run("check", written(tmp_path, PLANE))
    assert "estimator  drift: needs heading, range, speed, turn rate; px4_fixed_wing has them" in done.output
