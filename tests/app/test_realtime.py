"""The command as a process: what only real sockets, a real clock and a real terminal line can show."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.report import read_columns
from tests.app_process import start_app, wait_for_pace

ROOT = Path(__file__).parents[2]
CIRCUMNAV = [sys.executable, "-c", "from circumnav_mav.cli import main; main()"]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def process(*command: str, **more) -> Iterator[subprocess.Popen]:
    child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)
    with ended(child):
        yield child


@contextlib.contextmanager
def ended(child: subprocess.Popen) -> Iterator[subprocess.Popen]:
    try:
        yield child
    finally:
        if child.poll() is None:
            child.kill()
        child.communicate()


@contextlib.contextmanager
def stub(port: int, *arguments: str, truth: Path) -> Iterator[subprocess.Popen]:
    ports = ["--offboard-port", str(port), "--offboard-listen", "0", "--gcs-port", "0"]
    with process(sys.executable, "-m", "sitl_stub", *ports, "--truth", str(truth), *arguments) as child:
        yield child


def run(*arguments: str, timeout: float = 600) -> subprocess.CompletedProcess:
    return subprocess.run([*CIRCUMNAV, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=timeout)


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "c.yaml"
    path.write_text(text + f"\nrecord: {{directory: {tmp_path}/flights}}\n")
    return str(path)


@pytest.mark.realtime
def test_the_demo_settles_and_leaves_what_it_promises(tmp_path):
    """`make demo` as a user starts it; the bounds are the project's own figures."""
    config = written(tmp_path, "orbit: {radius_m: 50}")
    done = run("demo", "--config", config, "--json", str(tmp_path / "demo.json"), "--seed", "3")
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((tmp_path / "demo.json").read_text())
    assert figures["outcome"] == "completed" and figures["phase"] == "finished" and figures["error_from"] == "truth"
    assert figures["tail_rms_error_m"] < 0.6 and figures["tail_max_error_m"] < 1.5
    (flight,) = (tmp_path / "flights").iterdir()
    assert {p.name for p in flight.iterdir()} == {"events.log", "flight.png", "flight.tlog", "ticks.csv", "truth.csv"}
    assert (flight / "flight.png").stat().st_size > 20_000
    assert "settled" in done.stdout and "Traceback" not in done.stderr


@pytest.mark.realtime
@pytest.mark.soak
def test_a_machine_that_holds_the_demo_up_makes_it_slower_and_no_worse(tmp_path):
    """The vehicle's process loses 0.4 s again and again, which at five times real time are 2 s of flight."""
    config = written(tmp_path, "orbit: {radius_m: 50}")
    json_file, draw = str(tmp_path / "demo.json"), random.Random(5)
    with process(*CIRCUMNAV, "demo", "--config", config, "--json", json_file, "--seed", "5") as demo:
        while demo.poll() is None:
            time.sleep(draw.uniform(0.2, 2.0))
            children = Path(f"/proc/{demo.pid}/task/{demo.pid}/children")
            with contextlib.suppress(OSError):  # before its start and after its end there is none
                for child in children.read_text().split():
                    os.kill(int(child), signal.SIGSTOP)
                    time.sleep(0.4)
                    os.kill(int(child), signal.SIGCONT)
        said, complaints = demo.communicate()
    figures = json.loads((tmp_path / "demo.json").read_text())
    assert demo.returncode == 0 and figures["outcome"] == "completed", said + complaints
    assert figures["tail_rms_error_m"] < 0.6 and figures["tail_max_error_m"] < 1.5
    assert "does not keep up with 5 x real time" in said + complaints


def test_a_busy_port_is_one_line(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = run("fly", written(tmp_path, f"vehicle: {{link: 'udpin://127.0.0.1:{port}'}}"))
    assert done.returncode == 3
    assert f"udpin://127.0.0.1:{port}: the port is in use" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_no_autopilot_is_one_line(tmp_path):
    done = run("fly", written(tmp_path, f"vehicle: {{link: 'udpin://127.0.0.1:{free_port()}'}}"), "--wait", "1")
    assert done.returncode == 1
    assert "no_autopilot" in done.stderr and "check vehicle.link" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.realtime
@pytest.mark.soak
def test_no_range_is_one_line_and_says_that_the_decoy_was_heard(tmp_path):
    port = free_port()
    with stub(port, "--no-radio", "--airborne", "15", truth=tmp_path / "truth.csv") as vehicle:
        wait_for(vehicle, "ready")
        done = run("fly", written(tmp_path, f"vehicle: {{link: 'udpin://127.0.0.1:{port}'}}"), "--wait", "5")
    assert done.returncode == 1
    assert "no_range" in done.stderr


def test_a_wrong_configuration_is_a_line_a_fault_and_nothing_moves(tmp_path):
    done = run("fly", written(tmp_path, "orbit: {radius: 50, speed_m_s: -1}"))
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 2
    assert "did you mean 'radius_m'" in done.stderr
    assert not (tmp_path / "flights").exists()


@pytest.mark.realtime
def test_ctrl_c_hands_over_to_hold_and_a_pilot_engages(tmp_path):
    """fly with engage: pilot. A ground station selects Offboard; Ctrl-C ends it in Hold with the logs closed."""
    port, gcs = free_port(), free_port()
    config = written(tmp_path, f"vehicle: {{link: 'udpin://127.0.0.1:{port}'}}")
    truth, pace, pipe = tmp_path / "truth.csv", tmp_path / "pace", subprocess.PIPE
    arguments = ("fly", config, "--json", str(tmp_path / "f.json"))
    with ended(start_app(*arguments, pace_file=pace, cwd=ROOT, stdout=pipe, stderr=pipe, text=True)) as app:
        wait_for_pace(pace, app)
        with stub(port, "--airborne", "15", "--gcs-listen", str(gcs), "--pace", str(pace), truth=truth) as vehicle:
            wait_for(app, "select Offboard")
            command = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 6, 0, 0, 0, 0, 0)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
                station.sendto(command.pack(mavlink.MAVLink(None, 255, 190)), ("127.0.0.1", gcs))
            wait_for(app, "acquiring")
            time.sleep(0.5)
            app.send_signal(signal.SIGINT)
            out, err = app.communicate(timeout=30)
            vehicle.terminate()
            vehicle.communicate(timeout=10)
    assert app.returncode == 0, out + err
    assert json.loads((tmp_path / "f.json").read_text())["outcome"] == "completed"
    modes = read_columns(truth)["mode"]
    assert modes[0] == modes[-1] == "AUTO/LOITER" and "OFFBOARD" in modes


def wait_for(child: subprocess.Popen, word: str) -> None:
    """Read the output of a process up to a line with `word`; the test's own time limit ends a vain wait."""
    assert child.stdout is not None
    for line in child.stdout:
        if word in line:
            return
    pytest.fail(f"the process ended before it said '{word}'")
