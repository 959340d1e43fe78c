"""`circumnav ranging` without its loop: what it counts, why it says that there is no range, and how it sums up."""

from __future__ import annotations

import asyncio
import contextlib
import io
import random
import socket

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config_file import parse
from circumnav_mav.runtime.ranging_app import RangingApp, summary
from circumnav_mav.runtime.ranging_view import PlainRangingView, draw
from sitl_stub.devices import DEVICES, Node, linktrack_node_frame3
from tests.links.fake_loop import Cable


class Clock:
    """Time as the test sets it, or so much later each time it is asked."""

    speed = 1.0

    def __init__(self, step_s: float = 0.0) -> None:
        self.now_s, self._step_s = 0.0, step_s

    def now(self) -> float:
        self.now_s += self._step_s
        return self.now_s


class Quiet:
    def show(self, now_s, status, hint) -> None: ...

    def event(self, now_s, text) -> None: ...

    def close(self) -> None: ...


class Bench:
    """An app whose link is open and whose time and bytes the test gives."""

    def __init__(self, text: str) -> None:
        self.clock, self.out = Clock(), io.StringIO()
        self.app = RangingApp(parse(text), self.clock, PlainRangingView(self.out))

    def hear(self, data: bytes, after_s: float = 0.1) -> None:
        self.clock.now_s += after_s
        self.app.take(data)

    @property
    def status(self):
        return self.app.monitor.status(self.clock.now_s)

    def close(self) -> None:
        self.app._link.close()


@pytest.fixture
def bench():
    opened = []

    def make(text: str) -> Bench:
        opened.append(Bench(text))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


@pytest.fixture
def linktrack(bench, tmp_path):
    cable = Cable(tmp_path / "tty")
    yield bench(f"ranging: {{source: linktrack, endpoint: 'serial://{cable.path}'}}")
    cable.unplug()


def distance(range_m: float, component: int = 191, orientation: int = 0) -> bytes:
    mav = mavlink.MAVLink(None, 1, component)
    cm = round(range_m * 100)
    return bytes(mavlink.MAVLink_distance_sensor_message(0, 10, 60000, cm, 0, 0, orientation, 255).pack(mav))


MESSAGES = "vehicle: {link: 'udpin://127.0.0.1:0'}"


def test_messages_are_accepted_and_rejected_by_reason(bench):
    b = bench(MESSAGES)
    for i in range(50):
        b.hear(distance(100.0 + i) + distance(3.0, component=1, orientation=25))
    status = b.status
    assert (status.accepted, status.rejected) == (50, {"wrong_source": 50})
    assert status.rate_hz == pytest.approx(10.0, rel=0.05)
    assert [sample.range_m for sample in b.app.samples] == [100.0 + i for i in range(50)]
    assert b.app.hint() == ""
    assert b.out.getvalue().count("rejected, wrong_source") == 1  # told once, with the detail


def test_bytes_in_any_pieces(linktrack):
    device, draw_ = DEVICES["linktrack"](3), random.Random(2)
    stream = b"".join(device.encode(20.0 + 0.01 * i, 0.0, 0.1 * i) for i in range(100))
    while stream:
        cut = draw_.randrange(1, 60)
        linktrack.hear(stream[:cut], 0.1 * cut / len(device.encode(20.0, 0.0, 0.0)))
        stream = stream[cut:]
    assert linktrack.status.accepted == 100 and linktrack.status.rejected == {}
    assert linktrack.app._link.endpoint.baud == 921_600  # as the device is delivered


def test_a_range_that_stands_still_on_the_bench_is_no_fault(linktrack):
    device = DEVICES["linktrack"](3)
    for i in range(200):
        linktrack.hear(device.encode(10.0, 0.0, 0.1 * i))
    assert linktrack.status.accepted == 200 and linktrack.status.jitter_s < 1e-9


