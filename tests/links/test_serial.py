"""Serial links over pseudo-terminals: bytes, unplug and replug, and why a port does not open, in words."""

from __future__ import annotations

import errno
import math
import os
import random
import sys

import pytest
import serial

from circumnav_mav.config_file import parse as config
from circumnav_mav.endpoint import Endpoint, parse
from circumnav_mav.mavlink.codec import Packer, Splitter
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.runtime.links import open_link, open_ranging_link
from circumnav_mav.runtime.stream import AGAIN_S
from circumnav_mav.runtime.transport import Backoff, LinkError
from sitl_stub.devices import DEVICES, console_of
from tests.links.fake_loop import Cable, Wire


@pytest.fixture
def cable(tmp_path):
    made = Cable(tmp_path / "usb-3D_Robotics_PX4-if00")
    yield made
    if made.master >= 0:
        os.close(made.master)


def opened(cable: Cable, baud: int = 115_200, **more) -> Wire:
    return Wire(open_link(parse(f"serial://{cable.path}:{baud}"), **more))


def test_bytes_go_both_ways_whole_and_untouched(cable):
    wire = opened(cable)
    said = bytes(range(256)) * 4
    cable.say(said)
    wire.loop.until(lambda: len(wire.data) >= len(said))
    wire.link.send(said[::-1][:500])
    assert wire.data == said
    assert cable.heard(500) == said[::-1][:500]
    assert not wire.link.whole
    wire.link.close()


def test_drain_takes_everything_that_waits_at_once(cable):
    wire = opened(cable)
    cable.say(b"x" * 3000)
    wire.loop.turn(1.0)  # the kernel has handed over the first piece
    wire.link.drain()
    assert wire.data == b"x" * 3000
    wire.link.close()


def test_the_baud_rate_is_the_one_asked_for(cable):
    for baud in (57_600, 921_600, 420_000):
        wire = opened(cable, baud)
        assert wire.link._channel._port.baudrate == baud
        wire.link.close()
    wire = Wire(open_link(Endpoint("serial", path=str(cable.path)), default_baud=9600))
    assert str(wire.link.endpoint).endswith(":9600")
    wire.link.close()


def test_unplugged_and_replugged(cable):
    wire = opened(cable)
    cable.unplug()
    wire.loop.until(lambda: wire.changes != [])
    assert wire.ups == [False]
    assert str(cable.path) in wire.changes[0][1] and "trying" in wire.changes[0][1]
    for _ in range(4):
        wire.link.send(b"lost")
    wire.loop.advance(3.0)
    assert wire.ups == [False]  # told once, however often it is tried
    cable.plug()
    wire.loop.advance(Backoff.MOST_S)
    assert wire.ups == [False, True]
    assert cable.heard() == b""  # what could not be sent then is not sent now
    cable.say(b"again")
    wire.loop.until(lambda: wire.data == b"again")
    wire.link.send(b"here")
    assert cable.heard(4) == b"here"
    wire.link.close()


def test_attempts_get_rarer_and_start_anew_once_the_device_spoke(cable):
    wire = opened(cable)
    cable.unplug()
    wire.loop.until(lambda: wire.changes != [])
    waits = []
    for _ in range(8):
        (due_s,) = wire.loop.due_s
        waits.append(round(due_s - wire.loop.now_s, 6))
        wire.loop.advance(due_s - wire.loop.now_s)
    assert waits == [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0]
    cable.plug()
    wire.loop.advance(5.0)
    cable.say(b"!")
    wire.loop.until(lambda: wire.data == b"!")
    cable.unplug()
    wire.loop.until(lambda: wire.ups == [False, True, False])
    assert [round(due_s - wire.loop.now_s, 6) for due_s in wire.loop.due_s] == [0.2]
    wire.link.close()


