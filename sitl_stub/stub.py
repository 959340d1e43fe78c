"""The stub itself, sans-IO: bytes in, bytes out, simulated time as an argument."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Any

from sitl_stub import happenings, protocol, wire
from sitl_stub.autopilot import Autopilot
from sitl_stub.commands import MODE_LEAST_S
from sitl_stub.config import StubConfig
from sitl_stub.devices import DEVICES, RangeToBytes
from sitl_stub.faults import Fault, Timeline
from sitl_stub.foreign import ForeignVehicle
from sitl_stub.link import Link
from sitl_stub.rates import FIXED_WING_HZ, GCS_HZ, ONBOARD_HZ
from sitl_stub.sensors import DISTANCE_SENSOR, Measurement, Radio, RadioFaults, distance_fields
from sitl_stub.signing import Signer
from sitl_stub.streams import BUILDERS, CONDITIONS, CURRENT_MODE, HEARTBEAT
from sitl_stub.truth import Truth, truth_of
from sitl_stub.world import World

AUTOPILOT = 1  # component id
STATUSTEXT, TEXT_LENGTH = 253, 50
QUIET_UNTIL_HEARD = frozenset({"gcs"})  # links that carry HEARTBEAT only until somebody speaks there
NOT_FORWARDED = frozenset({DISTANCE_SENSOR, 82, 84, 86, 111})
RADIO_HEARTBEAT = (18, 8, 0, 0, 4, 3)  # an onboard controller that is no autopilot
REBOOT_S = 2.0


class Stub:
    """A PX4 vehicle with a ranging radio.

    Links: "offboard" (PX4's 14540 / 14580), "gcs" (14550 / 18570), "ranging" if the radio has an endpoint of its own,
    "device" if it is a device with bytes of its own. Feed what peers sent with `receive`, carry time with `advance`,
    and fetch what the vehicle sent with `take`. Equal configs and equal calls give equal bytes.
    """

    def __init__(self, config: StubConfig | None = None) -> None:
        self.config = c = config or StubConfig()
        self.now_s = 0.0
        self._steps = 0
        self.world = World(c, c.step_s)
        self.autopilot = Autopilot(c, c.step_s)
        self.autopilot.params.set("MAV_SYS_ID", c.system_id)
        self.radio = Radio(c) if c.radio else None
        self.links = self._make_links()
        self._vehicle_links = [self.links["offboard"], self.links["gcs"]]
        self._device = DEVICES[c.device](c.range_beacon_id) if c.device else None
        self._device_bytes: list[bytes] = []
        self._later: list[tuple[float, int, Link, int, bytes]] = []
        self._later_count = 0
        self._distances: dict[str, tuple[int, tuple[Any, ...]]] = {}  # sender -> (uORB instance, echoed fields)
        self._fresh: dict[str, set[str]] = {link.name: set() for link in self._vehicle_links}
        self._shown_mode = (0, 0)
        self._next_radio_heartbeat_s = 0.0
        self._text_id = 0
        self._timeline = Timeline(c.faults)
        self.active_faults: dict[str, list[Fault]] = {}  # by kind, in the order in which they began
        self.foreigners: dict[int, ForeignVehicle] = {}  # by system id
        self.deaf = False  # setpoints are ignored
        self._down_until_s = -math.inf  # while the autopilot boots

    # -- the interface -------------------------------------------------------------------------------------------

    def receive(self, link: str, data: bytes) -> None:
        """Take bytes that a peer sent on a link; they act at the present simulated time."""
        if link == "device":
            return  # devices are not listened to
        where = self.links[link]
        if where.splitter.idle and not where.way_in.active and wire.whole(data):
            self._take_frame(where, data)  # one frame in one datagram, as nearly always
            return
        for raw in where.splitter.feed(data):
            for arrived in where.accept(raw):
                self._take_frame(where, arrived)

    def advance(self, now_s: float) -> None:
        """Fly up to now_s [s since boot] in steps of config.step_s."""
        step_s = self.config.step_s
        last = math.floor(now_s / step_s + 1e-6)
        while self._steps < last:
            self._steps += 1
            self._step(self._steps * step_s)

    def take(self, link: str) -> list[bytes]:
        """Return the datagrams that the vehicle has sent on a link since the last call."""
        if link == "device":
            reports, self._device_bytes = self._device_bytes, []
            return reports
        return self.links[link].take()

    def truth(self) -> Truth:
        """Return where everything really is."""
        return truth_of(self.autopilot, self.world, self.now_s)

    # -- for the protocol handlers and the faults ------------------------------------------------------------------

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
        if link.name != "offboard":
            return GCS_HZ if link.name == "gcs" else {}
        return ONBOARD_HZ | FIXED_WING_HZ if self.autopilot.fixed_wing else ONBOARD_HZ

    def hear_distance(self, sender: str, fields: tuple[Any, ...]) -> None:
        """Publish a peer's DISTANCE_SENSOR inside the autopilot: one instance a sender, sent back on every link."""
        instance = self._distances[sender][0] if sender in self._distances else len(self._distances) + 1
        self._distances[sender] = (instance, fields)
        for fresh in self._fresh.values():
            fresh.add(sender)

    def reboot(self) -> None:
        """Boot the autopilot: silent and deaf for REBOOT_S, then disarmed, with default streams and time from zero."""
        self._down_until_s = self.now_s + REBOOT_S
        self.autopilot.boot(self._down_until_s)
        self.autopilot.params.set("MAV_SYS_ID", self.config.system_id)  # a PARAM_SET of another never acts
        self._later.clear()
        self._distances.clear()
        for link in self._vehicle_links:
            link.seen.clear()
            link.boot(self.default_rates(link), self._down_until_s)

    # -- the works -------------------------------------------------------------------------------------------------

    def _make_links(self) -> dict[str, Link]:
        c = self.config
        names = ["offboard", "gcs"] + (["ranging"] if c.range_link == "ranging" else [])
        links = {}
        for number, name in enumerate(names):
            links[name] = link = Link(name, {}, c.seed)
            link.boot(self.default_rates(link))
            link.v1 = c.mavlink_version == 1
            link.signer = Signer(c.signing_key, number) if c.signing_key else None
        return links

    def _take_frame(self, link: Link, raw: bytes) -> None:
        if self.now_s < self._down_until_s or (link.signer is not None and not link.signer.accepts(raw)):
            return
        if raw[0] == wire.V2_MAGIC:
            link.v1 = False  # as PX4: the peer's version is good enough for us
            link.heard(raw[5], raw[6], self.now_s)
        else:
            link.heard(raw[3], raw[4], self.now_s)
        if link.name == "ranging":
            return
        msgid = wire.msgid_of(raw)
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
        if t_s >= self._timeline.next_s:
            for fault, begins in self._timeline.until(t_s):
                happenings.happen(self, fault, begins)
        world, autopilot = self.world, self.autopilot
        if world.gusty:
            world.step()
        autopilot.step(t_s, world.wind_n, world.wind_e)
        if self.radio is not None and (t_s >= self.radio.due_s or t_s >= self._next_radio_heartbeat_s):
            self._range(self.radio, t_s)
        for link in self._vehicle_links:
            link.now_s = t_s
            if link.has_late:
                for raw in link.late(t_s):
                    self._take_frame(link, raw)
        for foreigner in self.foreigners.values():
            foreigner.step(t_s, self.links["offboard"])
        if t_s < self._down_until_s:
            return
        while self._later and self._later[0][0] <= t_s + 1e-9:
            _, _, link, msgid, payload = heapq.heappop(self._later)
            link.send(msgid, payload, self.config.system_id, AUTOPILOT)
        if autopilot.commander.texts:
            self._send_texts()
        for link in self._vehicle_links:
            if link.next_due_s <= t_s:
                self._stream(link, t_s)
        shown = (autopilot.commander.mode, autopilot.commander.intention)
        if shown != self._shown_mode:
            self._show_mode(shown)

    def _stream(self, link: Link, t_s: float) -> None:
        autopilot, sysid = self.autopilot, self.config.system_id
        quiet = link.name in QUIET_UNTIL_HEARD and not link.seen
        link.unix_us = autopilot.unix_us()
        for msgid in link.due(t_s):
            if quiet and msgid != HEARTBEAT:
                continue
            if msgid in CONDITIONS and not CONDITIONS[msgid](autopilot):
                continue
            link.send(msgid, wire.pack(msgid, BUILDERS[msgid](autopilot)), sysid, AUTOPILOT)
            if msgid == DISTANCE_SENSOR and self._distances:
                self._echo(link)

    def _echo(self, link: Link) -> None:
        fresh = self._fresh[link.name]
        for sender in sorted(fresh & self._distances.keys()):
            instance, f = self._distances[sender]
            self.send(link, DISTANCE_SENSOR, (self.autopilot.boot_ms, *f[:4], instance, *f[4:]))
        fresh.clear()

    def _range(self, radio: Radio, t_s: float) -> None:
        c = self.config
        sysid = c.system_id if c.range_sysid is None else c.range_sysid
        link = self.links[c.range_link]
        for measurement in radio.step(t_s, lambda: self.world.range_and_rate(t_s, self.autopilot.vehicle)):
            if self._device is not None:
                if report := self._report(self._device, radio.faults, measurement):
                    self._device_bytes.append(report)
                continue
            msgid, fields = radio.message(measurement)
            link.send(msgid, wire.pack(msgid, fields), sysid, c.range_compid)
            if link.name == "offboard" and msgid == DISTANCE_SENSOR and t_s >= self._down_until_s:
                self.hear_distance("radio", protocol.echoed_distance(distance_fields(fields)))
        if t_s >= self._next_radio_heartbeat_s:
            self._next_radio_heartbeat_s += 1.0
            if self._device is None:
                link.send(HEARTBEAT, wire.pack(HEARTBEAT, RADIO_HEARTBEAT), sysid, c.range_compid)

    def _report(self, device: RangeToBytes, faults: RadioFaults, m: Measurement) -> bytes:
        if faults.sensor_id is not None:
            device = DEVICES[self.config.device](faults.sensor_id)
        return device.encode(math.nan if faults.invalid else m.range_m, m.rate_m_s, m.t_s)

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
            if link.intervals_s.get(CURRENT_MODE, math.inf) <= MODE_LEAST_S:
                self.send(link, CURRENT_MODE, BUILDERS[CURRENT_MODE](self.autopilot))
