"""What the feed makes of a link's bytes, whoever writes them."""

from __future__ import annotations

import json

import pytest

from circumnav_mav.config_file import parse
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.types import RangeSample

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
