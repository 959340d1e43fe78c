"""The offline commands as a user types them: files, refusals before the work, and what is kept and shown again."""

import json

import pytest
from typer.testing import CliRunner

from circumnav_mav.cli import app
from circumnav_mav.study import compare, paper, tune

CONFIG = "ranging: {sigma_m: 1.0}\norbit: {radius_m: 20}\nstudy: {wind_m_s: 1}\n"
SHORT = ("--runs", "3", "--gains", "0.4,1")


def run(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "plane.yaml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(
    ("command", "option", "module", "work"),
    [
        ("study", "--json", paper, "run"),
        ("study", "--save", paper, "run"),
        ("study", "--figures", paper, "run"),
        ("compare", "--json", compare, "compare"),
        ("tune", "--out", tune, "tune"),
        ("tune", "--plot", tune, "tune"),
        ("tune", "--json", tune, "tune"),
    ],
)
def test_a_place_that_takes_nothing_is_found_before_the_work(
    tmp_path, config, monkeypatch, command, option, module, work
):
    monkeypatch.setattr(module, work, lambda *_, **__: pytest.fail("it went to work"))
    (tmp_path / "file").write_text("kept")
    bad = tmp_path / "file" / "deep"
    done = run(command, *([config] if command == "tune" else []), option, bad)
    assert done.exit_code == 2
    assert done.stderr.startswith("circumnav: cannot write ") and str(bad) in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert (tmp_path / "file").read_text() == "kept"
    bad = tmp_path / "typo" / "deep" / "file.svg"
    done = run(command, *([config] if command == "tune" else []), option, bad)
    assert done.exit_code == 2
    assert f"{bad.parent} does not exist: make that folder, or mend the name" in done.stderr
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "typo").exists()


def test_a_study_that_was_kept_is_shown_again_and_flies_nothing(tmp_path, monkeypatch):
    first = run("study", *SHORT, "--save", tmp_path / "runs.npz", "--json", tmp_path / "a.json")
    assert first.exit_code == 0
    monkeypatch.setattr(paper, "run", lambda *_, **__: pytest.fail("it flew"))
    again = run("study", "--load", tmp_path / "runs.npz", "--json", tmp_path / "b.json")
    assert again.exit_code == 0
    assert again.stdout.strip() == first.stdout[: first.stdout.index("kept")].strip()
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


@pytest.mark.parametrize("content", [b"", b"no archive", None])
def test_what_is_no_kept_study_is_refused_in_words(tmp_path, content):
    file = tmp_path / "runs.npz"
    if content is None:
        import numpy as np

        np.savez(file, rows=np.zeros(3))
    else:
        file.write_bytes(content)
    done = run("study", "--load", file)
    assert done.exit_code == 2
    assert f"{file} is not a file that `circumnav study --save` wrote" in done.stderr
    assert run("study", "--load", tmp_path / "none").exit_code == 2


@pytest.mark.parametrize(
    "option",
    [
        ("--gains", "1"),
        ("--window", "0.5"),
        ("--runs", "2"),
        ("--law", "pd_bias"),
        ("--estimator", "raw"),
        ("--seed", "1"),
        ("--start", "1,1"),
        ("--workers", "1"),
        ("--scheduler", "tcp://127.0.0.1:9"),
    ],
)
def test_options_of_a_flight_are_refused_beside_kept_runs(tmp_path, option):
    """Also where the value is the default's: what was kept may have another."""
    done = run("study", "--load", tmp_path / "runs.npz", *option, "--json", tmp_path / "a.json")
    assert done.exit_code == 2
    assert f"leave out {option[0]}, or leave out --load" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(("law", "estimator"), [("pd_bias", None), ("hashemi2013", "direct")])
def test_another_law_and_an_estimator_are_swept_alike(tmp_path, law, estimator):
    on = ("--estimator", estimator) if estimator else ()
    done = run("study", *SHORT, "--law", law, *on, "--json", tmp_path / "a.json")
    assert done.exit_code == 0, done.stderr
    told = json.loads((tmp_path / "a.json").read_text())
    assert (told["options"]["law"], told["options"]["estimator"]) == (law, estimator)
    assert told["calm"]["k"] == [0.4, 1.0]
    assert all(value < 1.0 for value in told["calm"]["mse_tail"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--law", "tangent"], "there are: hashemi2013"),
        (["--estimator", "q"], "there are: raw"),
        (["--gains", "1,x"], "--gains wants numbers"),
        (["--gains", "0.05"], "kappa"),
        (["--gains", "1,1e300"], "gains k up to 1e+06 rad/m are flown, not 1e+300"),
        (["--start", "1"], "--start wants two numbers"),
        (["--start", "0,0"], "start somewhere else"),
        (["--start", "1e200,0"], "start within 1e+06 m of the target"),
        (["--law", "pd_bias"], "kappa must be above 1"),
    ],
)
def test_what_cannot_be_studied_is_refused_in_words(arguments, words):
    done = run("study", "--runs", "2", *arguments)
    assert done.exit_code == 2
    assert words in done.stderr and len(done.stderr.splitlines()) == 1


def test_tune_writes_what_it_says(tmp_path, config, monkeypatch):
    pytest.importorskip("optuna", reason="needs the extra circumnav-mav[study]")
    whole = tune.tune
    monkeypatch.setattr(tune, "tune", lambda *a, **o: whole(*a, **o, runs=2, fresh_runs=3))
    few = ("--evaluations", 4, "--keep-pair")
    done = run("tune", config, *few, "--out", tmp_path / "new.yaml", "--json", tmp_path / "new.json")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "new.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "new.json").read_text())["aircraft"]["wind_m_s"] == 1.0
    assert run("check", tmp_path / "new.yaml").exit_code == 0
    for word in ("rms worst m", "before", "after", "written", "picture"):
        assert word in done.stdout
    none = run("tune", config, *few, "--out", tmp_path / "no.yaml", "--no-plot", "--wind", "0.5")
    assert none.exit_code == 0
    assert "up to 0.5 m/s" in (tmp_path / "no.yaml").read_text()
    assert not (tmp_path / "no.png").exists()


def test_a_file_that_no_gains_can_be_written_into_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "tune", lambda *_, **__: pytest.fail("it went to work"))
    file = tmp_path / "plane.yaml"
    file.write_text("{law: &a {name: hashemi2013}, orbit: {radius_m: 20}, estimator: {name: direct, <<: *a}}")
    done = run("tune", file, "--out", tmp_path / "new.yaml", "--wind", 1)
    assert done.exit_code == 2
    assert "too intricate" in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "new.yaml").exists()