def test_why_there_is_no_range_from_messages(bench):
    b = bench(MESSAGES)
    assert "nothing is heard on udpin://127.0.0.1:0" in b.app.hint()
    b.hear(b"$GPGGA,no mavlink at all*00\r\n" * 10)
    assert "not MAVLink" in b.app.hint()
    b = bench(MESSAGES)
    b.hear(bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1))))
    assert "1 MAVLink frames" in b.app.hint() and "no DISTANCE_SENSOR" in b.app.hint()
    b.hear(distance(3.0, component=1))
    assert "only the autopilot's own ranges come on udpin://127.0.0.1:0 (1): is the radio on" in b.app.hint()
    b.hear(distance(100.0))
    assert b.app.hint() == ""


def test_why_there_is_no_range_from_a_device(linktrack):
    assert "is there a device" in linktrack.app.hint()
    linktrack.hear(b"temp=21.5 dist=12\r\n" * 20)
    assert "not linktrack: another baud rate than 921600?" in linktrack.app.hint()
    linktrack.hear(DEVICES["dwm1001_les"](3).encode(10.0, 0.0, 0.0) * 40)
    assert "not linktrack; ranges of dwm1001_les come there: set ranging.source" in linktrack.app.hint()
    for i in range(9):
        linktrack.hear(DEVICES["linktrack"](3).encode(0.0, 0.0, 0.1 * i))
    assert "no_reading" in linktrack.app.hint()


def test_on_a_signed_link_unsigned_ranges_do_not_count(bench, tmp_path):
    key = tmp_path / "key"
    key.write_text("a passphrase")
    key.chmod(0o600)
    b = bench(f"vehicle: {{link: 'udpin://127.0.0.1:0', signing_key_file: '{key}'}}")
    b.hear(distance(100.0))
    assert b.status.accepted == 0 and "1 unsigned" in b.app.hint()


def test_the_summary_says_everything_in_lines_of_one_fact(bench):
    b = bench(MESSAGES)
    for i in range(30):
        b.hear(distance(100.0 + i) + (distance(3.0, component=1) if i % 3 == 0 else b""))
    lines = list(summary(b.status, b.clock.now_s, b.app.hint()))
    assert lines[0] == "ranges     30 in 3.0 s, 10.0 Hz"
    assert any(line.startswith("rejected   10 wrong_source: (1, 1) is an autopilot") for line in lines)
    assert not any(line.startswith("why") for line in lines)
    empty = bench(MESSAGES)
    assert list(summary(empty.status, 2.0, empty.app.hint()))[-1].startswith("why        nothing is heard")


def test_all_beacons_of_a_stream_are_shown_to_choose_from(bench):
    """Two LinkTrack anchors in one frame; the configuration chose number 3."""
    b = bench("ranging: {source: linktrack, endpoint: 'udpin://127.0.0.1:0', beacon_id: 3}")
    for i in range(20):
        nodes = [Node(1, 3, 20_000 + i, 180, 160, 0), Node(1, 9, 70_000, 180, 160, 0)]
        b.hear(linktrack_node_frame3(2, 0, 1000 + 100 * i, 0, 4950, nodes))
    lines = list(summary(b.status, b.clock.now_s, b.app.hint(), b.app.heard()))
    assert "heard      sensor_id 1, beacon_id 3: 20.019 m, flown on" in lines
    assert "heard      sensor_id 1, beacon_id 9: 70.000 m" in lines
    assert b.out.getvalue().count("heard: sensor_id 1, beacon_id 9") == 1
    assert b.status.accepted == 20 and b.status.rejected == {"wrong_beacon": 20}


def test_the_views_draw_every_state(bench):
    from rich.console import Console

    b = bench(MESSAGES)
    view = PlainRangingView(b.out)
    for i in range(40):
        console = Console(width=120, file=io.StringIO())
        console.print(draw(b.status, b.app.hint(), "title", ["event"]))
        view.show(b.clock.now_s, b.status, b.app.hint())
        b.hear(distance(100.0 + i) if i > 10 else b"")
    shown = [line for line in b.out.getvalue().splitlines() if " range " in line]
    assert len(shown) == 3  # one a second, from the first second on
    assert "nothing is heard" in shown[0] and "10.0 Hz" not in shown[0]
    assert "accepted" in shown[-1]


