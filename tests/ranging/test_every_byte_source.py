"""What holds for every source of bytes, run on each registered one unasked."""

from __future__ import annotations

import math
import os
import random
from typing import Any

import pytest

from circumnav_mav.config_file import parse
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.ranging import ByteReceiver, Settings, carried, open_receiver
from circumnav_mav.ranging.plug import Reading, Reason
from circumnav_mav.types import RangeSample, Rejected
from tests.ranging.golden import BYTE_SOURCES, GOLDENS, Golden, check, present

SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))
HELD_LIMIT_BYTES = 4096

golden_samples = pytest.mark.parametrize("golden", GOLDENS, ids=lambda golden: golden.name)
sources = pytest.mark.parametrize("source", BYTE_SOURCES, ids=lambda source: source.name)


def split(results: list[Reading | Rejected]) -> tuple[list[Reading], list[Rejected]]:
    readings = [r for r in results if isinstance(r, Reading)]
    return readings, [r for r in results if isinstance(r, Rejected)]


def chunks(data: bytes, rng: random.Random) -> list[bytes]:
    pieces = []
    at = 0
    while at < len(data):
        size = rng.choice((0, 1, 1, 2, 3, 7, 20, 64, 500))
        pieces.append(data[at : at + size])
        at += size
    return pieces


def rubbish(rng: random.Random, most: int) -> bytes:
    """Bytes of all kinds: random ones, printable ones, and those that formats begin, separate and end with."""
    alphabet = rng.choice(
        (range(256), range(32, 127), b"\x55\x04\x05\xfe\x02\r\n{}[]=.,:0123456789\"'eE+-", b"\x00\xff")
    )
    return bytes(rng.choices(alphabet, k=rng.randrange(most)))


def held_bytes(thing: Any, seen: set[int] | None = None) -> int:
    """How many bytes a decoder keeps between two feeds, through its attributes and closures."""
    seen = set() if seen is None else seen
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    if isinstance(thing, bytes | bytearray | str):
        return len(thing)
    inside: list[Any] = list(getattr(thing, "__dict__", {}).values())
    inside += [cell.cell_contents for cell in getattr(thing, "__closure__", None) or ()]
    if isinstance(thing, list | tuple | set | dict) or hasattr(thing, "popleft"):
        inside += list(thing.values() if isinstance(thing, dict) else thing)
    return sum(held_bytes(part, seen) for part in inside)


@sources
def test_has_a_golden_sample(source):
    assert any(golden.source is source and golden.expect for golden in GOLDENS)


@sources
def test_it_carries_what_it_says_and_no_more(source):
    """As the vendors' samples show. `check` tells from it which keys do nothing."""
    samples = [golden for golden in GOLDENS if golden.source is source]
    assert set().union(*(present(*split(g.decoder().feed(g.data, 5.0))[0]) for g in samples)) == source.carries
    for golden in samples:
        assert present(*split(golden.decoder().feed(golden.data, 5.0))[0]) <= carried(source, golden.options)


@golden_samples
def test_golden_whole(golden: Golden):
    readings, rejected = split(golden.decoder().feed(golden.data, 5.0))
    check(readings, golden.expect)
    assert [str(r.reason) for r in rejected] == golden.rejected


@golden_samples
def test_golden_byte_by_byte(golden: Golden):
    decoder = golden.decoder()
    readings, rejected = split([r for byte in golden.data for r in decoder.feed(bytes((byte,)), 5.0)])
    check(readings, golden.expect)
    assert [str(r.reason) for r in rejected] == golden.rejected


@golden_samples
def test_golden_follows_rubbish(golden: Golden):
    """Whatever came before: of four samples in a row the last is read, since rubbish may swallow the first."""
    for seed in range(50):
        rng = random.Random(seed)
        data = rubbish(rng, 700) + b"\n" + golden.data * 4
        decoder = golden.decoder()
        readings, _ = split([r for piece in chunks(data, rng) for r in decoder.feed(piece, 5.0)])
        check(readings[-len(golden.expect) :] if golden.expect else [], golden.expect)


