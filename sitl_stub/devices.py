"""What real ranging devices send, byte for byte: the stub's hidden beacon on a serial line or a UDP port.

Each device turns (range [m], range rate [m/s, + opening], time [s]) into the bytes of one report, quantised as the
device does it. A range of NaN, or one that the format cannot carry, becomes the device's own way to say that it has
none, which for some is to say nothing. Formats come from the vendors' documents; golden samples with their sources are
in tests/data.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from struct import pack
from typing import NamedTuple, Protocol


class RangeToBytes(Protocol):
    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes: ...


class Node(NamedTuple):
    """One peer in a LinkTrack frame. Signals are in steps of -0.5 dB, as on the wire."""

    role: int
    id: int
    range_mm: int
    first_path: int = 180
    total: int = 160
    system_time_ms: int = 0  # NodeFrame2 only: when this range was measured


LINKTRACK_ANCHOR, LINKTRACK_TAG = 1, 2
LINKTRACK_MOST_MM = (1 << 23) - 1
UINT32 = 1 << 32


def linktrack_node_frame2(
    role: int,
    own_id: int,
    local_time_ms: int,
    system_time_ms: int,
    voltage_mv: int,
    nodes: Sequence[Node],
    pose: bytes = bytes(92),
    reserved: bytes = bytes(10),
) -> bytes:
    """Return NLink NodeFrame2; `pose` is its block of position, velocity, IMU and attitude (zero: not known)."""
    body = pack("<BBI", role, own_id, system_time_ms % UINT32) + pose
    body += pack("<I", local_time_ms % UINT32) + reserved + pack("<HB", voltage_mv, len(nodes))
    for node in nodes:
        body += _linktrack_range(node) + pack("<I", node.system_time_ms % UINT32) + bytes(2)
    return _nlink(0x04, body)


def linktrack_node_frame3(
    role: int,
    own_id: int,
    local_time_ms: int,
    system_time_ms: int,
    voltage_mv: int,
    nodes: Sequence[Node],
    reserved: bytes = bytes(4),
) -> bytes:
    """Return NLink NodeFrame3."""
    body = pack("<BBII", role, own_id, local_time_ms % UINT32, system_time_ms % UINT32) + reserved
    body += pack("<HB", voltage_mv, len(nodes))
    return _nlink(0x05, body + b"".join(_linktrack_range(node) for node in nodes))


def _linktrack_range(node: Node) -> bytes:
    distance = node.range_mm.to_bytes(3, "little", signed=True)
    return bytes((node.role, node.id)) + distance + bytes((node.first_path, node.total))


def _nlink(mark: int, body: bytes) -> bytes:
    frame = bytes((0x55, mark)) + pack("<H", len(body) + 5) + body
    return frame + bytes((sum(frame) & 0xFF,))


class LinkTrack:
    """A Nooploop LinkTrack tag that ranges to one anchor."""

    def __init__(self, beacon_id: int = 1, frame: int = 3) -> None:
        self._beacon_id, self._frame = _id_of("LinkTrack", beacon_id, 0xFF), frame

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        range_mm = _steps(range_m, 0.001, LINKTRACK_MOST_MM)
        now_ms = round(t_s * 1e3)
        node = Node(LINKTRACK_ANCHOR, self._beacon_id, range_mm, system_time_ms=now_ms)
        make = linktrack_node_frame2 if self._frame == 2 else linktrack_node_frame3
        return make(LINKTRACK_TAG, 0, now_ms, now_ms, 4950, [node])


def les_line(anchors: Sequence[tuple[int, str, float]], tail: str = "") -> bytes:
    """Return a line of the DWM1001's `les`: (id, position as text, range [m]) an anchor, then what follows them."""
    words = [f"{anchor:04X}[{place}]={range_m:.2f}" for anchor, place, range_m in anchors]
    return (" ".join([*words, tail] if tail else words) + "\r\n").encode()


class Dwm1001Les:
    """A Qorvo DWM1001 tag in the PANS shell after `les`; an anchor that it does not hear is left out."""

    def __init__(self, beacon_id: int = 1) -> None:
        self._beacon_id = _id_of("DWM1001", beacon_id, 0xFFFF)

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        if not _steps(range_m, 0.01, 999_999):
            return b""
        return les_line([(self._beacon_id, "0.00,0.00,0.00", range_m)], "le_us=2576")


class Console:
    """What may be typed to a device on a serial line, and what comes out: most say all they have, and are deaf."""

    def hear(self, data: bytes, t_s: float) -> bytes:
        """Take what was typed at t_s [s]; return the answer."""
        return b""

    def says(self, report: bytes) -> bytes:
        """Return what of a report of ranges comes out."""
        return report


