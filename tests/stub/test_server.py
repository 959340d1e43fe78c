"""The stub over sockets: its clock, its files, its complaints. Few, and only what lockstep cannot reach."""

from __future__ import annotations

import csv
import hashlib
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import StubConfig
from sitl_stub.devices import PansConsole
from sitl_stub.options import DESCRIPTION, parser
from sitl_stub.running import free_port
from sitl_stub.server import Endpoint, PortBusy, Pty, Server
from sitl_stub.stub import Stub

pytest_plugins = ["sitl_stub.pytest"]
DOCUMENT = Path(__file__).parents[2] / "docs" / "stub.md"


def stub_command(*arguments: str, port: int | None = None) -> list[str]:
    ports = ["--offboard-port", str(port or free_port()), "--offboard-listen", "0"]
    return [sys.executable, "-m", "sitl_stub", *ports, "--gcs-port", str(free_port()), "--gcs-listen", "0", *arguments]


@pytest.mark.realtime
@pytest.mark.soak
def test_truth_file_and_duration(tmp_path: Path) -> None:
    """At 20 times the speed: 20 flight seconds in a good second, 20 rows a flight second, then a clean end."""
    path = tmp_path / "truth.csv"
    command = stub_command("--airborne", "20", "--speed", "20", "--duration", "20", "--truth", str(path))
    began_s = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    taken_s = time.monotonic() - began_s
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("sitl_stub ")
    assert " ready: multirotor" in done.stdout
    assert taken_s >= 1.0
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == pytest.approx(400, abs=2)
    assert float(rows[-1]["t_s"]) == pytest.approx(20.0, abs=0.06)
    assert {row["mode"] for row in rows} == {"AUTO/LOITER"}
    assert float(rows[-1]["height_m"]) == pytest.approx(20.0, abs=1.0)


@pytest.mark.realtime
@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.soak), signal.SIGTERM])
def test_it_is_ready_soon_and_ends_cleanly_on_a_signal(number: int) -> None:
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion:
        companion.bind(("127.0.0.1", port))
        companion.settimeout(10.0)
        with subprocess.Popen(stub_command(port=port), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert companion.recv(2048)[0] == 0xFD  # it sends from boot on, nothing has to be sent first
            os.kill(process.pid, number)
            out, err = process.communicate(timeout=10.0)
    assert process.returncode == 0
    assert err == b""
    assert out.count(b"\n") == 1


def test_a_busy_port_is_one_clear_line() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        command = [*stub_command("--duration", "1"), "--offboard-listen", str(port)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        with pytest.raises(PortBusy, match=str(port)):
            Server(Stub(), {"offboard": Endpoint(port, 0)})
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert str(port) in done.stderr
    assert "--offboard-listen" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--param", "NO_SUCH=1"], "no parameter 'NO_SUCH'"),
        (["--fault", "40 range-stop"], "needs FROM-TO"),
        (["--beacon", "1,x"], "numbers"),
        (["--speed", "0"], "positive"),
        (["--sign", ""], "--sign needs a passphrase that is not empty"),
        (["--sign", "secret", "--mavlink", "1"], "only MAVLink 2 can be signed"),
        (["--truth", "/no/such/place/truth.csv"], "/no/such/place/truth.csv"),
        (["--faults", "/no/such/file"], "/no/such/file"),
    ],
)
def test_wrong_arguments_are_one_clear_line(arguments: list[str], words: str) -> None:
    done = subprocess.run(stub_command(*arguments), capture_output=True, text=True, check=False)
    assert done.returncode in (2, 3)
    assert words in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("duration_s", [0.2, 3.0])  # the disk is full at the end, or on the way
def test_a_full_disk_under_the_truth_is_one_clear_line(duration_s: float) -> None:
    command = stub_command("--truth", "/dev/full", "--duration", str(duration_s), "--speed", "50")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1, done.stderr
    assert "cannot write /dev/full: No space left on device" in done.stderr


