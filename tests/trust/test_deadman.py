"""A dead or hung app is seen as silence, and comes back as a guest. Real processes, sockets and signals."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import yaml

from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.runtime.systemd import Notifier
from circumnav_mav.runtime.watchdog import NAP_S, Watchdog
from sitl_stub import Stub
from sitl_stub.pace import Pace
from sitl_stub.server import Endpoint, Server
from tests.app_process import Alone, start_app, wait_for_pace
from tests.lockstep import Peer, airborne
from tests.trust.rules import OFFBOARD

ROOT = Path(__file__).parents[2]
SETPOINTS = {84, 82, 86}


class Field:
    """The stub on real sockets, and the app as a process. Everything that reaches the vehicle is noted.

    The two keep one clock, so that a busy machine makes a flight slower and no worse: until the app is to fall silent,
    when the stub may not wait for it (`wait_for_nobody`).
    """

    def __init__(
        self,
        directory: Path,
        library: str = "pymavlink",
        vehicle_id: int = 1,
        *,
        speed: float = 1.0,
        world: dict[str, object] | None = None,
        sections: dict[str, object] | None = None,
        **vehicle: object,
    ) -> None:
        usual = {"seed": 8, "params": {"COM_OBL_RC_ACT": 5}, "system_id": vehicle_id}
        self.stub = Stub(airborne(**{"distance_m": 80.0, **usual, **(world or {})}))
        self.server = Server(self.stub, {"offboard": Endpoint(0, 0), "gcs": Endpoint(0, 0)}, speed)
        self.pilot = Peer(self.stub)
        self.setpoints_s: list[float] = []
        self.modes_asked = 0
        self.senders: set[tuple[int, int]] = set()
        take = self.stub._take_frame

        def note(link, raw):
            msgid = int.from_bytes(raw[7:10], "little")
            if link.name == "offboard" and msgid in SETPOINTS:
                self.senders.add((raw[5], raw[6]))
                self.setpoints_s.append(self.stub.now_s)
            if link.name == "offboard" and msgid == 76 and int.from_bytes(raw[38:40], "little") == 176:
                self.modes_asked += 1
            take(link, raw)

        self.stub._take_frame = note
        self.config = directory / "config.yaml"
        link = f"udpout://127.0.0.1:{self.server.port('offboard')}"
        settings = {
            "vehicle": {"link": link, "library": library, **vehicle},
            "record": {"directory": str(directory / "flights")},
            **(sections or {}),
        }
        self.config.write_text(yaml.safe_dump(settings))
        self.pace_file = directory / "pace"
        self.start()

    def start(self) -> None:
        arguments = ("fly", str(self.config), "--wait", "0")
        streams = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL}
        self.app = start_app(*arguments, pace_file=self.pace_file, speed=self.server.speed, cwd=ROOT, **streams)
        self.server._pace = Pace(wait_for_pace(self.pace_file, self.app))

    def wait_for_nobody(self) -> None:
        self.server._pace = Alone(self.pace_file)

    def run(self, for_s: float, until=lambda: False) -> None:
        end_s = self.stub.now_s + for_s
        self.server.run(stop=lambda: self.stub.now_s >= end_s or until())

    def engage(self) -> None:
        self.run(60.0, until=lambda: len(self.setpoints_s) > 50)
        self.pilot.mode(OFFBOARD)
        self.run(2.0)
        assert self.mode == "OFFBOARD"

    @property
    def mode(self) -> str:
        return self.stub.truth().mode

    def since(self, from_s: float) -> list[float]:
        return [t for t in self.setpoints_s if t >= from_s]

    def close(self) -> None:
        self.app.send_signal(signal.SIGCONT)
        self.app.kill()
        self.app.communicate()
        self.server.close()


@pytest.fixture
def field(tmp_path, library):
    f = Field(tmp_path, library)
    yield f
    f.close()


FAULTS = [
    ("pymavlink", "killed"),
    ("pymavlink", "stopped"),
    ("pymavlink", "blocked with the GIL held"),
    ("mavsdk", "stopped"),
    pytest.param("pymavlink", "blocked", marks=pytest.mark.soak),
    pytest.param("mavsdk", "killed", marks=pytest.mark.soak),
    pytest.param("mavsdk", "blocked", marks=pytest.mark.soak),
    pytest.param("mavsdk", "blocked with the GIL held", marks=pytest.mark.soak),
]


@pytest.mark.realtime
@pytest.mark.parametrize(("library", "fault"), FAULTS)
def test_silence_failsafe_and_no_way_back_in(field, library, fault):
    """Figures: the last setpoint within a period, 0.02 s (pymavlink), or 200 ms (MAVSDK). The time is printed."""
    field.engage()
    app = field.app
    field.wait_for_nobody()
    signals = {"killed": "SIGKILL", "stopped": "SIGSTOP", "blocked": "SIGUSR1"}
    app.send_signal(getattr(signal, signals.get(fault, "SIGUSR2")))
    began_s = field.stub.now_s
    field.run(2.8)
    print(f"{library}, {fault}: last setpoint {field.setpoints_s[-1] - began_s:+.3f} s after the fault")
    assert field.since(began_s + 0.2) == [], "setpoints after the fault"
    assert field.mode == "AUTO/LOITER"
    if fault == "killed":
        app.wait()
        assert not children(field), "the process that MAVSDK lives in has outlived the app"
        field.start()
    elif fault == "stopped":
        field.run(0.4)
        app.send_signal(signal.SIGCONT)
    else:
        os.write(app.stdin.fileno(), b"\n")  # it hangs no longer
    field.run(4.0)
    assert field.since(began_s + 0.2) == [], "the aircraft was taken back"
    assert field.modes_asked == 0
    assert field.mode == "AUTO/LOITER"
    if fault == "blocked with the GIL held":
        assert app.poll() is None, "the watchdog was held up too: the gap rule alone keeps the app silent"
    elif fault == "blocked":
        assert app.wait(timeout=30.0) == 1, "a hung app ends with an error, so that systemd starts it again"


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("library", ["pymavlink", "mavsdk"])
def test_an_orbit_is_flown_through_either_library(tmp_path, library):
    """The same flight over real sockets: engaged by a pilot, settled, and held. The error is the stub's own truth."""
    field = Field(tmp_path, library, speed=1.0 if library == "mavsdk" else 5.0)  # MAVSDK keeps the wall's time
    try:
        field.engage()
        errors: list[float] = []
        for _ in range(300):
            field.run(0.2)
            errors.append(field.stub.truth().horizontal_range_m - 50.0)
        print(f"{library}: greatest error of the last 15 s {max(abs(e) for e in errors[-75:]):.2f} m")
        assert field.mode == "OFFBOARD"
        assert max(abs(e) for e in errors[-75:]) < 1.5
        assert field.modes_asked == 0
    finally:
        field.close()


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("name", ["px4_fixed_wing", "px4_multirotor_attitude"])
def test_any_kind_of_setpoint_is_flown_through_mavsdk(tmp_path, name):
    """MAVSDK's own offboard calls take no quaternion; its messages do, and every setpoint goes through as it is."""
    if VEHICLES[name].airframe == "fixed_wing":
        radius_m, app = 80.0, {"orbit": {"radius_m": 80.0, "speed_m_s": 12.0}}
        world = {"airframe": "fixed_wing", "distance_m": 160.0, "height_m": 100.0, "start_speed_m_s": 12.0}
        own = {}
    else:
        radius_m, app, world, own = 50.0, {"limits": {"bank_deg": 20.0}}, {}, {"pitch_deg": -4.37}
    field = Field(tmp_path, "mavsdk", world=world, sections=app, **{"class": name, **own})
    try:
        field.engage()
        field.run(75.0)
        errors: list[float] = []
        for _ in range(50):
            field.run(0.2)
            errors.append(field.stub.truth().horizontal_range_m - radius_m)
        print(f"{name}: greatest error of the last 10 s {max(abs(e) for e in errors):.2f} m")
        assert field.mode == "OFFBOARD"
        assert max(abs(e) for e in errors) < 3.0
    finally:
        field.close()


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("library", ["pymavlink", "mavsdk"])
@pytest.mark.parametrize("vehicle", [{}, {"system_id": 7}], ids=["the first one heard", "configured"])
def test_a_vehicle_with_another_system_id_is_flown(tmp_path, library, vehicle):
    field = Field(tmp_path, library, 7, **vehicle)
    try:
        field.engage()
        field.run(3.0)
        assert field.mode == "OFFBOARD"
        assert field.senders == {(7, 191)}, "the app's system id is the vehicle's"
    finally:
        field.close()


