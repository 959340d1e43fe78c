"""What goes through MAVSDK comes out as it went in: every message that the app lives on, there and back as JSON."""

from __future__ import annotations

import json
import math
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from circumnav_mav.config import Config
from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.endpoint import Endpoint
from circumnav_mav.mavlink.autopilot import Autopilot
from circumnav_mav.mavlink.codec import Decoder, Packer, Splitter
from circumnav_mav.mavlink.dialect import by_name

pytest.importorskip("mavsdk", reason="mavsdk is not installed")

from mavsdk.plugins.mavlink_direct import MavlinkDirectError

from circumnav_mav.mavlink.link import SETPOINTS
from circumnav_mav.runtime.demo import demo_speed
from circumnav_mav.runtime.mavsdk_child import OLD_S, SENT, Child, fields_of, to_mavsdk
from circumnav_mav.runtime.mavsdk_link import STAMP, MavsdkLink
from circumnav_mav.runtime.transport import LinkError
from circumnav_mav.runtime.udp import UdpLink

NAMES = sorted({*Autopilot().messages, *SENT, "DISTANCE_SENSOR", "PARAM_VALUE", "LANDING_TARGET"})


def random_payload(name: str, rng: random.Random) -> bytes:
    """Return bytes in which every field is a value that JSON can carry."""
    shape = by_name(name)
    while True:
        raw = rng.randbytes(shape.struct.size)
        values = shape.struct.unpack(raw)
        if all(not isinstance(v, float) or math.isfinite(v) for v in values):
            return raw


@pytest.mark.parametrize("name", NAMES)
def test_a_message_survives_the_way_through_json(name):
    rng = random.Random(name)
    shape = by_name(name)
    for _ in range(30):
        fields = shape.unpack(random_payload(name, rng), 0, shape.struct.size)._asdict()
        for key, value in fields.items():
            if isinstance(value, bytes):
                fields[key] = b"TEXT".ljust(len(value), b"\0")
        frame = Packer(1, 1).pack(name, **fields)
        (cut,) = Splitter({name}).feed(frame, whole=True)
        message = Decoder({name}).decode(cut)
        sent = to_mavsdk(message)
        assert (sent.message_name, sent.system_id, sent.component_id) == (name, 1, 1)
        said = json.loads(sent.fields_json)
        again = Packer(1, 1).pack(name, **fields_of(name, said))
        assert again == frame


class Spoken:
    """Stands for MAVSDK's mavlink_direct."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def send_message(self, message) -> None:
        if message.message_name == "TIMESYNC":
            raise MavlinkDirectError(1, "refused")
        self.names.append(message.message_name)


NOW_S = 1000.0


@pytest.fixture
def child(monkeypatch):
    """A child whose vehicle was found, on a clock that stands still, and the app's end of the pair."""
    monkeypatch.setattr("circumnav_mav.runtime.mavsdk_child.time", SimpleNamespace(monotonic=lambda: NOW_S))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setblocking(False)
    with ours, theirs:
        child = Child("udpin://127.0.0.1:0", theirs, 0)
        child._direct = Spoken()
        yield child, ours


def given(ours: socket.socket, name: str, age_s: float = 0.0) -> None:
    payload, shape = random_payload(name, random.Random(name)), by_name(name)
    frame = Packer(1, 191).pack(name, **shape.unpack(payload, 0, len(payload))._asdict())
    ours.send(STAMP.pack(NOW_S - age_s) + frame)


@pytest.mark.parametrize("name", sorted(SETPOINTS))
def test_a_setpoint_goes_out_once_and_one_that_waited_does_not(child, name):
    child, ours = child
    for age_s in (5.0, 2.0 * OLD_S, 0.0, 1.1 * OLD_S):
        given(ours, name, age_s)
    child._read()
    child._read()
    assert child._direct.names == [name]


def test_before_the_vehicle_is_found_nothing_goes_out_or_waits(child):
    child, ours = child
    spoken, child._direct = child._direct, None
    given(ours, "COMMAND_LONG")
    child._read()
    child._direct = spoken
    child._read()
    assert spoken.names == []


def test_what_mavsdk_refuses_is_counted_and_ends_nothing(child):
    child, ours = child
    given(ours, "TIMESYNC")
    given(ours, "COMMAND_ACK")
    child._read()
    assert child._direct.names == ["COMMAND_ACK"] and child.dropped == {"TIMESYNC": 1}


