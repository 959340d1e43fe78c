"""Recorded flights of the real PX4 v1.16: how an extract of them is made, and read.

The extract (tests/stub/data, < 300 kB) holds for each capture the companion's frames as they were (without its TIMESYNC
answers, which change nothing) and what PX4 showed: heartbeats, acknowledgements, texts, landed states, message counts,
and its motion at 10 Hz (50 Hz around steps). `python -m tests.stub.capture ../shared/captures` makes it anew.
"""

from __future__ import annotations

import json
import lzma
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

DATA = Path(__file__).parent / "data"
CAPTURES = {"quadx": "px4_v1.16.0_quadx_kdv015_offboard.tlog", "airplane": "px4_v1.16.0_airplane_offboard.tlog"}
FINE_S = {"quadx": (49.5, 53.5), "airplane": (71.5, 74.0)}
COUNT_S = (20.0, 170.0)  # message counts are taken within; ODOMETRY is switched off before
TIMESYNC = 111


@dataclass(frozen=True, slots=True)
class Flight:
    """One capture's extract. Times in seconds since its first frame."""

    name: str
    system_id: int
    sent: list[tuple[float, bytes]]
    heartbeats: list[list[float]]  # t, custom_mode, base_mode, system_status
    acks: list[list[float]]  # t, command, result
    texts: list[tuple[float, str]]
    landed: list[list[float]]  # t, EXTENDED_SYS_STATE.landed_state: every change
    sensors: list[str]
    rates_hz: dict[int, float]
    motion: list[list[float]]  # t, x, y, z, vx, vy, vz, roll, pitch, yaw


def frames(path: Path) -> Iterator[tuple[float, bytes]]:
    """Yield (time [s since the first], frame) of a .tlog of MAVLink 2 frames."""
    data = path.read_bytes()
    at, first = 0, None
    while at < len(data):
        stamp = int.from_bytes(data[at : at + 8], "big")
        first = stamp if first is None else first
        size = 12 + data[at + 9]
        yield (stamp - first) / 1e6, data[at + 8 : at + 8 + size]
        at += 8 + size


class Watcher:
    """Collects what an autopilot shows, from its frames: the same for the capture and for the stub."""

    def __init__(self, name: str, system_id: int) -> None:
        self.name, self.system_id = name, system_id
        self.heartbeats: list[list[float]] = []
        self.acks: list[list[float]] = []
        self.texts: list[tuple[float, str]] = []
        self.landed: list[list[float]] = []
        self.counts: Counter[int] = Counter()
        self.sensors: list[str] = []  # SYS_STATUS present/enabled/health, every change
        self.motion: list[list[float]] = []
        self._local: bytes | None = None
        self._next_s = 0.0
        self._mav = mavlink.MAVLink(None)
        self._mav.robust_parsing = True

    def frame(self, t_s: float, raw: bytes) -> None:
        """Take a frame that was seen at t_s."""
        if (raw[5], raw[6]) != (self.system_id, 1):
            return
        msgid = int.from_bytes(raw[7:10], "little")
        if COUNT_S[0] <= t_s < COUNT_S[1]:
            self.counts[msgid] += 1
        if msgid == 32:
            self._local = raw
        elif msgid == 30:
            if self._local is not None and t_s >= self._next_s:
                self._move(t_s, self._decode(raw), self._decode(self._local))
        elif msgid == 1:
            m = self._decode(raw)
            bits = (
                m.onboard_control_sensors_present,
                m.onboard_control_sensors_enabled,
                m.onboard_control_sensors_health,
            )
            shown = "/".join(f"{b:08x}" for b in bits)
            if self.sensors[-1:] != [shown]:
                self.sensors.append(shown)
        elif msgid == 245:
            state = self._decode(raw).landed_state
            if [state] != [shown for _, shown in self.landed[-1:]]:
                self.landed.append([t_s, state])
        elif msgid in (0, 77, 253):
            self._message(t_s, msgid, self._decode(raw))

    def _decode(self, raw: bytes) -> Any:
        return self._mav.decode(bytearray(raw))

    def _message(self, t_s: float, msgid: int, m: Any) -> None:
        if msgid == 0:
            self.heartbeats.append([t_s, m.custom_mode, m.base_mode, m.system_status])
        elif msgid == 77:
            self.acks.append([t_s, m.command, m.result])
        else:
            self.texts.append((t_s, m.text))

    def _move(self, t_s: float, attitude: Any, p: Any) -> None:
        fine = FINE_S[self.name]
        self._next_s = t_s + (0.015 if fine[0] <= t_s < fine[1] else 0.095)
        row = [t_s, p.x, p.y, p.z, p.vx, p.vy, p.vz, attitude.roll, attitude.pitch, attitude.yaw]
        self.motion.append(row)

    def rates_hz(self) -> dict[int, float]:
        """Return messages per second by id."""
        return {msgid: n / (COUNT_S[1] - COUNT_S[0]) for msgid, n in sorted(self.counts.items())}


def extract(name: str, path: Path, system_id: int) -> None:
    """Write the extract of one capture."""
    watcher, sent = Watcher(name, system_id), []
    for t_s, raw in frames(path):
        if raw[5] == system_id:
            watcher.frame(t_s, raw)
        elif int.from_bytes(raw[7:10], "little") != TIMESYNC:
            sent.append((t_s, raw.hex()))
    shown = {
        "system_id": system_id,
        "sent": [[round(t, 4), raw] for t, raw in sent],
        "heartbeats": [[round(h[0], 3), *h[1:]] for h in watcher.heartbeats],
        "acks": [[round(a[0], 4), *a[1:]] for a in watcher.acks],
        "texts": [[round(t, 3), text] for t, text in watcher.texts],
        "landed": [[round(t, 3), state] for t, state in watcher.landed],
        "sensors": watcher.sensors,
        "rates_hz": {str(k): round(v, 4) for k, v in watcher.rates_hz().items()},
        "motion": [[round(row[0], 3), *(round(v, 4) for v in row[1:])] for row in watcher.motion],
    }
    DATA.mkdir(exist_ok=True)
    (DATA / f"{name}.json.xz").write_bytes(lzma.compress(json.dumps(shown).encode(), preset=9 | lzma.PRESET_EXTREME))


def load(name: str) -> Flight:
    """Read the extract of one capture."""
    shown = json.loads(lzma.decompress((DATA / f"{name}.json.xz").read_bytes()))
    return Flight(
        name=name,
        system_id=shown["system_id"],
        sent=[(t, bytes.fromhex(raw)) for t, raw in shown["sent"]],
        heartbeats=shown["heartbeats"],
        acks=shown["acks"],
        texts=[(t, text) for t, text in shown["texts"]],
        landed=shown["landed"],
        sensors=shown["sensors"],
        rates_hz={int(k): v for k, v in shown["rates_hz"].items()},
        motion=shown["motion"],
    )


if __name__ == "__main__":
    for capture, system in (("quadx", 5), ("airplane", 6)):
        extract(capture, Path(sys.argv[1]) / CAPTURES[capture], system)
        print(capture, (DATA / f"{capture}.json.xz").stat().st_size, "bytes")
