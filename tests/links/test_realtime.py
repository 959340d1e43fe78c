"""What only the wall clock reaches: the commands as processes, over a pseudo-terminal and TCP, unplugged in flight."""

from __future__ import annotations

import os
import random
import select
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from circumnav_mav.mavlink.codec import Splitter
from sitl_stub import Stub, StubConfig
from sitl_stub.devices import DEVICES
from sitl_stub.pace import Pace
from tests.app_process import start_app, wait_for_pace
from tests.links.fake_loop import Cable
from tests.lockstep import OFFBOARD_LINK, Peer, airborne

pytestmark = pytest.mark.realtime
OFFBOARD = 0x00060000
PACE = "pace"
STEP_S = 0.05
"""The longest that the vehicle flies at once: a machine that stands still is not made up for."""


def circumnav(tmp_path: Path, *arguments: str) -> subprocess.Popen[str]:
    return start_app(
        *arguments, pace_file=tmp_path / PACE, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


class Vehicle:
    """The stub in step with the app, on a stream: a pseudo-terminal's master or a connected socket."""

    def __init__(self, config: StubConfig, pace: Pace) -> None:
        self.stub, self._pace = Stub(config), pace
        self.pilot = Peer(self.stub)
        self.now_s, self._wall_s = 0.0, time.monotonic()
        self.splitter = Splitter()
        self.setpoints: list[float] = []
        self.each_tick: Callable[[float], None] = lambda now_s: None

    def run(self, for_s: float, fd: int | None, *, until: Callable[[], bool] = lambda: False) -> bool:
        """Fly; return whether `until` came to hold. fd: the stream to the app, None = there is none."""
        end_s = self.now_s + for_s
        while self.now_s < end_s and not until():
            self._advance()
            self.each_tick(self.now_s)
            said = b"".join(self.stub.take(OFFBOARD_LINK))
            if fd is None:
                time.sleep(0.01)
                continue
            self._write(fd, said)
            if select.select([fd], [], [], 0.01)[0]:
                self._read(fd)
        return until()

    def _advance(self) -> None:
        wall_s = time.monotonic()
        limit_s = self._pace.limit_s(self.now_s, wall_s)
        self.now_s = max(self.now_s, min(self.now_s + min(wall_s - self._wall_s, STEP_S), limit_s))
        self._wall_s = wall_s
        self.stub.advance(self.now_s)

    def _write(self, fd: int, data: bytes) -> None:
        try:
            os.write(fd, data)
        except OSError:
            return  # nobody reads (yet), or the line is full

    def _read(self, fd: int) -> None:
        try:
            data = os.read(fd, 65536)
        except OSError:  # the app has closed its end
            time.sleep(0.01)
            return
        for frame in self.splitter.feed(data, whole=False):
            if frame.msgid == 84:
                self.setpoints.append(self.now_s)
            self.stub.receive(OFFBOARD_LINK, frame.raw)

    def engage(self, fd: int) -> None:
        assert self.run(20.0, fd, until=lambda: len(self.setpoints) > 30), "the app did not get ready"
        self.pilot.mode(OFFBOARD)
        assert self.run(5.0, fd, until=lambda: self.stub.truth().mode == "OFFBOARD")
        self.run(1.0, fd)
        assert self.stub.truth().mode == "OFFBOARD"

    @property
    def mode(self) -> str:
        return self.stub.truth().mode


def test_a_serial_link_unplugged_in_flight_comes_back_and_the_aircraft_is_not_taken_back(tmp_path):
    cable = Cable(tmp_path / "usb-autopilot")
    (tmp_path / "c.yaml").write_text(f"vehicle: {{link: 'serial://{cable.path}:921600'}}\nrecord: {{directory: f}}\n")
    app = circumnav(tmp_path, "fly", "c.yaml")
    try:
        vehicle = Vehicle(airborne(distance_m=60.0), Pace(wait_for_pace(tmp_path / PACE, app)))
        vehicle.engage(cable.master)
        cable.unplug()
        vehicle.run(2.5, None)  # longer than the loss timeout: the autopilot's failsafe acts
        assert vehicle.mode != "OFFBOARD"
        vehicle.setpoints.clear()
        vehicle.splitter = Splitter()
        cable.plug()
        vehicle.run(5.0, cable.master)
        assert vehicle.splitter.counts.frames > 5  # the app is back on the line: heartbeats and requests
        assert vehicle.setpoints == [] and vehicle.mode != "OFFBOARD"
        app.terminate()
        assert vehicle.run(15.0, cable.master, until=lambda: app.poll() is not None), "the app did not end"
        out = app.stdout.read()
        assert "vehicle link lost" in out and "is open again" in out and "released" in out, out
        assert app.returncode == 1
    finally:
        app.kill()
        app.wait()


def test_an_autopilot_on_tcp_and_a_radio_on_a_serial_port_fly(tmp_path):
    cable = Cable(tmp_path / "usb-radio")
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(20.0)
    port = listener.getsockname()[1]
    (tmp_path / "c.yaml").write_text(
        f"vehicle: {{link: 'tcp:127.0.0.1:{port}'}}\nrecord: {{directory: f}}\n"
        f"ranging: {{source: dwm1001_les, endpoint: '{cable.path},115200'}}\norbit: {{radius_m: 30}}\n"
    )
    app = circumnav(tmp_path, "fly", "c.yaml")
    try:
        router, _ = listener.accept()
        vehicle, tag, noise = (
            Vehicle(airborne(distance_m=60.0, radio=False), Pace(wait_for_pace(tmp_path / PACE, app))),
            DEVICES["dwm1001_les"](3),
            random.Random(1),
        )
        next_s = 0.0
        heard = b""

        def range_now(now_s: float) -> None:
            nonlocal next_s, heard
            heard += cable.heard()
            if b"les\r" in heard and now_s >= next_s:  # silent until the app has opened its shell
                next_s = now_s + 0.1
                cable.say(tag.encode(vehicle.stub.truth().range_m + noise.gauss(0.0, 0.1), 0.0, now_s))

        vehicle.each_tick = range_now
        vehicle.engage(router.fileno())
        count = len(vehicle.setpoints)
        flown = vehicle.run(30.0, router.fileno(), until=lambda: len(vehicle.setpoints) - count > 100)
        assert heard.startswith(b"\r\rles\r")
        assert flown and vehicle.mode == "OFFBOARD"
        app.terminate()
        assert vehicle.run(15.0, router.fileno(), until=lambda: app.poll() is not None), "the app did not end"
        assert app.returncode == 0, app.stdout.read()
        assert vehicle.mode == "AUTO/LOITER"
        router.close()
    finally:
        listener.close()
        app.kill()
        app.wait()


@pytest.mark.soak
def test_a_bias_is_measured_and_written_and_nothing_but_listening_is_done(tmp_path):
    cable = Cable(tmp_path / "usb-radio")
    path = tmp_path / "c.yaml"
    before = f"# ours\nranging:\n  source: linktrack   # the tag\n  endpoint: {cable.path}\n  bias_m: 0.1   # old\n"
    path.write_text(before)
    app = circumnav(tmp_path, "ranging", "c.yaml", "--calibrate", "10", "--duration", "4", "--record", "r.csv")
    try:
        tag, noise, n = DEVICES["linktrack"](3), random.Random(4), 0
        start_s, sent = time.monotonic(), b""
        while app.poll() is None and time.monotonic() - start_s < 30.0:
            n += 1
            cable.say(tag.encode(10.3 + noise.gauss(0.0, 0.03), 0.0, time.monotonic() - start_s))
            sent += cable.heard()
            time.sleep(0.005)  # often: a machine that stands still for most of these seconds leaves enough of them
        out = app.stdout.read()
        assert app.returncode == 0, out
        assert "standard error 0.00" in out and "good" in out and "written    ranging.bias_m" in out
        (line,) = [line for line in path.read_text().splitlines() if "bias_m" in line]
        assert abs(float(line.split()[1]) - 0.3) < 0.02 and line.endswith("   # old")
        assert path.read_text().replace(line.split()[1], "0.1") == before
        assert sent == b""
        recorded = [line.split(",") for line in (tmp_path / "r.csv").read_text().splitlines()[1:]]
        assert len(recorded) >= 50 and all(abs(float(cells[1]) - 10.2) < 0.2 for cells in recorded)  # the old bias off
    finally:
        app.kill()
        app.wait()
