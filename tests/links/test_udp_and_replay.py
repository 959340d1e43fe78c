"""UDP over loopback, and recorded ranges at their own pace."""

from __future__ import annotations

import os
import select
import socket

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.endpoint import parse
from circumnav_mav.mavlink.link import AutopilotLink
from circumnav_mav.ranging import replay
from circumnav_mav.runtime.links import open_link
from circumnav_mav.runtime.transport import LinkError
from circumnav_mav.runtime.udp import STAYS_S
from circumnav_mav.types import RangeSample
from tests.links.fake_loop import PATIENCE_S, FakeLoop, Wire


@pytest.fixture
def peer():
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(PATIENCE_S)
    yield made
    made.close()


@pytest.fixture
def radio():
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(PATIENCE_S)
    yield made
    made.close()


def heartbeat(sysid, compid=1):
    mav = mavlink.MAVLink(None, sysid, compid)
    return mav.heartbeat_encode(2, 12, 81, 0, 4, 3).pack(mav)


def distance(sysid, compid=158):
    mav = mavlink.MAVLink(None, sysid, compid)
    return mav.distance_sensor_encode(0, 20, 65000, 12000, 0, 7, 0, 255).pack(mav)


def test_a_radio_or_another_vehicle_on_the_autopilots_port_does_not_get_its_setpoints(peer, radio):
    autopilot = AutopilotLink(["DISTANCE_SENSOR"])
    link = open_link(parse("udpin://127.0.0.1:0"))
    loop, count, now_s = FakeLoop(), 0, 100.0
    link.now_s = lambda: now_s

    def take(data):
        nonlocal count
        count += 1
        autopilot.receive(data, float(count))
        return autopilot.autopilot_spoke

    link.start(loop, take, lambda up, words: None)

    def says(sender, *frames):
        wanted = count + len(frames)
        for frame in frames:
            sender.sendto(frame, ("127.0.0.1", link.port))
        loop.until(lambda: count == wanted)

    def who_hears(text):
        link.send(text)
        (heard,), _, _ = select.select([peer, radio], [], [], PATIENCE_S)
        assert heard.recv(1000) == text
        return heard

    says(radio, distance(1))
    assert who_hears(b"nobody else has spoken yet") is radio
    says(peer, heartbeat(1))
    assert who_hears(b"streams, please") is peer
    says(radio, *[distance(1)] * 20, heartbeat(1, compid=158), heartbeat(7))
    assert who_hears(b"a setpoint") is peer
    says(radio, heartbeat(1))
    assert who_hears(b"another that forwards the same is not taken at once") is peer
    now_s += STAYS_S + 0.1
    says(radio, heartbeat(1))
    assert who_hears(b"the autopilot has restarted on another port") is radio
    link.close()


def test_a_listening_link_answers_whom_it_is_told_to(peer):
    wire = Wire(open_link(parse("udpin://127.0.0.1:0")))
    wire.link.send(b"nobody yet")
    for text in (b"one", b"two"):
        peer.sendto(text, ("127.0.0.1", wire.link.port))
    wire.loop.until(lambda: wire.data == b"onetwo")
    wire.link.send(b"answer")
    assert peer.recv(100) == b"answer"
    assert wire.link.whole and wire.changes == []
    wire.link.close()
    wire.link.close()
    assert wire.loop.readers == {}


def test_a_calling_link_speaks_first_and_outlives_a_peer_that_is_not_there(peer):
    port = peer.getsockname()[1]
    wire = Wire(open_link(parse(f"udpout:127.0.0.1:{port}")))
    wire.link.send(b"hello")
    data, source = peer.recvfrom(100)
    assert data == b"hello"
    peer.sendto(b"back", source)
    wire.loop.until(lambda: wire.data == b"back")
    peer.close()
    for _ in range(3):
        wire.link.send(b"gone")  # refused by the system, later: no reason to stop
        wire.link.drain()
    assert wire.changes == []
    wire.link.close()


def test_a_port_in_use_is_said(peer):
    with pytest.raises(LinkError, match="the port is in use"):
        open_link(parse(f"udpin://127.0.0.1:{peer.getsockname()[1]}"))


def test_recorded_ranges_come_when_they_are_due_and_then_the_link_ends(tmp_path):
    path = tmp_path / "ranges.csv"
    samples = [RangeSample(50.0 + 0.25 * i, 100.0 + i) for i in range(5)]
    path.write_text("\n".join([replay.HEADER, *map(replay.row, samples)]) + "\n")
    wire = Wire(open_link(parse(f"file://{path}")))
    seen = []
    for _ in range(10):
        seen.append(sum(line[:1].isdigit() for line in wire.data.decode().splitlines()))
        assert wire.changes == [] or seen[-1] == 5
        wire.loop.advance(0.125)
    assert seen == [1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    assert wire.ups == [False] and "the recording is over" in wire.changes[0][1]
    wire.link.close()


def test_a_recording_that_is_not_there_is_said(tmp_path):
    with pytest.raises(LinkError, match=r"nowhere\.csv: cannot read it: No such file"):
        open_link(parse(f"file://{tmp_path}/nowhere.csv"))


@pytest.mark.parametrize("text", ["", f"{replay.HEADER}\n# nothing was heard\n"])
def test_a_recording_without_a_range_is_no_silent_device(tmp_path, text):
    """It was played to its end at once, and then the silence was explained as a device's."""
    (tmp_path / "empty.csv").write_text(text)
    with pytest.raises(LinkError, match=r"empty\.csv: it holds no ranges; a line is t_s,range_m"):
        open_link(parse(f"file://{tmp_path}/empty.csv"))


def test_what_may_never_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, words in ((tmp_path / "pipe", "it is not a file"), (tmp_path, "it is not a file")):
        with pytest.raises(LinkError, match=words):
            open_link(parse(f"file://{path}"))
