"""The study on a Dask cluster of two processes on this machine: the same numbers as its own threads."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from circumnav_mav.cli import app
from circumnav_mav.study import paper, scheduler, tune

OPTIONS = paper.Options(runs=140, seed=5, gains_rad_m=(0.4, 1.0))


def test_without_an_address_nothing_is_connected_to():
    with scheduler.executor(None) as own:
        assert own is None


@pytest.mark.parametrize(
    "address", ["garbage", "", "tcp://", "tcp://host", "host:8786", "tcp://host:0", "tcp://host:65536", "tcp://a b:1"]
)
def test_what_is_no_address_is_refused_before_a_client_is_made(address, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs the extra circumnav-mav[cluster]")
    monkeypatch.setattr(distributed, "Client", None)
    done = CliRunner().invoke(app, ["study", "--runs", "2", "--scheduler", address])
    assert done.exit_code == 2
    assert f"--scheduler wants an address such as tcp://10.0.0.1:8786, not '{address}'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "tcp://[::1]:8786", "tcp://node-3.example:65535"])
def test_addresses_of_both_kinds_are_taken(address):
    assert scheduler.ADDRESS.fullmatch(address)


@pytest.fixture(scope="module")
def address():
    distributed = pytest.importorskip("distributed", reason="needs the extra circumnav-mav[cluster]")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        yield cluster.scheduler_address


def test_two_processes_fly_the_same_runs(address):
    seen = []
    with scheduler.executor(address) as pool:
        there = paper.run(OPTIONS, progress=lambda done, total: seen.append((done, total)), executor=pool)
    assert np.array_equal(there.rows, paper.run(OPTIONS).rows)
    assert seen[-1] == (4, 4)


@pytest.mark.parametrize("command", ["study", "compare", "tune"])
def test_the_commands_give_the_same_figures_on_the_cluster(tmp_path, address, monkeypatch, command):
    if command == "tune":
        pytest.importorskip("optuna", reason="needs the extra circumnav-mav[study]")
    whole = tune.tune
    monkeypatch.setattr(tune, "tune", lambda *a, **o: whole(*a, **o, runs=5, fresh_runs=6))
    (tmp_path / "plane.yaml").write_text("ranging: {sigma_m: 1.0}\norbit: {radius_m: 20}\n")
    few = {
        "study": ["--runs", "40", "--gains", "0.4,1"],
        "compare": ["--scenario", "P_calm", "--law", "hashemi2013", "--estimator", "direct", "--runs", "25"],
        "tune": [
            str(tmp_path / "plane.yaml"),
            "--keep-pair",
            "--evaluations",
            "4",
            "--out",
            str(tmp_path / "new.yaml"),
        ],
    }[command]
    told = []
    for name, where in (("here", ["--workers", "1"]), ("there", ["--scheduler", address])):
        file = tmp_path / f"{name}.json"
        done = CliRunner().invoke(app, [command, *few, *where, "--json", str(file)])
        assert done.exit_code == 0, done.stderr
        told.append(json.loads(file.read_text()))
        if command == "study":  # what it took, and by how many, is no result
            for key in ("options", "elapsed_s", "steps_per_s"):
                del told[-1][key]
    assert told[0] == told[1]


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra circumnav-mav[cluster]")
    monkeypatch.setattr(scheduler, "CONNECT_S", 0.5)
    with pytest.raises(ValueError, match="no scheduler answers"), scheduler.executor("tcp://127.0.0.1:9"):
        pass


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ValueError, match="cluster"), scheduler.executor("tcp://127.0.0.1:8786"):
        pass
