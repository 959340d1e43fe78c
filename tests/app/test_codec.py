"""The frame splitter and decoder against pymavlink's own packer: whole, byte by byte, with rubbish around, fuzzed."""

from __future__ import annotations

import math
import os
import random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.mavlink.codec import Decoder, Packer, Splitter
from circumnav_mav.mavlink.dialect import by_name, layout

NAMES = ["HEARTBEAT", "ATTITUDE", "DISTANCE_SENSOR", "COMMAND_ACK", "CURRENT_MODE", "RANGING_BEACON", "STATUSTEXT"]


def frames(seed: int, *, version_1: bool = False) -> list[bytes]:
    """Return one frame of each kind, packed by pymavlink, with random fields."""
    draw = random.Random(seed)
    mav = mavlink.MAVLink(None, 7, 1)
    made = []
    for name in NAMES:
        cls = mavlink.mavlink_map[getattr(mavlink, f"MAVLINK_MSG_ID_{name}")]
        if version_1 and cls.id > 255:
            continue
        made.append(bytes(cls(*(value(draw, cls, i) for i in range(len(cls.fieldnames)))).pack(mav, version_1)))
    return made


def value(draw: random.Random, cls, i: int):
    kind = cls.fieldtypes[i]
    count = cls.array_lengths[cls.ordered_fieldnames.index(cls.fieldnames[i])]
    one = {"float": lambda: draw.uniform(-9, 9), "char": lambda: b"text"}.get(kind, lambda: draw.randrange(100))
    return one() if count == 0 or kind == "char" else [one() for _ in range(count)]


def decoded(chunks: list[bytes], *, whole: bool) -> list:
    splitter, decoder = Splitter(), Decoder(NAMES)
    return [decoder.decode(frame) for chunk in chunks for frame in splitter.feed(chunk, whole=whole)]


@pytest.mark.parametrize("version_1", [False, True])
def test_fields_are_those_that_pymavlink_packed(version_1):
    for raw in frames(3, version_1=version_1):
        (message,) = decoded([raw], whole=True)
        theirs = mavlink.MAVLink(None).decode(bytearray(raw))
        assert (message.sysid, message.compid, message.name) == (7, 1, theirs.get_type())
        for name in theirs.get_fieldnames():
            ours, other = getattr(message.fields, name), getattr(theirs, name)
            if isinstance(ours, bytes):
                ours, other = ours.split(b"\0")[0].decode(), str(other)
            assert list(ours) == list(other) if isinstance(ours, tuple) else ours == other


def test_a_stream_may_come_byte_by_byte():
    stream = b"".join(frames(4))
    assert decoded([bytes([b]) for b in stream], whole=False) == decoded([stream], whole=False)


def test_rubbish_around_frames_costs_only_itself():
    draw = random.Random(5)
    good = frames(5)
    stream = b"".join(bytes(draw.randrange(256) for _ in range(draw.randrange(40))) + raw for raw in good)
    found = decoded([stream + bytes(600)], whole=False)
    assert found == decoded([b"".join(good)], whole=False)


def test_a_damaged_frame_is_dropped_counted_and_the_next_one_found():
    good = frames(6)
    damaged = bytearray(good[1])
    damaged[12] ^= 0x40
    splitter = Splitter()
    found = splitter.feed(good[0] + bytes(damaged) + good[2], whole=True)
    assert [f.raw for f in found] == [good[0], good[2]]
    assert splitter.counts.bad_crc == 1


def test_a_datagram_that_ends_in_half_a_frame_keeps_nothing_back():
    good = frames(7)
    splitter = Splitter()
    assert len(splitter.feed(good[0] + good[1][:-3], whole=True)) == 1
    assert [f.raw for f in splitter.feed(good[2], whole=True)] == [good[2]]


def test_an_unknown_message_is_tolerated_and_counted():
    unknown = b"\xfd\x02\x00\x00\x05\x07\x01\x55\xcc\x00\x01\x02\xaa\xbb"
    good = frames(8)
    splitter = Splitter()
    found = splitter.feed(good[0] + unknown + good[1], whole=True)
    assert [f.checked for f in found] == [True, False, True]
    assert splitter.counts.unknown == 1
    assert Decoder(NAMES).decode(found[1]) is None