@pytest.mark.realtime
@pytest.mark.soak
def test_the_fixture_gives_a_vehicle_that_flies(sitl: Any) -> None:
    """A companion in ten lines, at ten times the speed: stream, ask for OFFBOARD, and move north in it."""
    vehicle = sitl(start_height_m=30.0, speed=10.0, radio=False)
    mav = mavlink.MAVLink(None, 1, 191)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion:
        companion.bind(("127.0.0.1", vehicle.port))
        companion.settimeout(5.0)
        _, peer = companion.recvfrom(2048)
        setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 1479, *[0] * 3, 3, *[0] * 7)
        request = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0)
        for k in range(1000):
            companion.sendto(setpoint.pack(mav), peer)
            if k == 1:
                companion.sendto(request.pack(mav), peer)
            time.sleep(0.01)
            truth = vehicle.truth()
            if truth.mode == "OFFBOARD" and truth.north_m > 5.0:
                break
    assert truth.mode == "OFFBOARD" and truth.north_m > 5.0


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("program", [True, False], ids=["program", "fixture"])
def test_a_signing_peer_on_the_real_clock_and_the_vehicle_take_each_other(sitl: Any, program: bool) -> None:
    """pymavlink's own signing, with the time of day as its stamp, as mavutil's setup_signing has it."""
    mav = mavlink.MAVLink(None, 1, 191)
    key = mav.signing.secret_key = hashlib.sha256(b"a secret").digest()
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = int((time.time() - 1_420_070_400) * 100_000)
    mav.robust_parsing = True
    ack, began_s = None, time.time()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion:
        companion.bind(("127.0.0.1", 0 if program else sitl(start_height_m=30.0, signing_key=key).port))
        command = stub_command("--airborne", "30", "--sign", "a secret", port=companion.getsockname()[1])
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) if program else nullcontext() as process:
            companion.settimeout(10.0)
            _, peer = companion.recvfrom(2048)
            companion.sendto(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, *[0] * 6).pack(mav), peer)
            clock, refused = None, 0
            while ack is None or clock is None:
                for message in mav.parse_buffer(companion.recv(2048)) or []:
                    refused += message.get_type() == "BAD_DATA"
                    ack = message if message.get_type() == "COMMAND_ACK" else ack
                    clock = message if message.get_type() == "SYSTEM_TIME" else clock
            ended_s = time.time()
            if process is not None:
                process.terminate()
    assert (ack.command, ack.result, refused) == (400, 0, 0)
    assert began_s - 1.0 < clock.time_unix_usec * 1e-6 < ended_s + 1.0


