"""The stub itself, sans-IO: bytes in, bytes out, simulated time as an argument."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Any

from sitl_stub import protocol, wire
from sitl_stub.autopilot import Autopilot
from sitl_stub.config import StubConfig
from sitl_stub.link import Link
from sitl_stub.modes import name_of
from sitl_stub.sensors import Radio
from sitl_stub.streams import (
    BUILDERS,
    CURRENT_MODE,
    DISTANCE_SENSOR,
    FIXED_WING_HZ,
    GCS_HZ,
    NEED_POSITION,
    ONBOARD_HZ,
    ZERO4,
)
from sitl_stub.world import Truth, World

AUTOPILOT = 1  # component id
STATUSTEXT, HEARTBEAT = 253, 0
TEXT_LENGTH = 50
QUIET_UNTIL_HEARD = frozenset({"gcs"})  # links that carry HEARTBEAT only until somebody speaks there
NOT_FORWARDED = frozenset({DISTANCE_SENSOR, 82, 84, 86, 111})


class Stub:
    """A PX4 vehicle with a ranging radio.

    Links: "offboard" (PX4's 14540 / 14580), "gcs" (14550 / 18570) and, if the radio has an endpoint of its own,
    "ranging". Feed what peers sent with `receive`, carry time with `advance`, and fetch what the vehicle sent with
    `take`. Equal configs and equal calls give equal bytes.
    """

    def __init__(self, config: StubConfig | None = None) -> None:
        self.config = config or StubConfig()
        self.now_s = 0.0
        self._steps = 0
        self.world = World(self.config, self.config.step_s)
        self.autopilot = Autopilot(self.config, self.config.step_s)
        self.radio = Radio(self.config) if self.config.radio else None
        seed = self.config.seed
        self._rates_hz = {"offboard": dict(ONBOARD_HZ), "gcs": dict(GCS_HZ), "ranging": {}}
        if self.autopilot.fixed_wing:
            self._rates_hz["offboard"].update(FIXED_WING_HZ)
        names = ("offboard", "gcs", "ranging") if self.config.range_link == "ranging" else ("offboard", "gcs")
        self.links = {name: Link(name, self._rates_hz[name], seed) for name in names}
        self._vehicle_links = [self.links["offboard"], self.links["gcs"]]
        self._later: list[tuple[float, int, Link, int, bytes]] = []
        self._later_count = 0
        self._distances: dict[str, tuple[int, tuple[Any, ...]]] = {}  # sender -> (uORB instance, echoed fields)
        self._fresh: dict[str, set[str]] = {link.name: set() for link in self._vehicle_links}
        self._shown_mode = (0, 0)
        self._next_radio_heartbeat_s = 0.0
        self._text_id = 0

    # -- the interface -------------------------------------------------------------------------------------------

    def receive(self, link: str, data: bytes) -> None:
        """Take bytes that a peer sent on a link; they act at the present simulated time."""
        where = self.links[link]
        for raw in where.splitter.feed(data):
            self._take_frame(where, raw)

    def advance(self, now_s: float) -> None:
        """Fly up to now_s [s since boot] in steps of config.step_s."""
        step_s = self.config.step_s
        last = math.floor(now_s / step_s + 1e-6)
        while self._steps < last:
            self._steps += 1
            self._step(self._steps * step_s)

    def take(self, link: str) -> list[bytes]:
        """Return the datagrams that the vehicle has sent on a link since the last call."""
        return self.links[link].take()

    def truth(self) -> Truth:
        """Return where everything really is."""
        v, commander, t_s = self.autopilot.vehicle, self.autopilot.commander, self.now_s
        beacon_n, beacon_e, beacon_h = self.world.beacon(t_s)
        return Truth(
            t_s=t_s,
            east_m=v.e,
            north_m=v.n,
            height_m=v.h,
            heading_rad=_from_east(v.yaw),
            course_rad=math.atan2(v.vn, v.ve),
            speed_m_s=math.hypot(v.vn, v.ve),
            climb_m_s=v.vu,
            airspeed_m_s=self.autopilot.airspeed(),
            turn_rate_rad_s=-v.yaw_rate,
            roll_rad=v.roll,
            pitch_rad=v.pitch,
            beacon_east_m=beacon_e,
            beacon_north_m=beacon_n,
            beacon_height_m=beacon_h,
            range_m=self.world.range_from(t_s, v.n, v.e, v.h),
            horizontal_range_m=math.hypot(beacon_n - v.n, beacon_e - v.e),
            wind_east_m_s=self.world.wind_e,
            wind_north_m_s=self.world.wind_n,
            mode=name_of(commander.mode),
            armed=commander.armed,
            failsafe=commander.failsafe,
        )

    # -- sending (for the protocol handlers) -----------------------------------------------------------------------

    def send(self, link: Link, msgid: int, values: Sequence[Any]) -> None:
        """Queue a message of the autopilot on one link."""
        link.send(msgid, wire.pack(msgid, values), self.config.system_id, AUTOPILOT)

    def send_everywhere(self, msgid: int, values: Sequence[Any]) -> None:
        """Queue a message of the autopilot on every link of the vehicle."""
        payload = wire.pack(msgid, values)
        for link in self._vehicle_links:
            link.send(msgid, payload, self.config.system_id, AUTOPILOT)

    def send_later(self, after_s: float, link: Link, msgid: int, values: Sequence[Any]) -> None:
        """Queue a message of the autopilot for a later step."""
        if after_s <= 0.0:
            self.send(link, msgid, values)
            return
        self._later_count += 1
        entry = (self.now_s + after_s, self._later_count, link, msgid, wire.pack(msgid, values))
        heapq.heappush(self._later, entry)

    def default_rates(self, link: Link) -> dict[int, float]:
        """Return the rates that a link boots with [Hz]."""
        return self._rates_hz[link.name]

    def hear_distance(self, sender: str, fields: tuple[Any, ...]) -> None:
        """Publish a peer's DISTANCE_SENSOR inside the autopilot: one instance a sender, sent back on every link."""
        instance = self._distances[sender][0] if sender in self._distances else len(self._distances) + 1
        self._distances[sender] = (instance, fields)
        for fresh in self._fresh.values():
            fresh.add(sender)

    # -- the works -------------------------------------------------------------------------------------------------

    def _take_frame(self, link: Link, raw: bytes) -> None:
        msgid = wire.msgid_of(raw)
        sysid, compid = (raw[5], raw[6]) if raw[0] == wire.V2_MAGIC else (raw[3], raw[4])
        link.heard(sysid, compid, self.now_s)
        if link.name == "ranging":
            return
        if msgid in protocol.HANDLERS:
            protocol.handle(self, link, wire.decode(raw))
        if msgid not in NOT_FORWARDED:
            self._forward(link, raw)

    def _forward(self, source: Link, raw: bytes) -> None:
        target = wire.target_of(raw)
        if target == (self.config.system_id, AUTOPILOT):
            return
        for link in self._vehicle_links:
            if link is not source and link.knows(*target):
                link.forward(raw)

    def _step(self, t_s: float) -> None:
        self.now_s = t_s
        world, autopilot = self.world, self.autopilot
        world.step()
        autopilot.step(t_s, world.wind_n, world.wind_e)
        if self.radio is not None:
            self._range(self.radio, t_s)
        while self._later and self._later[0][0] <= t_s + 1e-9:
            _, _, link, msgid, payload = heapq.heappop(self._later)
            link.send(msgid, payload, self.config.system_id, AUTOPILOT)
        if autopilot.commander.texts:
            self._send_texts()
        for link in self._vehicle_links:
            self._stream(link, t_s)
        shown = (int(autopilot.commander.mode), int(autopilot.commander.intention))
        if shown != self._shown_mode:
            self._show_mode(shown)

    def _stream(self, link: Link, t_s: float) -> None:
        ready = link.due(t_s)
        if not ready:
            return
        autopilot, sysid = self.autopilot, self.config.system_id
        quiet = link.name in QUIET_UNTIL_HEARD and not link.seen
        for msgid in ready:
            if quiet and msgid != HEARTBEAT:
                continue
            if msgid in NEED_POSITION and not autopilot.commander.position_ok:
                continue
            link.send(msgid, wire.pack(msgid, BUILDERS[msgid](autopilot)), sysid, AUTOPILOT)
            if msgid == DISTANCE_SENSOR and self._distances:
                self._echo(link)

    def _echo(self, link: Link) -> None:
        fresh = self._fresh[link.name]
        for sender in sorted(fresh):
            instance, f = self._distances[sender]
            self.send(link, DISTANCE_SENSOR, (self.autopilot.boot_ms, *f[:4], instance, *f[4:]))
        fresh.clear()

    def _range(self, radio: Radio, t_s: float) -> None:
        c, v = self.config, self.autopilot.vehicle
        sysid = c.system_id if c.range_sysid is None else c.range_sysid
        link = self.links[c.range_link]
        for taken_s, range_m in radio.step(t_s, lambda: self.world.range_from(t_s, v.n, v.e, v.h)):
            cm = min(65535, round(range_m * 100.0))
            variance = round((c.range_sigma_m * 100.0) ** 2)
            limits = (10, min(65535, round(c.range_max_m * 100.0)))
            fields = (
                round(taken_s * 1000.0), *limits, cm, 0, c.range_sensor_id, c.range_orientation,
                variance if 0 < variance < 255 else 255, 0.0, 0.0, ZERO4, 0,
            )  # fmt: skip
            payload = wire.pack(DISTANCE_SENSOR, fields)
            link.send(DISTANCE_SENSOR, payload, sysid, c.range_compid)
            if link.name == "offboard":
                spec = wire.spec(DISTANCE_SENSOR)
                assert spec is not None
                self.hear_distance("radio", protocol.echoed_distance(spec.tuple_type._make(fields)))
        if t_s >= self._next_radio_heartbeat_s:
            self._next_radio_heartbeat_s += 1.0
            link.send(HEARTBEAT, wire.pack(HEARTBEAT, (18, 8, 0, 0, 4, 3)), sysid, c.range_compid)

    def _send_texts(self) -> None:
        texts, self.autopilot.commander.texts = self.autopilot.commander.texts, []
        links = [link for link in self._vehicle_links if link.has_gcs(self.now_s)]
        for severity, text in texts:
            chunks = [text[i : i + TEXT_LENGTH].encode() for i in range(0, len(text), TEXT_LENGTH)]
            self._text_id = self._text_id % 0xFFFF + 1
            text_id = self._text_id if len(chunks) > 1 else 0
            for link in links:
                for i, chunk in enumerate(chunks):
                    self.send(link, STATUSTEXT, (severity, chunk, text_id, i))

    def _show_mode(self, shown: tuple[int, int]) -> None:
        self._shown_mode = shown
        for link in self._vehicle_links:
            if link.intervals_s.get(CURRENT_MODE, math.inf) <= protocol.CURRENT_MODE_LEAST_S:
                self.send(link, CURRENT_MODE, BUILDERS[CURRENT_MODE](self.autopilot))


def _from_east(compass_rad: float) -> float:
    angle = math.pi / 2 - compass_rad
    return math.atan2(math.sin(angle), math.cos(angle))
