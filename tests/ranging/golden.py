"""The golden samples of tests/data/ranging_golden.json, each with the vendor's document that it comes from."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from circumnav_mav.ranging import SOURCES, ByteSource
from circumnav_mav.ranging.plug import CARRIED, ByteDecoder, Reading

FILE = Path(__file__).parent.parent / "data" / "ranging_golden.json"


@dataclass(frozen=True)
class Golden:
    name: str
    source: ByteSource
    data: bytes
    options: dict[str, Any]
    expect: list[dict[str, Any]]
    rejected: list[str]

    def decoder(self) -> ByteDecoder:
        return self.source.decoder(self.options)


def _load() -> list[Golden]:
    goldens = []
    for entry in json.loads(FILE.read_text()):
        assert entry["from"], f"{entry['name']} does not name its source"
        source = SOURCES[entry["source"]]
        assert isinstance(source, ByteSource)
        data = bytes.fromhex(entry["hex"]) if "hex" in entry else entry["text"].encode()
        goldens.append(
            Golden(entry["name"], source, data, entry.get("options", {}), entry["expect"], entry.get("rejected", []))
        )
    return goldens


GOLDENS = _load()
BYTE_SOURCES = [source for source in SOURCES.values() if isinstance(source, ByteSource)]


def present(*readings: Reading) -> set[str]:
    """Return which of CARRIED the readings have."""
    values = {name: [getattr(reading, name) for reading in readings] for name in CARRIED}
    return {name for name, all_ in values.items() if any(v is not None and not math.isnan(v) for v in all_)}


def check(readings: list[Reading], expect: list[dict[str, Any]]) -> None:
    """Every field that a sample names must be read, and no field that it does not name."""
    assert len(readings) == len(expect), readings
    for reading, fields in zip(readings, expect, strict=True):
        for name in Reading.__slots__:
            value, wanted = getattr(reading, name), fields.get(name)
            if wanted is None:
                assert value is None or math.isnan(value), (name, value)
            else:
                assert abs(value - wanted) < 1e-9, (name, value, wanted)