def test_frames_that_nobody_reads_are_passed_on_unchecked_and_never_swallow_a_good_one():
    good = frames(12)
    wrong_length = bytearray(good[1])
    wrong_length[1] += 9  # an ATTITUDE that claims a part of the frame behind it
    splitter = Splitter(["HEARTBEAT"])
    found = splitter.feed(good[0] + good[2] + bytes(wrong_length) + good[0], whole=True)
    assert [(f.raw, f.checked) for f in found] == [(good[0], True), (good[2], False), (good[0], True)]


def test_a_frame_with_unknown_incompatibility_flags_is_not_understood():
    raw = bytearray(frames(9)[0])
    raw[2] = 0x80
    assert decoded([bytes(raw)], whole=True) == []


def test_only_subscribed_messages_are_decoded():
    splitter, decoder = Splitter(), Decoder(["ATTITUDE"])
    found = [decoder.decode(f) for f in splitter.feed(b"".join(frames(10)), whole=True)]
    assert [m.name for m in found if m] == ["ATTITUDE"]
    assert decoder.decoded == 1


@pytest.mark.parametrize(
    "name", ["SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG", "HEARTBEAT", "TIMESYNC", "STATUSTEXT"]
)
def test_what_we_pack_pymavlink_reads(name):
    draw = random.Random(name)
    shape = by_name(name)
    cls = mavlink.mavlink_map[shape.msgid]
    fields = {n: value(draw, cls, cls.fieldnames.index(n)) for n in shape.fields}
    packer = Packer(1, 191)
    first, second = packer.pack(name, **fields), packer.pack(name, **fields)
    theirs = mavlink.MAVLink(None).decode(bytearray(second))
    assert (theirs.get_srcSystem(), theirs.get_srcComponent(), theirs.get_seq()) == (1, 191, 1)
    assert first != second
    for n, ours in fields.items():
        other = getattr(theirs, n)
        if isinstance(ours, bytes):
            assert other == ours.decode()
        elif isinstance(ours, float):
            assert other == pytest.approx(ours, rel=1e-6)
        else:
            assert other == ours


def test_a_missing_or_unknown_field_is_an_error():
    with pytest.raises(KeyError, match="autopilot"):
        Packer(1, 191).pack("HEARTBEAT", type=1)


def test_every_message_of_the_dialect_has_a_layout():
    for msgid in mavlink.mavlink_map:
        shape = layout(msgid)
        assert shape is not None
        assert len(shape.unpack(b"", 0, 0)) == len(shape.fields)


def fuzz(cases: int, seed: int) -> None:
    """Random bytes and mutated frames: no exception, and what comes out is whole and right."""
    draw = random.Random(seed)
    seeds = frames(seed) + frames(seed, version_1=True)
    decoder = Decoder(NAMES)
    for case in range(cases):
        splitter = Splitter()
        data = bytearray(draw.choice(seeds) + draw.choice(seeds)) if case % 4 else bytearray(draw.randbytes(60))
        for _ in range(draw.randrange(4)):
            data[draw.randrange(len(data))] = draw.choice((0xFD, 0xFE, draw.randrange(256)))
        cut = draw.randrange(len(data) + 1)
        try:
            for frame in splitter.feed(bytes(data[:cut]), whole=False) + splitter.feed(bytes(data[cut:]), whole=True):
                message = decoder.decode(frame)
                assert message is None or len(message.fields) > 0
        except Exception:  # noqa: BLE001 - any at all is the fault looked for
            pytest.fail(f"seed {seed}, case {case}: {bytes(data).hex()} cut at {cut}")


def test_fuzz_a_little():
    fuzz(3_000, 11)


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_fuzz_a_lot(part):
    fuzz(int(250_000 * float(os.environ.get("SOAK_SHARE", "1"))), int(os.environ.get("SOAK_SEED", "1")) * 10 + part)


def test_nan_travels_as_nan():
    raw = mavlink.MAVLink_attitude_message(1, math.nan, 0, 0, 0, 0, 0).pack(mavlink.MAVLink(None))
    (message,) = decoded([raw], whole=True)
    assert math.isnan(message.fields.roll)