def test_a_closed_link_is_not_opened_again(cable):
    wire = opened(cable)
    wire.link.close()
    wire.link.close()
    assert wire.loop.readers == {} and wire.loop.due_s == []
    wire.link.send(b"x")
    assert cable.heard() == b""

    wire = opened(cable)
    cable.unplug()
    wire.loop.until(lambda: wire.changes != [])
    wire.link.close()
    assert wire.loop.readers == {} and wire.loop.due_s == []


def test_a_silent_device_is_made_to_talk_at_the_start_and_after_a_replug(cable):
    wire = opened(cable, steps=((0.0, b"\r\r"), (1.0, b"les\r")))
    wire.loop.advance(0.0)
    assert cable.heard(2) == b"\r\r"
    wire.loop.advance(0.9)
    assert cable.heard() == b""
    wire.loop.advance(0.2)
    assert cable.heard(4) == b"les\r"
    cable.unplug()
    wire.loop.until(lambda: wire.changes != [])
    cable.plug()
    wire.loop.advance(2.0)
    assert cable.heard(6) == b"\r\rles\r"
    wire.loop.advance(AGAIN_S - 2.0)
    assert cable.heard() == b""
    wire.loop.advance(3.0)
    assert cable.heard(6) == b"\r\rles\r"  # still silent: again
    wire.link.close()


def test_a_device_that_talks_is_left_alone(cable):
    understood = [7]
    wire = opened(cable, steps=((0.0, b"\r\r"), (1.0, b"les\r")), understood=lambda: understood[0])
    wire.loop.advance(0.5)
    assert cable.heard(2) == b"\r\r"  # what was understood before it was opened counts for nothing
    understood[0] += 1
    wire.loop.advance(60.0)
    assert cable.heard() == b"" and wire.loop.due_s == []
    wire.link.close()


class Module:
    """A DWM1001 on the cable, which is the same one however often the port is opened."""

    PERIOD_S = 0.1

    def __init__(self, cable: Cable) -> None:
        self.cable, self.device, self.console = cable, DEVICES["dwm1001_les"](0x1151), console_of("dwm1001_les")
        self.t_s, self.in_sight = 0.0, True

    def live(self) -> bool:
        """Pass a period; return whether anything was said."""
        self.t_s += self.PERIOD_S
        out = self.console.hear(self.cable.heard(), self.t_s)
        out += self.console.says(self.device.encode(12.34 if self.in_sight else math.nan, 0.0, self.t_s))
        if out:
            self.cable.say(out)
        return bool(out)


def session(module: Module, for_s: float) -> int:
    """Open the port as the app does, listen, close it; return how many ranges came in the last half."""
    where = f"serial://{module.cable.path}"
    feed = RangeFeed(config(f"ranging: {{source: dwm1001_les, endpoint: '{where}'}}").ranging)
    wire = Wire(open_ranging_link(parse(where), feed), lambda data: feed.on_bytes(data, module.t_s, whole=False))
    half = 0
    for i in range(round(for_s / module.PERIOD_S)):
        if module.live():
            wire.loop.turn(1.0)  # the kernel hands over what is under way
        wire.loop.advance(module.PERIOD_S)
        half = feed.counts.accepted if 2 * i * module.PERIOD_S < for_s else half
    wire.link.close()
    return feed.counts.accepted - half


def test_a_dwm1001_is_heard_each_of_four_times_that_the_app_is_started(cable):
    """`les` stops the lines that another `les` has started."""
    module = Module(cable)
    heard = [session(module, 10.0) for _ in range(4)]
    assert all(count > 40 for count in heard), heard


def test_a_dwm1001_that_hears_no_anchor_at_the_start_is_heard_later(cable):
    module = Module(cable)
    session(module, 10.0)
    module.in_sight = False  # nothing shows that the lines are on
    assert session(module, 20.0) == 0
    module.in_sight = True
    assert session(module, 40.0) > 40