def test_a_demo_through_mavsdk_keeps_real_time():
    assert demo_speed(Config()) == 5.0
    assert demo_speed(Config(vehicle={"library": "mavsdk"})) == 1.0


def test_what_is_not_a_number_goes_as_null_and_comes_back():
    fields = dict.fromkeys(by_name("COMMAND_LONG").fields, 0) | {"param7": math.nan}
    (cut,) = Splitter({"COMMAND_LONG"}).feed(Packer(1, 191).pack("COMMAND_LONG", **fields), whole=True)
    said = json.loads(to_mavsdk(Decoder({"COMMAND_LONG"}).decode(cut)).fields_json)
    assert said["param7"] is None
    assert math.isnan(fields_of("COMMAND_LONG", said)["param7"])


def test_what_mavsdk_does_not_know_is_zero_and_what_we_do_not_know_is_dropped():
    assert fields_of("HEARTBEAT", {"type": 2})["custom_mode"] == 0
    with pytest.raises(KeyError):
        fields_of("NO_SUCH_MESSAGE", {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: {library: mavsdk, class: arducopter}", "flown with PX4 only"),
        ("vehicle: {library: mavsdk, signing_key_file: k}", "not with library mavsdk"),
        ("vehicle: {library: mavlink}", "'pymavlink' or 'mavsdk'"),
    ],
)
def test_what_mavsdk_cannot_do_is_a_fault_of_the_file(text, words):
    with pytest.raises(ConfigError) as caught:
        parse(text, "c.yaml")
    assert any(words in line for line in caught.value.lines()), list(caught.value.lines())


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_busy_port_is_told_before_a_child_is_started(kind, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a child was started"))
    family = socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, family) as other:
        other.bind(("127.0.0.1", 0))
        if family == socket.SOCK_STREAM:
            other.listen()
        port = other.getsockname()[1]
        with pytest.raises(LinkError, match=f"{kind}://127.0.0.1:{port}: the port is in use; stop the other program"):
            MavsdkLink(Endpoint(kind, "127.0.0.1", port))


def test_a_host_that_is_not_ours_is_told_as_on_the_udp_link():
    with pytest.raises(LinkError) as udp:
        UdpLink(Endpoint("udpin", "192.0.2.1", 14540))
    with pytest.raises(LinkError) as mavsdk:
        MavsdkLink(Endpoint("udpin", "192.0.2.1", 14540))
    assert str(mavsdk.value) == str(udp.value)


def test_the_command_line_leaves_with_3_and_one_line(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        file = tmp_path / "c.yaml"
        file.write_text(
            f"vehicle: {{library: mavsdk, link: 'udpin://127.0.0.1:{port}'}}\nrecord: {{directory: {tmp_path}}}\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", "from circumnav_mav.cli import main; main()", "fly", str(file)],
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert done.returncode == 3, done.stderr
    assert f"udpin://127.0.0.1:{port}: the port is in use" in done.stderr
    assert "Traceback" not in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_child_that_cannot_connect_says_so_in_one_line():
    """The port is taken between the parent's look and MAVSDK's: no traceback."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{other.getsockname()[1]}"
        done = subprocess.run(
            [sys.executable, "-m", "circumnav_mav.runtime.mavsdk_child", url, str(theirs.fileno()), "0"],
            pass_fds=[theirs.fileno()],
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith(f"circumnav: {url}: MAVSDK")


def test_a_child_that_ends_by_itself_ends_the_app_with_one_line(tmp_path):
    """Else it would wait for ever without a link, and feed the watchdog that should restart it."""
    file = tmp_path / "c.yaml"
    link = "udpin://127.0.0.1:0"
    file.write_text(f"vehicle: {{library: mavsdk, link: '{link}'}}\nrecord: {{directory: {tmp_path}}}\n")
    fly = [sys.executable, "-c", "from circumnav_mav.cli import main; main()", "fly", str(file), "--wait", "0"]
    with subprocess.Popen(fly, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as app:
        try:
            children = Path(f"/proc/{app.pid}/task/{app.pid}/children")
            until_s = time.monotonic() + 60.0
            while "waiting_autopilot" not in (out := app.stdout.readline()) and time.monotonic() < until_s and out:
                pass
            (child,) = children.read_text().split()
            os.kill(int(child), signal.SIGKILL)
            rest, errors = app.communicate(timeout=60)
        finally:
            app.kill()
    assert app.returncode == 1, errors
    assert errors.splitlines() == ["circumnav: link_ended: the MAVSDK process has ended; setpoints have stopped"]
    assert "check the network" not in rest