def children(field: Field) -> list[Path]:
    """Return the MAVSDK processes on this field's port."""
    port = f"127.0.0.1:{field.server.port('offboard')}"
    found = []
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = process.read_text()
        except OSError:
            continue
        if "mavsdk_child" in words and port in words:
            found.append(process)
    return found


def mavsdk_child(field: Field) -> int:
    """Return the process id of this field's MAVSDK."""
    (path,) = children(field)
    return int(path.parent.name)


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("library", ["mavsdk"])
def test_a_mavsdk_that_is_held_up_for_a_moment_costs_no_more_than_that(field):
    """A quarter of a second is longer than the silence rule: the stream ends, and begins again at once."""
    field.engage()
    child = mavsdk_child(field)
    for _ in range(12):
        os.kill(child, signal.SIGSTOP)
        field.run(0.25)
        os.kill(child, signal.SIGCONT)
        field.run(1.5)
        assert field.mode == "OFFBOARD"
    assert mavsdk_child(field) == child
    assert field.modes_asked == 0


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("library", ["mavsdk"])
def test_a_setpoint_that_waited_for_mavsdk_is_dropped(field):
    """Sent, it would take the aircraft back out of the failsafe with what was meant two seconds ago."""
    field.engage()
    child = mavsdk_child(field)
    field.run(1.0)
    arrived = len(field.setpoints_s)
    field.run(1.0, until=lambda: len(field.setpoints_s) > arrived)
    os.kill(child, signal.SIGSTOP)  # one has just left: MAVSDK has nothing in hand
    stopped_s = field.stub.now_s
    field.run(0.2)
    field.wait_for_nobody()
    field.app.send_signal(signal.SIGSTOP)
    field.run(2.0)
    assert field.mode == "AUTO/LOITER"
    os.kill(child, signal.SIGCONT)
    field.run(2.0)
    assert field.since(stopped_s + 0.1) == []
    assert field.mode == "AUTO/LOITER"


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize("library", ["mavsdk"])
def test_a_polite_end_through_mavsdk_asks_for_hold_and_leaves_nothing_behind(field):
    field.engage()
    field.app.send_signal(signal.SIGINT)
    field.run(30.0, until=lambda: field.app.poll() is not None)
    assert field.app.poll() == 0
    assert field.modes_asked >= 1
    assert field.mode == "AUTO/LOITER"
    ended_s = field.stub.now_s
    field.run(1.0)
    assert field.since(ended_s) == []
    assert not children(field)


