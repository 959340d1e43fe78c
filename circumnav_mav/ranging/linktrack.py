"""Nooploop LinkTrack (UWB): NLink NodeFrame2 (0x55 0x04) and NodeFrame3 (0x55 0x05), little-endian, sum checksum.

Layout from the vendor's nlink_unpack: NodeFrame2 has 119 fixed bytes and 13 a node, NodeFrame3 has 21 and 7; a node is
role, id, int24 millimetres, first-path and total signal (-0.5 dB a step), in NodeFrame2 also the time of its own range.
beacon_id is the node's id, sensor_id its role (1 anchor, 2 tag), because an anchor and a tag may share an id.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from struct import unpack_from
from typing import Any, NamedTuple

from circumnav_mav.ranging.framing import NEED_MORE, NO_FRAME, FrameScanner
from circumnav_mav.ranging.plug import BYTE, NAN, ByteSource, Reading, Reason, number
from circumnav_mav.types import Rejected

HEAD = 0x55
LONGEST = 119 + 255 * 13 + 1


class _Shape(NamedTuple):
    fixed: int  # bytes before the nodes
    node: int  # bytes a node
    local_time_at: int


SHAPES = {0x04: _Shape(119, 13, 102), 0x05: _Shape(21, 7, 6)}


def _probe(candidate: memoryview) -> int:
    if len(candidate) < 4:
        return NEED_MORE if len(candidate) < 2 or candidate[1] in SHAPES else NO_FRAME
    shape = SHAPES.get(candidate[1])
    (length,) = unpack_from("<H", candidate, 2)
    if shape is None or length < shape.fixed + 1 or (length - shape.fixed - 1) % shape.node:
        return NO_FRAME
    if len(candidate) < shape.fixed:
        return NEED_MORE
    if length != shape.fixed + candidate[shape.fixed - 1] * shape.node + 1:
        return NO_FRAME
    if len(candidate) < length:
        return NEED_MORE
    return length if sum(candidate[: length - 1]) & 0xFF == candidate[length - 1] else NO_FRAME


class Decoder:
    def __init__(self, options: Mapping[str, Any]) -> None:
        self._max_gap_db = number(options, "max_path_gap_db", math.inf, least=0.0)
        self._scanner = FrameScanner(HEAD, LONGEST, _probe)

    def feed(self, data: bytes, now_s: float) -> list[Reading | Rejected]:
        found: list[Reading | Rejected] = []
        for frame in self._scanner.feed(data, now_s):
            found += [frame] if isinstance(frame, Rejected) else self._nodes(frame, now_s)
        return found

    def _nodes(self, frame: bytes, now_s: float) -> list[Reading | Rejected]:
        shape = SHAPES[frame[1]]
        (local_ms,) = unpack_from("<I", frame, shape.local_time_at)
        return [self._node(frame, at, local_ms, now_s) for at in range(shape.fixed, len(frame) - 1, shape.node)]

    def _node(self, frame: bytes, at: int, local_ms: int, now_s: float) -> Reading | Rejected:
        role, node_id = frame[at], frame[at + 1]
        range_mm = int.from_bytes(frame[at + 2 : at + 5], "little", signed=True)
        gap_db = (frame[at + 5] - frame[at + 6]) / 2.0
        if range_mm == 0:
            return Rejected(now_s, Reason.NO_READING, f"node {node_id}: distance 0")
        if gap_db > self._max_gap_db:
            detail = f"node {node_id}: first path {gap_db:.1f} dB below the total, max_path_gap_db {self._max_gap_db:g}"
            return Rejected(now_s, Reason.INVALID_QUALITY, detail)
        own_ms = unpack_from("<I", frame, at + 7)[0] if frame[1] == 0x04 else 0
        stamp_ms = own_ms or local_ms
        return Reading(
            range_m=range_mm / 1000.0,
            beacon_id=node_id,
            sensor_id=role,
            stamp_s=stamp_ms / 1000.0 if stamp_ms else NAN,
        )


SOURCE = ByteSource(
    name="linktrack",
    summary="Nooploop LinkTrack UWB, NLink NodeFrame2 or NodeFrame3: millimetres, several nodes by id",
    decoder=Decoder,
    resolution_m=0.001,
    carries=frozenset({"beacon_id", "sensor_id", "stamp_s"}),
    most_beacon_id=BYTE,
    most_m=10_000.0,
    baud=921_600,
    options={
        "max_path_gap_db": "reject a range whose first path is this much weaker than the total signal: no line of sight"
    },
)
