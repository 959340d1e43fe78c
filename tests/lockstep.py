"""The lockstep rig: the app's flight and the stub's vehicle exchange real MAVLink bytes in memory, on one clock.

No socket, no sleep: 300 s of flight take two or three. A peer (pilot, ground station) speaks through the stub's GCS
link.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config import Config
from circumnav_mav.flight import Flight
from circumnav_mav.flight_record import TickRecord
from circumnav_mav.guidance.phases import ENGAGED
from sitl_stub import Stub, StubConfig, Truth

OFFBOARD_LINK, GCS_LINK = "offboard", "gcs"
Script = Callable[["Rig"], None]
ENGAGED_NAMES = frozenset(str(p) for p in ENGAGED)


def config(**sections: Any) -> Config:
    """Return the default configuration with some sections' keys replaced: config(orbit={"radius_m": 40})."""
    return Config.model_validate(sections)


class Peer:
    """A ground station, or a pilot's hands, on the stub's GCS link."""

    def __init__(self, stub: Stub, sysid: int = 255, compid: int = 190, link: str = GCS_LINK) -> None:
        self._stub, self._link = stub, link
        self.mav = mavlink.MAVLink(None, sysid, compid)
        self.vehicle = stub.config.system_id

    def send(self, message: Any) -> None:
        self._stub.receive(self._link, message.pack(self.mav))

    def heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def command(self, command: int, *params: float, target: tuple[int, int] | None = None) -> None:
        values = (*params, *(0.0,) * (7 - len(params)))
        system, component = target or (self.vehicle, 1)
        self.send(mavlink.MAVLink_command_long_message(system, component, command, 0, *values))

    def mode(self, custom_mode: int) -> None:
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24)


@dataclass(slots=True)
class Log:
    """What happened, tick by tick."""

    radius_m: float
    ticks: list[TickRecord] = field(default_factory=list)
    truth: list[Truth] = field(default_factory=list)

    def error_m(self, from_s: float = 0.0, to_s: float = math.inf) -> list[float]:
        """Return the true orbit error while the app held the aircraft."""
        return [
            truth.horizontal_range_m - self.radius_m
            for tick, truth in zip(self.ticks, self.truth, strict=True)
            if from_s <= tick.t_s <= to_s and tick.phase in ENGAGED_NAMES
        ]

    def rms_m(self, last_s: float) -> float:
        """Return the rms of the true error over the last seconds of the orbit."""
        errors = self.error_m(self.ticks[-1].t_s - last_s)
        return math.sqrt(sum(e * e for e in errors) / len(errors))

    def furthest_m(self, last_s: float) -> float:
        """Return the greatest true error over the last seconds of the orbit."""
        return max(abs(e) for e in self.error_m(self.ticks[-1].t_s - last_s))

    @property
    def phases(self) -> list[str]:
        """Return the phases in the order in which they were entered."""
        seen: list[str] = []
        for tick in self.ticks:
            if not seen or seen[-1] != tick.phase:
                seen.append(tick.phase)
        return seen

    def sent(self, from_s: float = -math.inf) -> list[TickRecord]:
        """Return the ticks that sent a setpoint at or after `from_s`."""
        return [t for t in self.ticks if t.t_s >= from_s and t.turn_rate_sent_rad_s == t.turn_rate_sent_rad_s]


class Wire:
    """One direction of a link. This one is perfect; tests/trust has bad ones."""

    def __init__(self) -> None:
        self._queue: list[bytes] = []

    def put(self, data: bytes, now_s: float) -> None:
        """Take a datagram in."""
        self._queue.append(data)

    def due(self, now_s: float) -> list[bytes]:
        """Return what arrives by `now_s`, in the order of arrival."""
        queue, self._queue = self._queue, []
        return queue


@dataclass(slots=True)
class Wires:
    """Both directions between app and vehicle."""

    to_app: Wire
    to_vehicle: Wire


