"""The stub's own codec against pymavlink, and rubbish of every kind into a flying vehicle."""

from __future__ import annotations

import ast
import math
import os
import random
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig, wire
from sitl_stub.protocol import HANDLERS

SHARE, SEED = float(os.environ.get("SOAK_SHARE", "1")), int(os.environ.get("SOAK_SEED", "1"))
SIZES = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}
FLOATS = (0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-40, 0.3, 30.0, -9000.0)


def values_of(message: type[Any], draw: random.Random) -> list[Any]:
    """Return field values of every kind, the odd ones often."""
    values: list[Any] = []
    letters = dict(zip(message.ordered_fieldnames, wire_letters(message), strict=True))
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        if kind == "char":
            values.append(bytes(draw.choice(b"ABC_\0\xff") for _ in range(lengths[name] or 1)))
            continue
        drawn = [one_value(letters[name], draw) for _ in range(lengths[name] or 1)]
        if lengths[name]:
            pass
        elif name == "target_system":
            drawn = [draw.choice((0, 1, 1, 1, 99))]
        elif name == "target_component":
            drawn = [draw.choice((0, 1, 1, 1, 191))]
        elif name == "command":
            drawn = [draw.choice((16, 20, 21, 22, 92, 176, 185, 246, 300, 400, 410, 510, 511, 512, 519, 520, 65535))]
        elif name == "param_id":
            drawn = [draw.choice((b"MPC_Z_P", b"COM_OBL_RC_ACT"))]
        values.append(drawn if lengths[name] else drawn[0])
    return values


def wire_letters(message: type[Any]) -> list[str]:
    found, digits = [], ""
    for letter in message.unpacker.format[1:]:
        if letter.isdigit():
            digits += letter
        else:
            found.append(letter)
    return found


def one_value(letter: str, draw: random.Random) -> Any:
    if letter in "fd":
        return draw.choice(FLOATS) if draw.random() < 0.5 else draw.uniform(-100.0, 100.0)
    if letter == "c" or letter == "s":
        return b"x"
    bits = SIZES[letter]
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if letter.islower() else (0, (1 << bits) - 1)
    return draw.choice((low, high, 0, 1, 6)) if draw.random() < 0.6 else draw.randint(low, high)


def known() -> list[type[Any]]:
    return [mavlink.mavlink_map[i] for i in sorted(mavlink.mavlink_map) if wire.spec(i) is not None and i >= 0]


@pytest.mark.parametrize("seed", range(3))
def test_every_message_packs_and_unpacks_as_in_pymavlink(seed: int) -> None:
    draw = random.Random(f"{SEED}:{seed}")
    mav = mavlink.MAVLink(None, 42, 7)
    for message in known():
        values = values_of(message, draw)
        theirs = message(*values).pack(mav)
        ours = wire.frame(
            message.id if isinstance(message.id, int) else 0, wire.pack(message.id, values), mav.seq, 42, 7
        )
        assert ours == theirs, message.msgname
        assert wire.whole(theirs)
        again = wire.decode(theirs)
        assert (again.sysid, again.compid, again.msgid) == (42, 7, message.id)
        assert wire.pack(message.id, again.fields) == wire.pack(message.id, values)


def rubbish(draw: random.Random, mav: Any, handled: list[type[Any]]) -> bytes:
    """Return a frame that the stub handles with wild values, a spoilt one, or noise."""
    kind = draw.random()
    if kind < 0.1:
        return draw.randbytes(draw.randrange(1, 300))
    message = draw.choice(handled)
    frame = bytearray(message(*values_of(message, draw)).pack(mav))
    mav.seq = (mav.seq + 1) % 256
    if kind < 0.25:
        for _ in range(draw.randrange(1, 4)):
            frame[draw.randrange(len(frame))] = draw.randrange(256)
    elif kind < 0.3:
        del frame[draw.randrange(len(frame)) :]
    return bytes(frame)


def bombard(airframe: str, seed: int, cases: int) -> Stub:
    """Throw rubbish at a flying vehicle; it must go on flying through time with finite figures."""
    draw = random.Random(seed)
    stub = Stub(StubConfig(airframe=airframe, seed=seed, start_height_m=50.0, radio=False))
    mav = mavlink.MAVLink(None, 1, 191)
    handled = [mavlink.mavlink_map[i] for i in HANDLERS]
    for case in range(cases):
        stub.receive(draw.choice(("offboard", "gcs")), rubbish(draw, mav, handled))
        if case % 5 == 0:
            stub.advance(stub.now_s + draw.choice((0.01, 0.02, 0.1)))
            stub.take("offboard")
            stub.take("gcs")
    truth = stub.truth()
    assert all(math.isfinite(v) for v in (truth.east_m, truth.north_m, truth.height_m, truth.turn_rate_rad_s))
    return stub


@pytest.mark.parametrize("airframe", ["multirotor", "fixed_wing"])
@pytest.mark.parametrize("seed", range(4))
def test_rubbish_never_stops_the_vehicle(airframe: str, seed: int) -> None:
    bombard(airframe, 1000 * SEED + seed, 1500)


@pytest.mark.soak
@pytest.mark.parametrize("airframe", ["multirotor", "fixed_wing"])
def test_a_lot_of_rubbish_never_stops_the_vehicle(airframe: str) -> None:
    for round_ in range(max(1, round(50 * SHARE))):
        bombard(airframe, 100_000 * SEED + round_, 5000)


def test_what_the_stub_imports_is_declared() -> None:
    root = Path(__file__).parents[2]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split("[^a-z0-9_-]", line.lower())[0] for line in project["dependencies"]}
    imported: set[str] = set()
    for path in (root / "sitl_stub").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
    foreign = imported - sys.stdlib_module_names - {"sitl_stub", "pytest"}  # sitl_stub.pytest is for those who have it
    assert foreign == {"pymavlink", "fastcrc"}
    assert foreign <= declared