def test_a_line_that_takes_nothing_costs_whole_frames_only(cable):
    wire = opened(cable)
    packer, sent = Packer(1, 191), 0
    for i in range(2000):  # far more than a pseudo-terminal holds
        frame = packer.pack("SYSTEM_TIME", time_unix_usec=2**60 + i, time_boot_ms=2**30)
        wire.link.send(frame)
        sent += 1
    assert 0 < wire.link.send_errors < sent
    splitter = Splitter()
    first = splitter.feed(cable.heard(), whole=False)
    wire.link.send(packer.pack("SYSTEM_TIME", time_unix_usec=2**60, time_boot_ms=2**30))
    rest = splitter.feed(cable.heard(), whole=False)
    assert len(first) > 10 and len(rest) >= 1
    assert splitter.counts.bad_crc == 0 and splitter.counts.rubbish_bytes == 0
    wire.link.close()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (serial.SerialException(errno.EACCES, "could not open port: Permission denied"), "group dialout"),
        (serial.SerialException(errno.EBUSY, "could not open port: Device or resource busy"), "another program"),
        (serial.SerialException("Could not configure port: (25, 'Inappropriate ioctl for device')"), "no serial port"),
        (ValueError("Failed to set custom baud rate (123456)"), "does not do 115200 baud"),
        (OSError(errno.EIO, "Input/output error"), "plug it in again"),
    ],
)
def test_why_a_port_does_not_open(cable, monkeypatch, error, words):
    def refuse(*args, **more):
        raise error

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(LinkError, match=words) as caught:
        opened(cable)
    assert "\n" not in str(caught.value) and str(cable.path) in str(caught.value)


def test_a_missing_device_a_file_and_a_port_in_use(cable, tmp_path):
    with pytest.raises(LinkError, match="no such device: is it plugged in"):
        open_link(parse(f"{tmp_path}/ttyNowhere,57600"))
    (tmp_path / "plain").write_text("no port")
    with pytest.raises(LinkError, match="no serial port"):
        open_link(parse(f"{tmp_path}/plain,57600"))
    wire = opened(cable)
    with pytest.raises(LinkError, match="another program has it open"):
        opened(cable)
    wire.link.close()
    opened(cable).link.close()


def test_without_pyserial_the_missing_package_is_named(cable, monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"pip install 'circumnav-mav\[serial\]'"):
        opened(cable)


def uart(data: bytes, sent_baud: int, read_baud: int, phase: float) -> bytes:
    """Return what a UART (8N1) at `read_baud` makes of `data` sent at `sent_baud` without pauses."""
    bits = [bit for byte in data for bit in (0, *((byte >> i) & 1 for i in range(8)), 1)] + [1] * 40
    step = sent_baud / read_baud
    out, at = bytearray(), phase
    while at + 10 * step < len(bits):
        if bits[int(at)]:  # idle: look for the falling edge
            at += step / 8
            continue
        middle = at + step / 2
        out.append(sum(bits[int(middle + (1 + i) * step)] << i for i in range(8)))
        at = middle + 9 * step
    return bytes(out)


@pytest.mark.parametrize("read_baud", [9600, 38_400, 115_200, 230_400, 921_600])
def test_a_wrong_baud_rate_is_told_from_mavlink(read_baud):
    packer, draw = Packer(1, 1), random.Random(read_baud)
    stream = b"".join(
        packer.pack("ATTITUDE", time_boot_ms=i, roll=draw.random(), pitch=draw.random(), yaw=draw.random(),
                    rollspeed=draw.random(), pitchspeed=draw.random(), yawspeed=draw.random())
        for i in range(60)
    )  # fmt: skip
    splitter = Splitter(["HEARTBEAT", "ATTITUDE"])
    noise = uart(stream, 57_600, read_baud, draw.random())
    for at in range(0, len(noise), 7):
        splitter.feed(noise[at : at + 7], whole=False)
    assert splitter.counts.noise, splitter.counts
    right = Splitter()
    right.feed(uart(stream[:4000], 57_600, 57_600, 0.0), whole=False)
    assert not right.counts.noise and right.counts.understood > 50
