"""What holds for every source of MAVLink messages, run on each registered one unasked, through real frames."""

from __future__ import annotations

import math
import os
import random
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.ranging import SOURCES, MessageReceiver, MessageSource, Settings, open_receiver
from circumnav_mav.ranging.plug import Reason
from circumnav_mav.types import RangeSample, Rejected
from tests.ranging.golden import present

SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))
SENDER = (1, 158)

MESSAGE_SOURCES = [source for source in SOURCES.values() if isinstance(source, MessageSource)]
sources = pytest.mark.parametrize("source", MESSAGE_SOURCES, ids=lambda source: source.name)

BITS = {"uint8_t": 8, "uint16_t": 16, "uint32_t": 32, "uint64_t": 64, "int8_t": 8, "int16_t": 16, "int32_t": 32}

GOOD: dict[str, dict[str, Any]] = {
    "distance_sensor": {"current_distance": 1234, "max_distance": 4000, "orientation": 0},
    "ranging_beacon": {"range": 12_340, "beacon_id": 3, "range_accuracy": 40, "time_usec": 1_000_000, "sequence": 9},
    "landing_target": {"distance": 12.34, "target_num": 3, "time_usec": 1_000_000},
    "rangefinder": {"distance": 12.34},
}
"""One good message of each, the fields that are not named being 0. A new source adds its own."""


def through_the_wire(message_id: int, fields: dict[str, Any]) -> Any:
    cls = mavlink.mavlink_map[message_id]
    blank = {name: [0.0] * 4 if name in ("quaternion", "q") else 0 for name in cls.fieldnames}
    packed = cls(**(blank | fields)).pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=158))
    return mavlink.MAVLink(None).decode(bytearray(packed))


def receiver(source: MessageSource, **settings: Any) -> MessageReceiver:
    opened = open_receiver(source.name, Settings(**settings))
    assert isinstance(opened, MessageReceiver)
    return opened


def good(source: MessageSource, **changes: Any) -> Any:
    return through_the_wire(source.message_ids[0], GOOD[source.name] | changes)


@sources
@pytest.mark.parametrize("sender", [(1, 1), (42, 1), (255, 0), (255, 190), (1, 158)])
def test_any_sender_that_is_named_is_believed_and_nobody_else(source, sender):
    for autopilot in (None, (1, 1), (7, 1), sender):
        opened = receiver(source, from_=sender)
        opened.autopilot = autopilot
        assert isinstance(opened.on_message(*sender, good(source), 7.0), RangeSample)
        for other in {(1, 1), (7, 1), (1, 191)} - {sender}:
            rejected = opened.on_message(*other, good(source), 8.0)
            assert isinstance(rejected, Rejected) and rejected.reason == Reason.WRONG_SOURCE


@sources
def test_reads_a_good_message(source):
    sample = receiver(source).on_message(*SENDER, good(source), 7.0)
    assert isinstance(sample, RangeSample)
    assert sample.range_m == pytest.approx(12.34, abs=1e-5)
    assert sample.t_s == 7.0


@sources
def test_nothing_filled_in_is_no_range(source):
    result = receiver(source).on_message(*SENDER, through_the_wire(source.message_ids[0], {}), 7.0)
    assert isinstance(result, Rejected)


@sources
def test_the_autopilots_own_is_never_flown_on(source):
    ranging = receiver(source, from_=None)
    for sender in ((1, 1), (9, 1)):
        result = ranging.on_message(*sender, good(source), 7.0)
        assert isinstance(result, Rejected)
        assert str(result.reason) == "wrong_source"


@sources
def test_subscribes_to_messages_that_exist(source):
    assert all(message_id in mavlink.mavlink_map for message_id in source.message_ids)


@sources
def test_it_carries_what_it_says_and_no_more(source):
    """With every field of the message filled in. `check` tells from it which keys do nothing."""
    cls = mavlink.mavlink_map[source.message_ids[0]]
    filled = {
        name: 7 for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True) if kind in BITS and name != "type"
    }
    fields = through_the_wire(source.message_ids[0], filled | GOOD[source.name])
    assert present(source.read(fields, 7.0)) == source.carries
    of_beacon = {"ranging_beacon": "beacon_id", "landing_target": "target_num"}.get(source.name)
    if of_beacon:
        assert source.most_beacon_id == 2 ** BITS[cls.fieldtypes[cls.fieldnames.index(of_beacon)]] - 1


def test_ranging_beacon_fields():
    source = SOURCES["ranging_beacon"]
    assert isinstance(source, MessageSource)
    sample = receiver(source).on_message(*SENDER, good(source), 7.0)
    assert isinstance(sample, RangeSample)
    assert sample.beacon_id == 3
    assert sample.sigma_m == pytest.approx(0.04)
    unknown = 0xFFFFFFFF
    assert str(receiver(source).on_message(*SENDER, good(source, range=unknown), 7.0).reason) == "no_reading"
    blind = receiver(source).on_message(*SENDER, good(source, range_accuracy=unknown), 7.0)
    assert math.isnan(blind.sigma_m)
    poor = good(source, status=1)
    assert isinstance(receiver(source).on_message(*SENDER, poor, 7.0), RangeSample)
    assert str(receiver(source, min_quality_pct=60.0).on_message(*SENDER, poor, 7.0).reason) == "invalid_quality"


