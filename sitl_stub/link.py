"""One MAVLink link of the vehicle: its sequence numbers, its streams, whom it has heard, what happens on the way."""

from __future__ import annotations

import heapq
import math
import random

from sitl_stub import wire
from sitl_stub.faults import Disturbance
from sitl_stub.signing import Signer

GCS_TIMEOUT_S = 5.0
MAV_TYPE_GCS = 6
MAX_DATAGRAM = 1400


class Link:
    """Queues frames for one peer. Stream rates are per link, as in PX4."""

    def __init__(self, name: str, rates_hz: dict[int, float], seed: int) -> None:
        self.name = name
        self.splitter = wire.Splitter()
        self.queue: list[bytes] = []  # frames
        self.v1 = False
        self.signer: Signer | None = None
        self.unix_us = 0  # the autopilot's time of day, for signatures
        self.way_in = Disturbance(seed, f"{name} in")
        self.way_out = Disturbance(seed, f"{name} out")
        self.now_s = 0.0
        self.has_late = False  # whether anything is delayed
        self._late: list[tuple[float, int, bool, bytes]] = []  # (due, order, inwards, frame)
        self._order = 0
        self.seen: dict[tuple[int, int], float] = {}  # (sysid, compid) -> last heard [s]
        self.gcs_heard_s = -GCS_TIMEOUT_S - 1.0
        self._seqs: dict[tuple[int, int], int] = {}
        self._seed = seed
        self.boot(rates_hz)

    def boot(self, rates_hz: dict[int, float], now_s: float = 0.0) -> None:
        """Begin with the default streams."""
        self._random = random.Random(f"{self._seed}:{self.name}")
        self.intervals_s: dict[int, float] = {}
        self._due: list[tuple[float, int]] = []
        self.next_due_s = math.inf
        for msgid, rate in rates_hz.items():
            self.set_interval(msgid, 1.0 / rate, now_s)

    def set_interval(self, msgid: int, interval_s: float, now_s: float) -> None:
        """Send msgid every interval_s from now on; 0 or less: never."""
        self._due = [entry for entry in self._due if entry[1] != msgid]
        self.intervals_s.pop(msgid, None)
        if interval_s > 0.0:
            self.intervals_s[msgid] = interval_s
            self._due.append((now_s + interval_s * self._random.random(), msgid))
        heapq.heapify(self._due)
        self.next_due_s = self._due[0][0] if self._due else math.inf

    def due(self, now_s: float) -> list[int]:
        """Return the ids whose time has come, each once; each keeps its grid."""
        heap, intervals_s = self._due, self.intervals_s
        ready = []
        while heap and heap[0][0] <= now_s:
            at, msgid = heap[0]
            ready.append(msgid)
            interval_s = intervals_s[msgid]
            at += interval_s
            if at <= now_s:  # a step is longer than the interval
                at += interval_s * (math.floor((now_s - at) / interval_s) + 1)
            heapq.heapreplace(heap, (at, msgid))
        self.next_due_s = heap[0][0] if heap else math.inf
        return ready

    def send(self, msgid: int, payload: bytes, sysid: int, compid: int) -> None:
        """Queue one frame of our own."""
        source = (sysid, compid)
        seq = self._seqs.get(source, 0)
        self._seqs[source] = (seq + 1) & 0xFF
        if self.v1:
            if msgid < 256:
                self.forward(wire.frame_v1(msgid, payload, seq, sysid, compid))
        elif self.signer is not None:
            frame = wire.frame(msgid, payload, seq, sysid, compid, wire.SIGNED)
            self.forward(frame + self.signer.signature(frame, self.unix_us))
        elif self.way_out.active:
            self.forward(wire.frame(msgid, payload, seq, sysid, compid))
        else:
            self.queue.append(wire.frame(msgid, payload, seq, sysid, compid))

    def forward(self, raw: bytes) -> None:
        """Queue a frame as it is."""
        if self.way_out.active:
            self._disturbed(self.way_out(raw), inwards=False)
        else:
            self.queue.append(raw)

    def accept(self, raw: bytes) -> list[bytes]:
        """Return the frames that a received one becomes now; the rest comes out of `late` later."""
        if self.way_in.active:
            return self._disturbed(self.way_in(raw), inwards=True)
        return [raw]

    def late(self, now_s: float) -> list[bytes]:
        """Release what was delayed: outward frames are queued, inward ones returned."""
        inward: list[bytes] = []
        while self._late and self._late[0][0] <= now_s + 1e-9:
            _, _, inwards, raw = heapq.heappop(self._late)
            if inwards:
                inward.append(raw)
            else:
                self.queue.append(raw)
        self.has_late = bool(self._late)
        return inward

    def _disturbed(self, frames: list[tuple[float, bytes]], inwards: bool) -> list[bytes]:
        now = []
        for delay_s, raw in frames:
            if inwards and not wire.whole(raw):
                self.splitter.bad += 1  # spoilt on the way: the checksum tells
            elif delay_s > 0.0:
                self._order += 1
                self.has_late = True
                heapq.heappush(self._late, (self.now_s + delay_s, self._order, inwards, raw))
            elif inwards:
                now.append(raw)
            else:
                self.queue.append(raw)
        return now

    def take(self) -> list[bytes]:
        """Return what is queued as datagrams, several frames in one, as PX4 does."""
        frames, self.queue = self.queue, []
        if not frames:
            return []
        datagrams, size, start = [], 0, 0
        for i, raw in enumerate(frames):
            if size + len(raw) > MAX_DATAGRAM:
                datagrams.append(b"".join(frames[start:i]))
                size, start = 0, i
            size += len(raw)
        datagrams.append(b"".join(frames[start:]))
        return datagrams

    def heard(self, sysid: int, compid: int, now_s: float) -> None:
        """Note a sender on this link."""
        self.seen[(sysid, compid)] = now_s

    def has_gcs(self, now_s: float) -> bool:
        """Whether a ground station's HEARTBEAT was heard here lately: only then STATUSTEXT is sent."""
        return now_s - self.gcs_heard_s < GCS_TIMEOUT_S

    def knows(self, sysid: int, compid: int) -> bool:
        """Whether a message for this target belongs on this link."""
        if sysid == 0:
            return True
        return any(s == sysid and compid in (0, c) for s, c in self.seen)
