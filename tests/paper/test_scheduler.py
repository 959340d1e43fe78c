"""The study on a Dask cluster of two processes on this machine: the same numbers as its own threads."""

import numpy as np
import pytest

from circumnav_mav.study import paper, scheduler

OPTIONS = paper.Options(runs=140, seed=5, gains_rad_m=(0.4, 1.0))


def test_without_an_address_nothing_is_connected_to():
    with scheduler.executor(None) as own:
        assert own is None


def test_two_processes_fly_the_same_runs():
    distributed = pytest.importorskip("distributed", reason="needs the extra circumnav-mav[cluster]")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        scheduler.executor(cluster.scheduler_address) as pool,
    ):
        seen = []
        there = paper.run(OPTIONS, progress=lambda done, total: seen.append((done, total)), executor=pool)
    assert np.array_equal(there.rows, paper.run(OPTIONS).rows)
    assert seen[-1] == (4, 4)


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra circumnav-mav[cluster]")
    monkeypatch.setattr(scheduler, "CONNECT_S", 0.5)
    with pytest.raises(ValueError, match="no scheduler answers"), scheduler.executor("tcp://127.0.0.1:9"):
        pass


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ValueError, match="cluster"), scheduler.executor("tcp://127.0.0.1:8786"):
        pass
