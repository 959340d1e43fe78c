"""The stub's devices against the vendors' samples, and against the app's decoders: they meet on bytes only."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.ranging import SOURCES, ByteReceiver, Settings, open_receiver, replay
from circumnav_mav.types import RangeSample, Rejected
from sitl_stub.devices import (
    DEVICES,
    LINKTRACK_TAG,
    LightWare,
    Node,
    OmniPreSense,
    UsD1,
    les_line,
    linktrack_node_frame2,
    linktrack_node_frame3,
)
from tests.ranging.golden import BYTE_SOURCES, GOLDENS

SAMPLES = {golden.name: golden.data for golden in GOLDENS}
LINES_OPTIONS = {"pattern": r"range=(?P<range>\S+) rate=(?P<rate>\S+)"}


def test_linktrack_node_frame3_is_the_vendors():
    nodes = [
        Node(1, 0, 2850, 181, 159),
        Node(1, 1, 6051, 182, 160),
        Node(1, 2, 7304, 170, 159),
        Node(1, 3, 5350, 184, 160),
    ]
    made = linktrack_node_frame3(LINKTRACK_TAG, 1, 463352, 7262319, 4954, nodes, reserved=bytes((0, 0, 1, 2)))
    assert made == SAMPLES["linktrack_nodeframe3"]


def test_linktrack_node_frame2_is_the_vendors():
    sample = SAMPLES["linktrack_nodeframe2"]
    nodes = [
        Node(1, 0, 3179, 177, 159, 1926822),
        Node(1, 1, 5548, 180, 161, 1926822),
        Node(1, 2, 6728, 202, 159, 1926822),
        Node(1, 3, 4651, 198, 160, 1926822),
    ]
    pose, reserved = sample[10:102], sample[106:116]
    made = linktrack_node_frame2(LINKTRACK_TAG, 1, 9157, 1926842, 4973, nodes, pose, reserved)
    # The last two bytes of a node are reserved, and the vendor's device fills them: compare all but those and the sum.
    blank = bytearray(sample)
    for end in (132, 145, 158, 171):
        blank[end - 2 : end] = bytes(2)
    assert made[:-1] == bytes(blank[:-1])
    assert made[-1] == sum(made[:-1]) & 0xFF


def test_les_line_is_the_vendors():
    anchors = [
        (0x1151, "5.00,8.00,2.25", 6.48),
        (0x0CA8, "0.00,8.00,2.25", 6.51),
        (0x111C, "5.00,0.00,2.25", 3.18),
        (0x1150, "0.00,0.00,2.25", 3.16),
    ]
    assert les_line(anchors, "le_us=2576 est[2.57,1.98,1.68,100]") == SAMPLES["dwm1001_les"]


def test_lightware_is_the_vendors():
    assert LightWare().encode(98.67, 0.0, 0.0) == SAMPLES["lightware_continuous"]
    assert LightWare().encode(22.48, 0.0, 0.0) == SAMPLES["lightware_sf02"]
    assert LightWare().encode(math.nan, 0.0, 0.0) == SAMPLES["lightware_lost"]


def test_us_d1_is_the_vendors_table():
    assert UsD1(snr=30).encode(12.34, 0.0, 0.0) == SAMPLES["us_d1"]


def test_omnipresense_speed_line_is_the_vendors():
    made = OmniPreSense().encode(6.3, -0.58, 105.135)
    assert made.splitlines()[0] == SAMPLES["omnipresense_speed_then_range"].splitlines()[0]


def source_of(device: str) -> str:
    return device.removesuffix("_frame2")


def receiver_of(device: str) -> ByteReceiver:
    source = source_of(device)
    options = LINES_OPTIONS if source == "lines" else {}
    receiver = open_receiver(source, Settings(options=options, max_age_s=5.0))
    assert isinstance(receiver, ByteReceiver)
    return receiver


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("range_m", "rate_m_s"), [(0.6, -3.21), (6.48, 0.0), (44.44, 2.5), (119.99, -20.0)])
def test_the_app_reads_what_the_device_measured(device, range_m, rate_m_s):
    receiver, source = receiver_of(device), SOURCES[source_of(device)]
    made = DEVICES[device](7)
    first, second = (receiver.feed(made.encode(range_m, rate_m_s, t_s), t_s + 100.0) for t_s in (0.1, 0.3))
    for results, t_s in ((first, 100.1), (second, 100.3)):
        (sample,) = results
        assert isinstance(sample, RangeSample)
        assert sample.range_m == pytest.approx(range_m, abs=source.resolution_m / 2 + 1e-9)
        assert sample.t_s == pytest.approx(t_s, abs=1.1e-3)
        assert sample.beacon_id in (7, None)
        if source.has_rate and device != "lines":
            assert sample.range_rate_m_s == pytest.approx(rate_m_s, abs=0.005)


NO_RANGE = [math.nan, math.inf]
NO_RANGE_IN_A_FORMAT = [-1.0, 0.0, 1e9]
CARRY_ANY_NUMBER = ("lines", "replay")


@pytest.mark.parametrize(
    ("device", "range_m"),
    [(d, r) for d in DEVICES for r in (NO_RANGE if d in CARRY_ANY_NUMBER else NO_RANGE + NO_RANGE_IN_A_FORMAT)],
)
def test_a_range_that_there_is_not_is_never_read(device, range_m):
    results = receiver_of(device).feed(DEVICES[device](7).encode(range_m, 0.0, 1.0), 101.0)
    assert all(isinstance(result, Rejected) and str(result.reason) == "no_reading" for result in results)


def test_every_source_of_bytes_has_its_device():
    assert {source_of(device) for device in DEVICES} == {source.name for source in BYTE_SOURCES}


@pytest.mark.parametrize(
    ("device", "beacon_id"), [("linktrack", 256), ("linktrack_frame2", -1), ("dwm1001_les", 65536)]
)
def test_an_id_that_the_device_cannot_have_is_refused_in_words(device, beacon_id):
    with pytest.raises(ValueError, match=f"not {beacon_id}"):
        DEVICES[device](beacon_id)


@pytest.mark.parametrize(
    ("cell", "beacon_id"), [("3", 3), ("3.0", 3), ("", None), ("3.5", "refused"), ("x", "refused")]
)
def test_a_replayed_beacon_may_be_written_as_a_table_writes_it(cell, beacon_id):
    """Spreadsheets put a byte order mark before the header, and a point into whole numbers beside empty cells."""
    assert replay.parse("\ufeff" + replay.HEADER, 0.0) == []
    (read,) = replay.parse(f"1.0,50.0,,,{cell}", 0.0)
    assert beacon_id == ("refused" if isinstance(read, Rejected) else read.beacon_id)