def listen(directory: Path, name: str = "notify") -> tuple[socket.socket, str]:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    path = str(directory / name)
    sock.bind(path)
    sock.settimeout(10.0)
    return sock, path


def test_systemd_hears_readiness_beats_and_the_end(tmp_path):
    sock, path = listen(tmp_path)
    notifier = Notifier({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "2000000"})
    notifier.tell("READY=1", "STATUS=listening")
    beats = [0.02 * n for n in range(250)]  # 5 s of ticks
    for wall_s in beats:
        notifier.beat(wall_s)
    notifier.close()
    heard = [sock.recv(256).decode() for _ in range(7)]
    assert heard == ["READY=1\nSTATUS=listening", *["WATCHDOG=1"] * 5, "STOPPING=1"]


def test_a_loop_that_does_not_tick_feeds_nothing(tmp_path):
    sock, path = listen(tmp_path)
    notifier = Notifier({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "2000000"})
    notifier.beat(0.0)
    notifier.beat(3.0)  # a tick at last: one beat, none made up for
    notifier.tell("STATUS=end")
    assert [sock.recv(256).decode() for _ in range(3)] == ["WATCHDOG=1", "WATCHDOG=1", "STATUS=end"]


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "/nowhere/at/all"},
        {"NOTIFY_SOCKET": "@nobody-listens-here", "WATCHDOG_USEC": "rubbish"},
        {"WATCHDOG_USEC": "1000000"},
    ],
)
def test_without_systemd_nothing_happens(environment):
    notifier = Notifier(environment)
    notifier.tell("READY=1")
    notifier.beat(1.0)
    notifier.close()


