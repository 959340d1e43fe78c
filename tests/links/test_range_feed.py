"""What the feed makes of a link's bytes, whoever writes them."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config import Config
from circumnav_mav.config_file import parse
from circumnav_mav.flight import RANGING, Flight
from circumnav_mav.guidance.phases import Phase
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.ranging import SOURCES, MessageSource
from circumnav_mav.runtime.app import App, Options
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.types import RangeSample
from sitl_stub.devices import DEVICES as STUB_DEVICES
from tests.lockstep import config

UDP = "udpin://127.0.0.1:14560"
PATTERN = "'D=(?P<range>[0-9.]+)'"


def feed_of(ranging: str, endpoint: str = UDP) -> RangeFeed:
    return RangeFeed(parse(f"ranging: {{endpoint: '{endpoint}', {ranging}}}").ranging)


def hear(feed: RangeFeed, pieces: list[bytes], *, whole: bool = True, step_s: float = 0.1) -> list[float]:
    """Return the ranges that were accepted of pieces that come one after the other."""
    found = []
    for n, piece in enumerate(pieces, 1):
        _, results = feed.on_bytes(piece, n * step_s, whole=whole)
        found += [result.range_m for result in results if isinstance(result, RangeSample)]
    return found


WROTE = [10.0 + 0.5 * n for n in range(20)]
DEVICES = {
    "json": ("source: lines, json: {range: data.dist}", lambda r_m: json.dumps({"data": {"dist": r_m}}).encode()),
    "pattern": (f"source: lines, pattern: {PATTERN}", lambda r_m: b"D=%.2f" % r_m),
    "lightware": ("source: lightware", lambda r_m: b"%.2f" % r_m),
    "dwm1001_les": ("source: dwm1001_les", lambda r_m: b"1151[5.00,8.00,2.25]=%.2f" % r_m),
    "omnipresense": ("source: omnipresense", lambda r_m: b'{"unit":"m", "range":%.2f}' % r_m),
}


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("end", [b"", b"\n", b"\r\n"])
def test_a_datagram_ends_a_line_with_or_without_a_line_s_end_in_it(device, end):
    ranging, write = DEVICES[device]
    feed = feed_of(ranging)
    assert hear(feed, [write(r_m) + end for r_m in WROTE]) == WROTE
    assert feed.counts.rejected == {}


def test_two_lines_in_a_datagram_are_two():
    assert hear(feed_of(f"source: lines, pattern: {PATTERN}"), [b"D=1.5\nD=2.5", b"\nD=3.5\n"]) == [1.5, 2.5, 3.5]


@pytest.mark.parametrize("cut", range(1, 7))
def test_lines_that_a_serial_bridge_cuts_into_datagrams_anywhere_are_never_read_by_halves(cut):
    """`D=1` of `D=12.50` would be a range."""
    stream = b"".join(b"D=%.2f\r\n" % r_m for r_m in WROTE)
    pieces = [b"D=9.00\r\n", *(stream[at : at + cut] for at in range(0, len(stream), cut))]
    assert hear(feed_of(f"source: lines, pattern: {PATTERN}"), pieces) == [9.0, *WROTE]


def test_a_serial_line_is_ended_by_its_own_ends_only():
    assert hear(feed_of(f"source: lines, pattern: {PATTERN}", "/dev/ttyUSB0"), [b"D=1", b"2.5\n"], whole=False) == [
        12.5
    ]


def test_frames_that_go_over_two_datagrams_are_whole_still():
    frame = bytes((0xFE, 2, 10, 1, 30, (2 + 10 + 1 + 30) & 0xFF))
    assert hear(feed_of("source: us_d1"), [frame[:3], frame[3:]]) == [2.66]


# -- why none comes --------------------------------------------------------------------------------------------------

TTY = "serial:///dev/ttyUSB0:115200"
JSON = "source: lines, json: {range: data.dist}"
TEN = b"temp=21.5 dist=12\r\n" * 10
WHY = {
    "pattern": (f"source: lines, pattern: {PATTERN}", TEN, ".pattern finds no range in them: 'temp=21.5 dist=12'"),
    "json path": (JSON, b'{"data": {"range": 3}}\n' * 30, ".json finds no range in them: '{\"data\": {\"range\": 3}}'"),
    "no json": (JSON, TEN, "ranging.json finds no range in them: 'temp=21.5 dist=12'"),
    "no number": ("source: lines, pattern: '(?P<range>temp)'", TEN, "ranging.pattern finds no range in them"),
    "all ignored": (f"source: lines, pattern: {PATTERN}, ignore: temp", TEN, "ranging.ignore passes over all of them"),
    "another device": ("source: lightware", TEN, "lightware finds no range in them: 'temp=21.5 dist=12'"),
    "no range in it": ("source: omnipresense", b'{"speed":0.58}\r\n' * 20, "omnipresense finds no range in them"),
    "no line end": (JSON, b"12.5 13.5 14.5 " * 20, "text comes on serial:///dev/ttyUSB0:115200, but no end of a line"),
    "long lines": (JSON, (b"x" * 600 + b"\n") * 3, "longer than 512 bytes, which is too long for lines: 'xxx"),
    "a long line": (JSON, (b"y" * 100 + b"\n") * 3, "'" + "y" * 60 + "...'"),
    "one line": (JSON, b"hello\n", "ranging.json finds no range in them: 'hello'"),
    "few bytes": (JSON, b"\x80\xff\x13", "only 3 bytes"),
    "few of a frame": ("source: us_d1", b"\xfe\x02\x0a", "only 3 bytes"),
    "noise": (JSON, bytes(range(128, 256)) * 3, "384 bytes on serial:///dev/ttyUSB0:115200 that are not lines: "),
    "noise of lines": (JSON, bytes(range(256)) * 3, "that are not lines: another baud rate than 115200?"),
    "other frames": ("source: us_d1", TEN * 3, "that are not us_d1: another baud rate than 115200?"),
}  # fmt: skip


@pytest.mark.parametrize("case", WHY)
def test_why_a_device_gives_no_range(case):
    ranging, data, words = WHY[case]
    feed = feed_of(ranging, TTY)
    hear(feed, [data[at : at + 50] for at in range(0, len(data), 50)], whole=False)
    assert words in feed.why_none(feed.endpoint, 60.0)


MESSAGES = [name for name, source in SOURCES.items() if isinstance(source, MessageSource)]
OPTIONS = {"lines": f", pattern: {PATTERN}"}
READ_BY = {"linktrack_frame2": "linktrack", "lines": ""}
"""The source that reads a device of the stub, where it is not called so; none without options that say where it is."""


@pytest.mark.parametrize("device", STUB_DEVICES)
@pytest.mark.parametrize("name", SOURCES)
def test_the_source_that_reads_what_comes_is_named(device, name):
    """A LinkTrack read as a DWM1001 was called another baud rate."""
    feed, right = feed_of(f"source: {name}{OPTIONS.get(name, '')}", TTY), READ_BY.get(device, device)
    pieces = [STUB_DEVICES[device](3).encode(80.0 + 0.1 * n, 1.0, 5.0 + 0.1 * n) for n in range(60)]
    hear(feed, pieces, whole=False)
    told = feed.why_none(feed.endpoint, 5.0 if name == right else 60.0)
    if name == right:
        assert feed.counts.accepted
    else:
        assert told.endswith(f"; ranges of {right} come there: set ranging.source") is bool(right), told
        assert ("baud" in told) is (not right and name in ("linktrack", "us_d1", *MESSAGES)), told


@pytest.mark.parametrize("name", [name for name in SOURCES if name != "distance_sensor"])
def test_ranges_in_other_messages_are_named_and_the_autopilot_s_own_are_not(name):
    for component, named in ((158, True), (1, False)):
        feed = feed_of(f"source: {name}{OPTIONS.get(name, '')}", TTY)
        hear(feed, [beacon(component, 80.0 + n) for n in range(30)], whole=False)
        told = feed.why_none(feed.endpoint, 60.0)
        assert told.endswith("; ranges of distance_sensor come there: set ranging.source") is named, told
        assert "baud" not in told
        assert named or ("30 MAVLink frames" if name in MESSAGES else "is this the autopilot's port?") in told


@pytest.mark.parametrize("count", range(1, 300, 7))
def test_there_is_always_a_word_for_it(count):
    """Whatever came, and however little: what is counted as an error is to be read."""
    for ranging in (JSON, "source: us_d1", "source: linktrack", "source: ranging_beacon"):
        for byte in (b"\x00", b"\x55", b"\xfe", b"\xfd", b"\n", b" ", b"a"):
            feed = feed_of(ranging)
            hear(feed, [byte * count])
            assert feed.why_none(feed.endpoint, 60.0)


LINE = b"D=12.5\n"
SILENT = {
    "nothing": ([], "nothing more is heard on udpin://127.0.0.1:14560: is the device on"),
    "other lines": ([b"E=3\n"] * 3, "ranging.pattern finds no range in them: 'E=3'"),
    "out of range": ([b"D=99999\n"] * 4, "no range can be used: 4 rejected, most of them out_of_range (4)"),
}


@pytest.mark.parametrize("case", SILENT)
def test_a_range_that_is_overdue_is_told_and_what_came_since_the_last(case):
    """Nine seconds after the sensor was killed the view still said that it listens."""
    pieces, words = SILENT[case]
    feed = feed_of(f"source: lines, pattern: {PATTERN}, max_m: 100")
    hear(feed, [b"D=500\n"] * 30 + [LINE] * 30)
    assert feed.why_none(feed.endpoint, 6.0) == feed.why_none(feed.endpoint, 6.9) == ""
    for n, piece in enumerate(pieces):
        feed.on_bytes(piece, 6.5 + n, whole=True)
    told = feed.why_none(feed.endpoint, 15.6)
    assert told.startswith("no range for 9.6 s: ") and words in told
    feed.on_bytes(LINE, 16.0, whole=True)
    assert feed.why_none(feed.endpoint, 16.1) == ""


def beacon(component: int, range_m: float) -> bytes:
    message = mavlink.MAVLink_distance_sensor_message(0, 10, 60000, round(range_m * 100), 0, 7, 0, 255)
    return bytes(message.pack(mavlink.MAVLink(None, 1, component)))


def test_the_autopilot_s_own_ranges_are_not_called_the_reason_where_there_is_another():
    feed = feed_of("source: distance_sensor, max_m: 100")
    hear(feed, [beacon(1, 3.0)] * 20 + [beacon(158, 500.0)] * 3)
    told = feed.why_none(feed.endpoint, 60.0)
    assert told == "no range can be used: 3 rejected, most of them out_of_range (3), beside 20 of the autopilot's own"


def test_a_radio_that_is_off_is_not_called_a_wrong_source():
    feed = feed_of("source: distance_sensor")
    hear(feed, [beacon(1, 3.0)] * 20)
    told = feed.why_none(feed.endpoint, 60.0)
    assert (
        told == f"only the autopilot's own ranges come on {UDP} (20): is the radio on, and does it send to this place?"
    )


def flight_with(messages: list[bytes]) -> Flight:
    flight = Flight(config(ranging={"max_m": 100.0}))
    for n, message in enumerate(messages, 1):
        flight.receive(message, 0.1 * n)
        flight.tick(0.1 * n)
    return flight


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([], "0"),
        ([beacon(1, 3.0)] * 9, "9 (the autopilot's own)"),
        ([beacon(1, 3.0)] * 9 + [beacon(158, 500.0)] * 4, "13: 9 of the autopilot's own, then out_of_range 4"),
        (
            [beacon(158, 50.0), *[beacon(159, 51.0)] * 5, *[beacon(1, 3.0)] * 9],
            "14: 9 of the autopilot's own, then wrong_source 5",
        ),
    ],
)
def test_a_flight_shows_the_commonest_reason_beside_the_total(messages, words):
    flight = flight_with(messages)
    assert flight.turned_away.words(flight.ranges.echoes) == words


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([], "no range message has come"),
        ([beacon(1, 3.0)] * 9, "only the autopilot's own range finder or its echoes come (9), never the beacon's"),
        (
            [beacon(158, 500.0)] * 4 + [beacon(1, 3.0)],
            "no range can be flown on: 4 rejected, most of them out_of_range",
        ),
        ([beacon(158, 50.0)], "no range for 1.9 s: nothing comes any more"),
        ([beacon(158, 50.0)] * 15, "ranges come, but there is no estimate from them yet"),
        ([beacon(158, 50.0), beacon(158, 500.0)], "no range for 1.9 s: no range can be flown on: 1 rejected"),
    ],
)
def test_a_flight_says_why_no_range_is_used_on_the_vehicle_s_link(messages, words):
    assert flight_with(messages).why_no_range(2.0).startswith(words)


def test_a_flight_on_a_device_says_what_the_device_s_link_does():
    flight = Flight(config(ranging={"source": "lines", "endpoint": UDP, "pattern": "D=(?P<range>[0-9.]+)"}))
    flight.receive(LINE, 1.0, RANGING)
    flight.receive(b"E=3\n", 2.0, RANGING)
    assert "no range for 3.0 s: lines come on" in flight.why_no_range(4.0)


@pytest.mark.parametrize("phase", ["coasting", "range_lost"])
def test_the_live_view_shows_it_in_flight_too(phase):
    app = App(Config(), Clock(), SimpleNamespace(), SimpleNamespace(), Options())
    app.flight.receive(beacon(158, 50.0), 0.1)
    app.flight.computer.phase, app.flight.computer.reason = Phase(phase), "no fresh range"
    assert app._hint(5.0).startswith("no fresh range; no range for 4.9 s: nothing comes any more")