class Rig:
    """App and vehicle. `setpoints` holds every setpoint frame that reached the vehicle: (time, frame)."""

    def __init__(self, config: Config, stub_config: StubConfig, wires: Wires | None = None) -> None:
        self.config = config
        self.stub = Stub(stub_config)
        self.flight = Flight(config)
        self.pilot = Peer(self.stub)
        self.now_s = 0.0
        self.tick_s = 1.0 / config.loop.rate_hz
        self.log = Log(config.orbit.radius_m)
        self.app_frames: list[tuple[float, bytes]] = []
        self.frozen = False
        self.deaf = False  # nothing that the vehicle sends arrives
        self._wires = wires or Wires(Wire(), Wire())
        self._vehicle_zero_s = 0.0
        self._waiting: list[bytes] = []  # in the app's sockets
        self._n = 0

    def step(self) -> TickRecord | None:
        """One tick of the grid; with the app frozen the vehicle flies alone and its bytes wait."""
        self._n += 1
        self.now_s = self._n * self.tick_s
        self.stub.advance(max(0.0, self.now_s - self._vehicle_zero_s))
        for data in self.stub.take(OFFBOARD_LINK):
            if not self.deaf:
                self._wires.to_app.put(data, self.now_s)
        self._waiting += self._wires.to_app.due(self.now_s)
        if self.frozen:
            self._arrive()
            return None
        waiting, self._waiting = self._waiting, []
        for data in waiting:
            self.flight.receive(data, self.now_s)
        self.flight.resume(self.now_s, lambda: self.now_s)
        frames, record = self.flight.tick(self.now_s)
        self.send(frames)
        self.log.ticks.append(record)
        self.log.truth.append(self.stub.truth())
        return record

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            self.app_frames.append((self.now_s, frame))
            self._wires.to_vehicle.put(frame, self.now_s)
        self._arrive()

    def _arrive(self) -> None:
        for frame in self._wires.to_vehicle.due(self.now_s):
            self.stub.receive(OFFBOARD_LINK, frame)

    def freeze(self, for_s: float) -> None:
        """Hold the app up for so long; the vehicle flies on."""
        self.frozen = True
        self.run(for_s)
        self.frozen = False

    def restart_app(self) -> None:
        """A new process takes the place of the app: nothing is remembered."""
        self.flight = Flight(self.config)
        self._waiting = []

    def reboot_vehicle(self, stub_config: StubConfig, silent_s: float = 0.0) -> None:
        """The autopilot starts again after a silence, its clock at zero; where and how is for the caller to say."""
        self._vehicle_zero_s = self.now_s + silent_s
        self.stub = Stub(stub_config)
        self.pilot = Peer(self.stub)

    def run(self, for_s: float, *, until: Callable[[], bool] | None = None) -> Log:
        """Fly for so long, or until something holds."""
        end_s = self.now_s + for_s
        while self.now_s < end_s - 1e-9 and not (until is not None and until()):
            self.step()
        return self.log

    def engage(self) -> Rig:
        """Wait until the app is ready and let the pilot select Offboard."""
        self.run(20.0, until=lambda: bool(self.log.ticks) and bool(self.log.sent(self.now_s - 0.5)))
        self.pilot.mode(0x00060000)
        self.run(3.0, until=lambda: self.log.ticks[-1].phase in ENGAGED_NAMES)
        assert self.log.ticks[-1].phase in ENGAGED_NAMES, (self.log.phases, self.flight.events)
        return self

    def setpoints(self, from_s: float = 0.0) -> list[tuple[float, Any]]:
        """Return the decoded setpoints that the app sent."""
        return [(t, m) for t, m in self.decoded(from_s) if m.get_type().startswith("SET_")]

    def decoded(self, from_s: float = 0.0) -> list[tuple[float, Any]]:
        """Return every message that the app sent, decoded by pymavlink itself."""
        decoder = mavlink.MAVLink(None)
        return [(t, decoder.decode(bytearray(frame))) for t, frame in self.app_frames if t >= from_s]


def airborne(
    distance_m: float = 200.0,
    bearing_rad: float = 0.3,
    heading_rad: float = 0.0,
    height_m: float = 15.0,
    **more: Any,
) -> StubConfig:
    """Return a vehicle hovering in Hold at the origin, with the beacon at its own height."""
    more = {
        "step_s": 0.02,
        "beacon_east_m": distance_m * math.cos(bearing_rad),
        "beacon_north_m": distance_m * math.sin(bearing_rad),
        "beacon_height_m": height_m,
        "start_heading_rad": heading_rad,
        "start_height_m": height_m,
        **more,
    }
    return StubConfig(**more)