def test_beats_for_another_process_are_not_ours(tmp_path):
    sock, path = listen(tmp_path)
    notifier = Notifier({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"})
    notifier.beat(0.0)
    notifier.tell("STATUS=end")
    assert sock.recv(256) == b"STATUS=end"


def test_an_abstract_socket_is_reached():
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sock.bind(f"\0circumnav-test-{os.getpid()}")
    sock.settimeout(10.0)
    Notifier({"NOTIFY_SOCKET": f"@circumnav-test-{os.getpid()}"}).tell("READY=1")
    assert sock.recv(256) == b"READY=1"


def test_the_watchdog_closes_the_link_of_a_loop_that_does_not_tick():
    closed = threading.Event()
    dog = Watchdog(closed.set, within_s=3 * NAP_S)
    dog.start()
    assert closed.wait(30.0)
    assert dog.fired
    dog.stop()


def test_the_watchdog_leaves_a_ticking_loop_alone():
    """It is asked in its own thread, nap by nap: no clock decides."""
    closed = threading.Event()
    dog = Watchdog(closed.set, within_s=3 * NAP_S)
    naps = 0

    class Naps:
        def wait(self, _timeout):
            nonlocal naps
            naps += 1
            if naps % 3 == 0:
                dog.beat()  # every third nap: just often enough
            return naps > 100

    dog._end = Naps()
    dog._watch()
    assert not closed.is_set() and not dog.fired


UNIT = ROOT / "configs" / "circumnav.service"
PROGRAM = "/opt/circumnav/venv/bin/circumnav"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_the_unit_file_is_one_that_systemd_takes(tmp_path):
    """With the program where the field guide installs it, but for its place; and without it: the test can fail."""
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace(PROGRAM, sys.executable))
    done = verify(unit)
    assert done.returncode == 0, done.stderr
    assert "circumnav.service" not in done.stderr, done.stderr
    unit.write_text(UNIT.read_text().replace(PROGRAM, "/nowhere/circumnav"))
    assert "not executable" in verify(unit).stderr


def verify(unit: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)


def test_the_unit_file_says_what_the_app_relies_on_and_the_guide_installs_what_it_names():
    lines = UNIT.read_text().splitlines()
    guide = (ROOT / "docs" / "field_guide.md").read_text()
    for line in (
        "Type=notify",
        "NotifyAccess=main",
        "User=circumnav",
        "SupplementaryGroups=dialout",
        "WatchdogSec=2",
        "KillSignal=SIGINT",
        "Restart=on-failure",
        "RestartPreventExitStatus=2",
        f"ExecStart={PROGRAM} fly /etc/circumnav/config.yaml --wait 0",
    ):
        assert line in lines
    for word in (PROGRAM.removesuffix("/bin/circumnav"), "/etc/circumnav/config.yaml", "useradd", "dialout"):
        assert word in guide


def test_a_service_does_not_take_off_by_itself(tmp_path):
    """A restart finds a landed vehicle and must not fly it again: as a service the app engages for a pilot only."""
    file = tmp_path / "c.yaml"
    file.write_text("engage: auto\norbit: {height_m: 20}\n")
    done = subprocess.run(
        [sys.executable, "-m", "circumnav_mav", "fly", str(file)],
        env={**os.environ, "NOTIFY_SOCKET": "@nobody-listens-here", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "engage: auto is not for a service" in done.stderr and len(done.stderr.splitlines()) == 1
