"""A companion in memory: pymavlink's own codec (not the stub's) against a Stub on simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig

VELOCITY_MASK = 1479  # use velocity and yaw rate
OFFBOARD, HOLD = 0x00060000, 0x03040000
HERE = math.nan
FAST_STREAMS = {30, 31, 105, 33, 32, 331, 111, 141, 132, 83, 85, 36, 24}


class Rig:
    """Companion 1/191 (or another) on one link of a stub. Everything heard is kept as (time [s], message)."""

    def __init__(self, link: str = "offboard", compid: int = 191, streams: tuple[int, ...] = (), **fields: Any):
        """`streams`: fast ones to keep; the others are switched off, which makes a test ten times faster."""
        self.stub = Stub(StubConfig(**{"radio": False, **fields}))
        for msgid in FAST_STREAMS - set(streams):
            self.stub.links["offboard"].set_interval(msgid, 0.0, 0.0)
        self.link = link
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=compid)
        self.mav.robust_parsing = True
        self.heard: list[tuple[float, Any]] = []
        self.streaming: Callable[[float], Any] | None = None
        self.stream_period_s = 0.05
        self._next_stream_s = 0.0
        self.system_id = self.stub.config.system_id

    @property
    def now_s(self) -> float:
        return self.stub.now_s

    def send(self, message: Any) -> None:
        self.stub.receive(self.link, message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def run(self, seconds: float, dt_s: float = 0.01) -> None:
        """Let time pass, streaming setpoints if `streaming` is set."""
        dt_s = max(dt_s, self.stub.config.step_s)
        end_s = self.stub.now_s + seconds
        while self.stub.now_s < end_s - 1e-9:
            if self.streaming is not None and self.stub.now_s >= self._next_stream_s - 1e-9:
                self.send(self.streaming(self.stub.now_s))
                self._next_stream_s = self.stub.now_s + self.stream_period_s
            self.stub.advance(self.stub.now_s + dt_s)
            self.listen()

    def listen(self) -> None:
        for datagram in self.stub.take(self.link):
            for message in self.mav.parse_buffer(datagram) or []:
                self.heard.append((self.stub.now_s, message))

    def all(self, kind: str, since_s: float = 0.0, source: tuple[int, int] | None = None) -> list[Any]:
        """Return messages of a type heard since a time, by default from the autopilot."""
        who = source or (self.system_id, 1)
        return [
            m
            for t, m in self.heard
            if t >= since_s and m.get_type() == kind and (m.get_srcSystem(), m.get_srcComponent()) == who
        ]

    def texts(self, since_s: float = 0.0) -> list[str]:
        return [m.text for m in self.all("STATUSTEXT", since_s)]

    def acks(self, command: int, since_s: float = 0.0) -> list[int]:
        return [m.result for m in self.all("COMMAND_ACK", since_s) if m.command == command]

    def command(self, command: int, *params: float, run_s: float = 0.1) -> list[int]:
        """Send a COMMAND_LONG and return the results of its acknowledgements."""
        began_s = self.now_s
        full = [*params, *([0.0] * (7 - len(params)))]
        self.send(mavlink.MAVLink_command_long_message(self.system_id, 1, command, 0, *full))
        self.listen()
        self.run(run_s)
        return self.acks(command, began_s)

    def set_mode(self, custom_mode: int, run_s: float = 0.1) -> list[int]:
        return self.command(176, 1, (custom_mode >> 16) & 0xFF, custom_mode >> 24, run_s=run_s)

    def gcs_heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def enter_offboard(self, setpoint: Callable[[float], Any]) -> None:
        self.streaming = setpoint
        self.run(0.1)
        assert self.set_mode(OFFBOARD) == [0, 0]
        assert self.mode == "OFFBOARD"

    @property
    def mode(self) -> str:
        return self.stub.truth().mode

    def local(
        self,
        frame: int = 8,
        mask: int = VELOCITY_MASK,
        place: tuple[float, float, float] = (0, 0, 0),
        velocity: tuple[float, float, float] = (0, 0, 0),
        acceleration: tuple[float, float, float] = (0, 0, 0),
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        target: tuple[int, int] | None = None,
    ) -> Any:
        """Return a SET_POSITION_TARGET_LOCAL_NED."""
        sysid, compid = target or (self.system_id, 1)
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, sysid, compid, frame, mask, *place, *velocity, *acceleration, yaw, yaw_rate
        )

    def attitude(
        self, roll: float, pitch: float, yaw: float, thrust: float, mask: int = 7, yaw_rate: float = 0.0
    ) -> Any:
        """Return a SET_ATTITUDE_TARGET."""
        return self.attitude_q(quaternion(roll, pitch, yaw), thrust, mask, yaw_rate)

    def attitude_q(self, q: tuple[float, float, float, float], thrust: float, mask: int = 7, yaw_rate: float = 0.0):
        return mavlink.MAVLink_set_attitude_target_message(
            0, self.system_id, 1, mask, list(q), 0.0, 0.0, yaw_rate, thrust
        )


def flying(height_m: float = 30.0, **fields: Any) -> Rig:
    """Return a rig whose multirotor hovers in Hold, with a moment of flight behind it."""
    rig = Rig(start_height_m=height_m, **{"height_drift_m_s": 0.0, **fields})
    rig.run(0.5)
    return rig


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z: the product of the three single turns, yaw first."""
    return product(
        (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)),
        product(
            (math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0), (math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0)
        ),
    )


def product(a: tuple[float, float, float, float], b: tuple[float, float, float, float]):
    w, x, y, z = a
    p, q, r, s = b
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def first_time(rig: Rig, what: Callable[[], bool], within_s: float, dt_s: float = 0.01) -> float:
    """Run until something holds and return how long that took [s]; infinity if it never did."""
    began_s = rig.now_s
    while rig.now_s < began_s + within_s:
        rig.run(dt_s)
        if what():
            return rig.now_s - began_s
    return math.inf