def example(directory: Path) -> Path:
    """Write the files of docs/stub.md's worked example: indented blocks that begin with their name."""
    name, lines = "", []
    for line in [*DOCUMENT.read_text(encoding="utf-8").splitlines(), "## end"]:
        if line.startswith("    # ") and line.endswith(".py"):
            name, lines = line.removeprefix("    # "), []
        if name and line and not line.startswith("    "):
            name = ""
        if name:
            lines.append(line.removeprefix("    "))
            (directory / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return directory


def run_example(directory: Path, test: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    environment = {**os.environ, "PYTHONPATH": str(DOCUMENT.parents[1])}
    return subprocess.run(command, cwd=directory, env=environment, capture_output=True, text=True, check=False)


def test_the_lockstep_example_of_the_document_runs_as_it_is_written(tmp_path: Path) -> None:
    done = run_example(example(tmp_path), "test_in_lockstep.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


@pytest.mark.realtime
@pytest.mark.soak
def test_the_example_over_sockets_runs_as_it_is_written(tmp_path: Path) -> None:
    done = run_example(example(tmp_path), "test_my_app.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def test_the_examples_of_the_help_are_right() -> None:
    lines = [line.strip() for line in DESCRIPTION.splitlines() if line.startswith("  python -m sitl_stub")]
    assert len(lines) >= 4
    for line in lines:
        parser().parse_args(shlex.split(line.split("   ")[0])[3:])


def test_the_lockstep_fixture(sitl_lockstep: Any) -> None:
    stub = sitl_lockstep(start_height_m=30.0)
    stub.advance(1.0)
    assert stub.take("offboard")
    assert stub.truth().t_s == pytest.approx(1.0)


class Wall:
    """The wall clock of a server, which only its own naps move, and each look by a little."""

    def __init__(self, server: Server) -> None:
        self.s = 0.0
        server._selector.close()
        server._selector = self  # type: ignore[assignment]

    def monotonic(self) -> float:
        return self.s

    def select(self, nap_s: float) -> list[Any]:
        self.s += max(nap_s, 1e-4)
        return []

    def close(self) -> None:
        pass


def test_the_clock_follows_the_factor_and_never_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flight time / wall time is the factor, and nothing runs faster than twice the pace after a stall."""
    vehicle = Server(Stub(StubConfig(start_height_m=10.0)), {}, speed=8.0)
    wall = Wall(vehicle)
    monkeypatch.setattr("sitl_stub.server.time", wall)
    stalled_s: list[float] = []

    def until(wall_s: float) -> float:
        vehicle.run(stop=lambda: wall.s >= wall_s)
        return vehicle.stub.now_s

    def stall() -> bool:
        if wall.s >= 3.0 and not stalled_s:
            stalled_s.append(vehicle.stub.now_s)
            wall.s += 1.0  # 8 s of flight
        return wall.s >= 4.25

    assert until(2.0) == pytest.approx(16.0, abs=0.05)
    vehicle.run(stop=stall)
    flown_s = vehicle.stub.now_s - stalled_s[0]
    assert 1.9 * 8.0 * 0.25 < flown_s <= 2.0 * 8.0 * (0.25 + 0.03)  # one slice of 0.02 s may come at once
    vehicle.close()


def test_a_devices_bytes_come_out_of_a_pseudo_terminal() -> None:
    pty = Pty()
    stub = Stub(StubConfig(device="lightware", beacon_east_m=42.0, range_sigma_m=0.0, start_height_m=10.0))
    serial = os.open(pty.name, os.O_RDONLY | os.O_NOCTTY)
    server = Server(stub, {}, speed=50.0, pty=pty)
    try:
        server.run(duration_s=1.0)
        data = b""
        while (
            data.count(b"\n") < 10 and select.select([serial], [], [], 10.0)[0]
        ):  # the kernel hands it on when it likes
            data += os.read(serial, 4096)
    finally:
        os.close(serial)
        server.close()
    lines = data.split(b"\r\n")
    assert len(lines) > 10
    assert set(lines[:-1]) == {b"43.17"}  # the slant range: 42 m away, 10 m up


def test_a_dwm1001_on_a_pseudo_terminal_is_silent_until_its_shell_is_told_les() -> None:
    pty = Pty()
    stub = Stub(StubConfig(device="dwm1001_les", range_beacon_id=0x1234, beacon_east_m=42.0, range_sigma_m=0.0))
    serial = os.open(pty.name, os.O_RDWR | os.O_NOCTTY)
    server = Server(stub, {}, speed=50.0, pty=pty)

    def said_after(typed: bytes) -> bytes:
        os.write(serial, typed)
        server.run(duration_s=2.0)
        data = b""
        while select.select([serial], [], [], 0.3)[0]:
            data += os.read(serial, 4096)
        return data

    try:
        assert said_after(b"") == b""
        assert said_after(b"les\r") == PansConsole.ERROR * 4  # binary mode
        assert said_after(b"\r\r").endswith(PansConsole.PROMPT)
        assert said_after(b"les\r").count(b"1234[0.00,0.00,0.00]=42.00 ") >= 10
        assert said_after(b"").count(b"1234[") >= 10
        assert said_after(b"les\r").count(b"1234[") <= 2  # off again
        assert said_after(b"") == b""
    finally:
        os.close(serial)
        server.close()


def test_a_devices_bytes_come_from_a_udp_port(sitl: Any) -> None:
    vehicle = sitl(device="dwm1001_les", range_beacon_id=0x1234, beacon_east_m=42.0, range_sigma_m=0.0, speed=5.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as app:
        app.bind(("127.0.0.1", vehicle.ranging_port))
        app.settimeout(5.0)
        assert app.recv(2048).startswith(b"1234[0.00,0.00,0.00]=42.00")