@golden_samples
def test_golden_with_a_byte_lost_or_changed(golden: Golden):
    """A damaged report costs itself only: the one after it is read whole."""
    for at in range(len(golden.data)):
        for damaged in (
            golden.data[:at] + golden.data[at + 1 :],
            golden.data[:at] + bytes((golden.data[at] ^ 0x41,)) + golden.data[at + 1 :],
        ):
            decoder = golden.decoder()
            readings, _ = split(decoder.feed(damaged + golden.data * 3, 5.0))
            check(readings[-len(golden.expect) :] if golden.expect else [], golden.expect)


@golden_samples
def test_chunks_make_no_difference(golden: Golden):
    for seed in range(50):
        rng = random.Random(seed)
        data = b"".join(rubbish(rng, 400) + golden.data for _ in range(3)) + rubbish(rng, 2000)
        whole = golden.decoder().feed(data, 5.0)
        decoder = golden.decoder()
        assert repr([r for piece in chunks(data, rng) for r in decoder.feed(piece, 5.0)]) == repr(whole), seed


@sources
def test_unknown_options_are_named(source):
    with pytest.raises(ValueError, match=r"ranging\.no_such_thing is unknown"):
        open_receiver(source.name, Settings(options={"no_such_thing": 1}))


@sources
def test_says_what_it_is(source):
    assert source.summary
    assert source.baud > 0
    assert source.resolution_m >= 0.0
    assert all(source.options.values())


DELIVERED_BAUD = {
    "linktrack": 921_600,  # Nooploop, LinkTrack user manual
    "dwm1001_les": 115_200,  # LEAPS, PANS PRO RTLS, integration guide, UART interface
    "lightware": 115_200,  # SF11 manual; SF02 and SF10: 9600
    "us_d1": 115_200,  # Ainstein, US-D1 user manual D00.02.01
    "omnipresense": 19_200,  # OPS243 user manual UM-003-A, p. 13
}


@pytest.mark.parametrize("name", DELIVERED_BAUD)
def test_a_device_is_opened_at_the_baud_rate_it_is_delivered_with(name):
    feed = RangeFeed(parse(f"ranging: {{source: {name}, endpoint: '/dev/ttyUSB0'}}").ranging)
    assert feed.baud == DELIVERED_BAUD[name]


def mutate(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randrange(1, 5)):
        at = rng.randrange(len(changed) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            changed[at:at] = rubbish(rng, 12)
        elif kind == 1:
            del changed[at : at + rng.randrange(1, 12)]
        elif kind == 2 and at < len(changed):
            changed[at] ^= 1 << rng.randrange(8)
        else:
            changed[at:at] = changed[: rng.randrange(len(changed) + 1)]
    return bytes(changed[:4000])


def fuzz(golden: Golden, cases: int, seed: int) -> None:
    """Random bytes and mutated samples through decoder and receiver: samples or rejections, and bounded memory."""
    rng = random.Random(f"{golden.name} {seed}")
    receiver = open_receiver(golden.source.name, Settings(options=golden.options))
    assert isinstance(receiver, ByteReceiver)
    now_s = 0.0
    for case in range(cases):
        now_s += rng.random() * 0.2
        data = mutate(golden.data, rng) if rng.random() < 0.7 else rubbish(rng, 60)
        for result in receiver.feed(data, now_s):
            assert isinstance(result, RangeSample | Rejected)
            if isinstance(result, RangeSample):
                assert math.isfinite(result.range_m) and result.range_m > 0.0, (seed, case)
                assert math.isfinite(result.t_s) and now_s - 1.0 <= result.t_s <= now_s, (seed, case)
                assert not math.isinf(result.range_rate_m_s) and not math.isinf(result.sigma_m), (seed, case)
            else:
                assert Reason(result.reason)
        if case % 100 == 0:
            assert held_bytes(receiver) < HELD_LIMIT_BYTES, (seed, case)


@golden_samples
def test_fuzz(golden: Golden):
    fuzz(golden, 1_000, seed=0)


@pytest.mark.soak
@golden_samples
def test_fuzz_long(golden: Golden):
    """A million cases across the sources."""
    fuzz(golden, int(1_000_000 * SHARE / len(GOLDENS)) + 1, SEED)