class PansConsole(Console):
    """The UART of a DWM1001 with PANS: what comes out of it depends on what was typed, and stays so when nobody reads.

    It starts in binary mode, which answers what it does not know with an error of three bytes. Two carriage returns
    within a second open the shell; there `les` starts the lines of ranges, and `les` again stops them; `quit` leads
    back. The shell echoes. Source: PANS documentation, UART interface and shell API.
    """

    ERROR = b"\x40\x01\x01"
    PROMPT = b"dwm> "
    SHELL_WITHIN_S = 1.0

    def __init__(self) -> None:
        self.in_shell = self.in_lines = False
        self._returned_s = -math.inf
        self._typed = b""

    def hear(self, data: bytes, t_s: float) -> bytes:
        """Take what was typed at t_s [s]; return the answer."""
        return b"".join(self._key(data[i : i + 1], t_s) for i in range(len(data)))

    def says(self, report: bytes) -> bytes:
        """Return what of a report of ranges comes out."""
        return report if self.in_lines else b""

    def _key(self, key: bytes, t_s: float) -> bytes:
        if not self.in_shell:
            twice = key == b"\r" and t_s - self._returned_s <= self.SHELL_WITHIN_S
            self._returned_s = t_s if key == b"\r" else -math.inf
            self.in_shell = twice
            return b"\r\n" + self.PROMPT if twice else self.ERROR
        if key != b"\r":
            self._typed += key
            return key
        command, self._typed = self._typed, b""
        if command == b"les":
            self.in_lines = not self.in_lines
        elif command == b"quit":
            self.in_shell = self.in_lines = False
            self._returned_s = -math.inf
        return b"\r\n" + self.PROMPT


class LightWare:
    """A LightWare laser in continuous ASCII output; a lost signal is 130.00 m, as delivered."""

    LOST_M = 130.0

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        shown_m = range_m if _steps(range_m, 0.01, 12_999) else self.LOST_M
        return f"{shown_m:.2f}\r\n".encode()


class UsD1:
    """An Ainstein US-D1 radar; no range is 0."""

    def __init__(self, snr: int = 30) -> None:
        self._snr = snr

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        body = pack("<BHB", 0x02, _steps(range_m, 0.01, 0xFFFF), self._snr)
        return b"\xfe" + body + bytes((sum(body) & 0xFF,))


class OmniPreSense:
    """An OmniPreSense OPS243-C radar in JSON mode: a line of speed, then a line of range; silent without an object."""

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        if not _steps(range_m, 0.01, 1_000_000):
            return b""
        reports: list[dict[str, object]] = []
        ms = round(t_s * 1e3)
        when = {"time": ms // 1000, "tick": ms % 1000}
        if math.isfinite(range_rate_m_s):
            direction = "outbound" if range_rate_m_s > 0.0 else "inbound"
            reports.append({"speed": round(abs(range_rate_m_s), 2), "direction": direction, **when})
        reports.append({"unit": "m", **when, "range": round(range_m, 2)})
        return b"".join(json.dumps(report, separators=(", ", ":")).encode() + b"\r\n" for report in reports)


class Lines:
    """Lines of a format of your own; the template may use range_m, rate_m_s, t_s, range_cm, range_mm and beacon_id."""

    def __init__(self, template: str = "range={range_m:.3f} rate={rate_m_s:.3f}", beacon_id: int = 1) -> None:
        self._template, self._beacon_id = template, beacon_id

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        if not math.isfinite(range_m):
            return b""
        text = self._template.format(
            range_m=range_m,
            range_cm=range_m * 1e2,
            range_mm=range_m * 1e3,
            rate_m_s=range_rate_m_s,
            t_s=t_s,
            beacon_id=self._beacon_id,
        )
        return text.encode() + b"\n"


class Replay:
    """Rows of the file format that recorded ranges are kept in: t_s, range_m, range_rate_m_s, sigma_m, beacon_id."""

    def encode(self, range_m: float, range_rate_m_s: float, t_s: float) -> bytes:
        if not math.isfinite(range_m):
            return b""
        rate = f"{range_rate_m_s!r}" if math.isfinite(range_rate_m_s) else ""
        return f"{t_s!r},{range_m!r},{rate},,\n".encode()


def console_of(device: str) -> Console:
    """Return the console of a device just switched on."""
    return PansConsole() if device == "dwm1001_les" else Console()


DEVICES: dict[str, Callable[[int], RangeToBytes]] = {
    "linktrack": lambda beacon_id: LinkTrack(beacon_id, frame=3),
    "linktrack_frame2": lambda beacon_id: LinkTrack(beacon_id, frame=2),
    "dwm1001_les": Dwm1001Les,
    "lightware": lambda beacon_id: LightWare(),
    "us_d1": lambda beacon_id: UsD1(),
    "omnipresense": lambda beacon_id: OmniPreSense(),
    "lines": lambda beacon_id: Lines(beacon_id=beacon_id),
    "replay": lambda beacon_id: Replay(),
}
"""Devices by name; each makes one that ranges to the beacon with that id (ignored by devices that know of none)."""
WITH_ID = frozenset({"linktrack", "linktrack_frame2", "dwm1001_les"})  # whose bytes carry the beacon's id


def _steps(range_m: float, step_m: float, most: int) -> int:
    """Return the range in whole steps, or 0 (no range) where it is not positive or too far for the format."""
    if not math.isfinite(range_m) or not 0.0 < range_m <= most * step_m:
        return 0
    return round(range_m / step_m)


def _id_of(device: str, beacon_id: int, most: int) -> int:
    if not 0 <= beacon_id <= most:
        raise ValueError(f"a {device} beacon has an id from 0 to {most}, not {beacon_id}")
    return beacon_id