def test_several_beacons_in_one_stream_are_told_apart():
    source = SOURCES["ranging_beacon"]
    assert isinstance(source, MessageSource)
    ranging = receiver(source, beacon_id=3)
    ranges_mm = {3: 50_000, 4: 80_000, 5: 20_000}
    results = [
        ranging.on_message(
            *SENDER,
            good(source, beacon_id=beacon, range=mm + n % 7, time_usec=10**6 + n * 10**5, sequence=n % 256),
            7.0 + 0.1 * n,
        )
        for n in range(300)
        for beacon, mm in ranges_mm.items()
    ]
    samples = [r for r in results if isinstance(r, RangeSample)]
    assert len(samples) == 300
    assert all(s.beacon_id == 3 and abs(s.range_m - 50.0) < 0.01 for s in samples)
    assert ranging.counts.rejected["wrong_beacon"] == 600


def test_sequence_numbers_that_go_back_are_old_even_without_stamps():
    source = SOURCES["ranging_beacon"]
    assert isinstance(source, MessageSource)
    ranging = receiver(source)
    numbers = [250, 251, 255, 0, 3, 2, 4]
    results = [
        ranging.on_message(*SENDER, good(source, time_usec=0, sequence=n, range=50_000 + i), 7.0 + 0.1 * i)
        for i, n in enumerate(numbers)
    ]
    assert [isinstance(r, RangeSample) for r in results] == [True, True, True, True, True, False, True]
    assert str(results[5].reason) == "time_backwards"


def test_a_sender_that_leaves_the_sequence_at_zero_is_believed():
    source = SOURCES["ranging_beacon"]
    assert isinstance(source, MessageSource)
    ranging = receiver(source)
    for i in range(20):
        message = good(source, time_usec=10**6 + i * 10**5, sequence=0)
        assert isinstance(ranging.on_message(*SENDER, message, 7.0 + 0.1 * i), RangeSample)


def random_field(kind: str, rng: random.Random) -> Any:
    if kind == "float":
        return rng.choice((0.0, math.nan, math.inf, -math.inf, 12.3, struct.unpack("<f", rng.randbytes(4))[0]))
    bits = BITS[kind]
    least = -(1 << bits - 1) if kind.startswith("int") else 0
    return rng.choice((least, least + (1 << bits) - 1, 0, 1, 25, rng.randrange(least, least + (1 << bits))))


def fuzz(source: MessageSource, cases: int, seed: int) -> None:
    rng = random.Random(f"{source.name} {seed}")
    cls = mavlink.mavlink_map[source.message_ids[0]]
    ranging = receiver(source)
    now_s = 0.0
    for case in range(cases):
        now_s += rng.random() * 0.2
        fields = type("Fields", (), {})()
        for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
            setattr(fields, name, random_field(kind, rng))
        for name, value in GOOD[source.name].items():
            if rng.random() < 0.5:
                setattr(fields, name, value)
        result = ranging.on_message(*rng.choice((SENDER, (1, 1), (7, 3))), fields, now_s)
        assert isinstance(result, RangeSample | Rejected)
        if isinstance(result, RangeSample):
            assert math.isfinite(result.range_m) and result.range_m > 0.0, (seed, case)
            assert now_s - 1.0 <= result.t_s <= now_s, (seed, case)
            assert math.isnan(result.sigma_m) or 0.0 < result.sigma_m < math.inf, (seed, case)
        else:
            assert Reason(result.reason)


@sources
def test_fuzz(source):
    fuzz(source, 1_000, seed=0)


@pytest.mark.soak
@sources
def test_fuzz_long(source):
    fuzz(source, int(100_000 * SHARE) + 1, SEED)


def test_who_is_heard_is_kept_to_choose_from_and_bounded():
    source = SOURCES["ranging_beacon"]
    assert isinstance(source, MessageSource)
    ranging = receiver(source, beacon_id=4)
    for beacon, mm in ((3, 50_000), (4, 80_000), (3, 51_000)):
        ranging.on_message(*SENDER, good(source, beacon_id=beacon, range=mm, time_usec=0), 7.0)
    assert ranging.heard == {(SENDER, None, 3): 51.0, (SENDER, None, 4): 80.0}
    assert ranging.flown == (SENDER, None, 4)
    for beacon in range(1000):
        ranging.on_message(*SENDER, good(source, beacon_id=beacon), 8.0)
    assert len(ranging.heard) <= 64


@pytest.mark.parametrize("name", ["landing_target", "rangefinder"])
@pytest.mark.parametrize("absurd_m", [1e30, 3.4e38, 10_001.0])
def test_a_finite_number_that_is_no_range_is_counted_and_not_flown_on(name, absurd_m):
    ranging = receiver(SOURCES[name])
    result = ranging.on_message(*SENDER, good(SOURCES[name], distance=absurd_m), 7.0)
    assert isinstance(result, Rejected)
    assert result.reason == Reason.OUT_OF_RANGE
    assert ranging.counts.rejected == {Reason.OUT_OF_RANGE: 1}