def test_it_calls_where_nobody_answers_uncalled_and_says_nothing_but_that_it_is_there():
    """Under ids that no flight has: on udpout a heartbeat, and everywhere the question for the clocks."""
    peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    peer.bind(("127.0.0.1", 0))
    peer.settimeout(5.0)
    place = f"127.0.0.1:{peer.getsockname()[1]}"
    asyncio.run(RangingApp(parse(f"vehicle: {{link: 'udpout://{place}'}}"), Clock(0.3), Quiet(), 3.0).run())
    heard = []
    peer.settimeout(0.05)
    with contextlib.suppress(TimeoutError):
        while True:
            heard.append(mavlink.MAVLink(None).decode(bytearray(peer.recv(1000))))
    assert {(m.get_type(), m.get_srcComponent()) for m in heard} == {("HEARTBEAT", 192), ("TIMESYNC", 192)}
    assert {getattr(m, "type", 18) for m in heard} == {18} and {getattr(m, "tc1", 0) for m in heard} == {0}
    assert 4 <= len(heard) <= 8

    app = RangingApp(parse(MESSAGES), Clock(0.3), Quiet(), 3.0)
    peer.sendto(distance(100.0), ("127.0.0.1", app._link.port))
    status = asyncio.run(app.run())
    assert status.accepted == 1
    heard = []
    with contextlib.suppress(TimeoutError):
        while True:
            heard.append(mavlink.MAVLink(None).decode(bytearray(peer.recv(1000))))
    assert heard and {(m.get_type(), m.get_srcComponent(), m.tc1) for m in heard} == {("TIMESYNC", 192, 0)}
    peer.close()


@pytest.mark.parametrize("ranging", ["source: rangefinder, from: [1, 158]", "use_stamps: false"])
def test_where_no_stamp_is_read_not_one_byte_leaves(ranging):
    peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    peer.bind(("127.0.0.1", 0))
    peer.settimeout(0.05)
    app = RangingApp(parse(f"{MESSAGES}\nranging: {{{ranging}}}"), Clock(0.3), Quiet(), 3.0)
    peer.sendto(distance(100.0), ("127.0.0.1", app._link.port))
    asyncio.run(app.run())
    with pytest.raises(TimeoutError):
        peer.recv(1000)
    peer.close()


def late_beacon(b, answers: bool) -> str:
    """Let a radio send ranges 0.4 s late for 8 s; return what the summary says of the delay."""
    radio = mavlink.MAVLink(None, 1, 158)
    app, packer = b.app, b.app._packer
    for n in range(1, 81):
        now_s = b.clock.now_s + 0.1
        for question in app.feed.questions(now_s, packer):
            asked = mavlink.MAVLink(None).decode(bytearray(question))
            if answers:
                answer = mavlink.MAVLink_timesync_message(round((now_s + 1000.0) * 1e9), asked.ts1)
                app.feed.on_bytes(bytes(answer.pack(radio)), now_s + 0.001, whole=True)
        stamp_ms = round((now_s - 0.4 + 1000.0) * 1e3)
        message = mavlink.MAVLink_distance_sensor_message(stamp_ms, 10, 60000, 5000 + n, 0, 7, 0, 255)
        b.hear(bytes(message.pack(radio)))
    app.monitor.whole_delay = app.feed.tells_whole_delay(b.clock.now_s)
    timing = next(line for line in summary(b.status, b.clock.now_s, "") if line.startswith("timing"))
    return timing[timing.index("delay") :]


OWN = f"{MESSAGES}\nranging: {{endpoint: 'udpin://127.0.0.2:0'"


@pytest.mark.parametrize("text", [MESSAGES, OWN + "}", OWN + ", stamped_by: sender}"])
def test_the_delay_that_a_clock_shows_is_the_whole_of_it(bench, text):
    words = late_beacon(bench(text), answers=True)
    assert words.startswith("delay ") and float(words.split()[1]) > 300.0


@pytest.mark.parametrize("text", [MESSAGES, OWN + "}"])
def test_what_a_line_shows_of_it_is_called_so(bench, text):
    words = late_beacon(bench(text), answers=False)
    assert words.startswith("delay, varying part ")


def test_a_delay_that_was_given_is_no_part(bench):
    b = bench(OWN + ", latency_s: 0.4}")
    late_beacon(b, answers=False)
    assert b.status.delay_name == "delay" and b.status.delay_s == pytest.approx(0.4, abs=0.01)
