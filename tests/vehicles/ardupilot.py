"""An ArduPilot 4.6 as it was measured on the wire, small, for lockstep with the app. It shares nothing with the app.

Only what a companion can see of it: modes as plain numbers and an extra HEARTBEAT on every change, streams on request
alone, one ACK a command, GUIDED that stays GUIDED when setpoints stop, setpoints dropped in any other mode, a NaN that
leaves an internal error behind, ATTITUDE with the body's rates, and a plane that turns at 0.745 of a coordinated turn.
"""

from __future__ import annotations

import math
import random
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

G = 9.80665
COPTER, PLANE = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_TYPE_FIXED_WING
GUIDED = {COPTER: 4, PLANE: 15}
PARAMETERS = {
    COPTER: {
        "GUID_TIMEOUT": 3.0, "GUID_OPTIONS": 0.0, "FS_OPTIONS": 16.0, "FS_THR_ENABLE": 1.0, "WPNAV_SPEED": 1000.0,
        "WPNAV_ACCEL": 250.0, "SYSID_MYGCS": 255.0,
    },
    PLANE: {
        "STICK_MIXING": 1.0, "TKOFF_ALT": 100.0, "FS_LONG_ACTN": 0.0, "ROLL_LIMIT_DEG": 65.0, "AIRSPEED_CRUISE": 22.0,
        "SYSID_MYGCS": 255.0,
    },
}  # fmt: skip
LEAST_INTERVAL_US = {COPTER: 2500.0, PLANE: 25000.0}
EAS_TO_TAS, TURN_SHARE = 1.067, 0.745
SETPOINT_HELD_S = 3.0
STEP_S = 0.02
FARTHEST_CM = 65000


class FakeArduPilot:
    """`take` what it sent, `receive` what is sent to it, `advance` by one step."""

    def __init__(self, kind: int, mode: int, *, height_m: float = 0.0, beacon: tuple[float, float] = (300.0, 0.0)):
        self.kind, self.mode, self.height = kind, mode, height_m
        self.armed = height_m > 0.0
        self.status = 4 if self.armed else 3
        self.beacon_n, self.beacon_e = beacon
        self.beacon_height: float | None = None  # above home; None: always at the vehicle's
        self.now_s = 0.0
        self.n = self.e = self.climb = 0.0
        self.yaw = self.yaw_rate = self.roll = self.pitch = self.roll_rate = 0.0
        self.vn = self.ve = 0.0
        self.eas = 22.0 if kind == PLANE else 0.0
        self.target_height = height_m
        self.heading_target: float | None = None
        self.ekf_from_s = 0.0
        self.arm_from_s = 0.0
        self.parameters = dict(PARAMETERS[kind])
        self.radio = True
        self.commands: list[tuple[float, int, tuple[float, ...], int]] = []  # (t, command, parameters, result)
        self.texts: list[str] = []
        self.silences = 0
        self._setpoint: Any = None
        self._setpoint_s = -math.inf
        self._velocity = (0.0, 0.0)
        self._out: list[bytes] = []
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._radio_mav = mavlink.MAVLink(None, 1, 158)
        self._parser = mavlink.MAVLink(None)
        self._interval: dict[int, float] = {}
        self._next: dict[int, float] = {}
        self._heartbeat_next_s = self._range_next_s = 0.0
        self._random = random.Random(5)
        self.acknowledges = True

    # -- wire ------------------------------------------------------------------------------------------------------

    def take(self) -> list[bytes]:
        out, self._out = self._out, []
        return out

    def receive(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or []:
            kind = message.get_type()
            if kind in ("COMMAND_LONG", "COMMAND_INT"):
                self._command(message)
            elif kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
                value = self.parameters[message.param_id]
                self._send(mavlink.MAVLink_param_value_message(message.param_id.encode(), value, 9, 1, 0))
            elif kind in ("SET_ATTITUDE_TARGET", "SET_POSITION_TARGET_LOCAL_NED"):
                self._take_setpoint(message)

    def _send(self, message: Any) -> None:
        self._out.append(message.pack(self._mav))

    def set_mode(self, mode: int) -> None:
        """The switch of the pilot, or a command."""
        if mode != self.mode:
            self.mode, self.heading_target, self.target_height = mode, None, self.height
            self._setpoint_s = -math.inf
            self._heartbeat()

    def _command(self, m: Any) -> None:
        if m.get_type() == "COMMAND_LONG":
            params = tuple(getattr(m, f"param{i}") for i in range(1, 8))
        else:
            params = (m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z)
        result = self._do(m.command, params, getattr(m, "frame", 3))
        self.commands.append((self.now_s, m.command, params, result))
        if not self.acknowledges:
            return
        self._send(
            mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent())
        )

    def _do(self, command: int, p: tuple[float, ...], frame: int) -> int:
        if any(math.isnan(v) for v in p):
            self.status = 5
            return 2
        if command == 511:
            if 0 < p[1] < LEAST_INTERVAL_US[self.kind] or int(p[0]) not in STREAMS:
                self.texts.append(f"refused {int(p[0])}")
                return 2
            self._interval[int(p[0])] = p[1] / 1e6
            return 0
        if command == 512:
            if int(p[0]) == 0:
                self._heartbeat()
            return 0
        if command == 176:
            if self.kind == COPTER and int(p[1]) == GUIDED[COPTER] and self.now_s < self.ekf_from_s:
                return 4
            self.set_mode(int(p[1]))
            return 0
        if command == 400:
            if self.now_s < self.arm_from_s:
                return 4
            self.armed = p[0] == 1.0
            if self.armed and self.kind == PLANE and self.mode == 13:
                self.target_height, self.status = self.parameters["TKOFF_ALT"], 4
            return 0
        if command == 22:
            if not self.armed or self.mode != GUIDED[COPTER]:
                return 4
            self.target_height, self.status = p[6], 4
            return 0
        if command in (43001, 43002):
            if self.mode != GUIDED[PLANE]:
                return 4
            if command == 43002:
                self.heading_target = math.radians(p[1])
            elif p[6] <= 0.0:
                return 2
            elif p[2] == 0.0:  # with a rate it hardly climbs
                self.target_height = p[6]
            return 0
        return 3

    def _take_setpoint(self, m: Any) -> None:
        if self.mode != GUIDED[self.kind] or m.target_system not in (0, 1):
            return
        if self.kind == PLANE:
            if m.get_type() == "SET_ATTITUDE_TARGET" and m.type_mask == 254:
                self._setpoint, self._setpoint_s = m, self.now_s
            return
        good = m.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and m.coordinate_frame == 8 and m.type_mask == 1479
        if math.isnan(m.yaw_rate):
            self.status = 5
        if not good or math.isnan(m.vx + m.vy + m.vz + m.yaw_rate):
            self._setpoint_s = -math.inf
            return
        self._setpoint, self._setpoint_s = m, self.now_s
        c, s = math.cos(self.yaw), math.sin(self.yaw)  # turned into the ground's axes once, as it arrives
        self._velocity = (m.vx * c - m.vy * s, m.vx * s + m.vy * c)

    # -- motion ----------------------------------------------------------------------------------------------------

    def advance(self) -> None:
        self.now_s += STEP_S
        held_s = self.parameters.get("GUID_TIMEOUT", SETPOINT_HELD_S)
        fresh = self.mode == GUIDED[self.kind] and self.now_s - self._setpoint_s <= held_s
        if self.armed and (self.height > 0.0 or self.target_height > 0.0):
            (self._fly_plane if self.kind == PLANE else self._fly_copter)(fresh)
        self._stream()

    def _fly_copter(self, fresh: bool) -> None:
        vn, ve = self._velocity if fresh else (0.0, 0.0)
        climb = -self._setpoint.vz if fresh else max(-1.5, min(1.5, self.target_height - self.height))
        old = self.vn, self.ve
        self.vn += (vn - self.vn) * STEP_S / 0.62
        self.ve += (ve - self.ve) * STEP_S / 0.62
        self.climb += (climb - self.climb) * STEP_S / 0.4
        an = (self.vn - old[0]) / STEP_S + 0.445 * self.vn
        ae = (self.ve - old[1]) / STEP_S + 0.445 * self.ve
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        self.pitch, self.roll = -math.atan2(an * c + ae * s, G), math.atan2(ae * c - an * s, G)
        asked = self._setpoint.yaw_rate if fresh else 0.0
        self.yaw_rate += (asked / (math.cos(self.pitch) * math.cos(self.roll)) - self.yaw_rate) * STEP_S / 0.25
        if fresh:
            self.target_height = self.height
        self._move()

    def _fly_plane(self, fresh: bool) -> None:
        tas = self.eas * EAS_TO_TAS
        if fresh:
            w, x = self._setpoint.q[0], self._setpoint.q[1]
            roll = 2.0 * math.atan2(x, w)
        elif self.mode == GUIDED[PLANE] and self.heading_target is not None:
            error = math.remainder(self.heading_target - self.yaw, 2 * math.pi)
            roll = max(-0.47, min(0.47, error))
        else:
            roll = 0.6 if self.mode == GUIDED[PLANE] else 0.0
        acc = 20.0 * (roll - self.roll) - 4.4 * self.roll_rate  # 4.5 rad/s, damping 0.49: 17 % overshoot
        self.roll_rate += acc * STEP_S
        self.roll += self.roll_rate * STEP_S
        self.yaw_rate = TURN_SHARE * G * math.tan(self.roll) / tas
        self.pitch = 0.03
        self.climb += (max(-2.0, min(4.0, 0.4 * (self.target_height - self.height))) - self.climb) * STEP_S / 0.8
        self.vn, self.ve = tas * math.cos(self.yaw), tas * math.sin(self.yaw)
        self._move()

    def _move(self) -> None:
        self.yaw = math.remainder(self.yaw + self.yaw_rate * STEP_S, 2 * math.pi)
        self.n += self.vn * STEP_S
        self.e += self.ve * STEP_S
        self.height = max(0.0, self.height + self.climb * STEP_S)

    @property
    def range_m(self) -> float:
        return math.hypot(self.beacon_n - self.n, self.beacon_e - self.e)

    # -- what it sends ---------------------------------------------------------------------------------------------

    def _heartbeat(self) -> None:
        base = 89 | (128 if self.armed else 0)
        self._send(mavlink.MAVLink_heartbeat_message(self.kind, 3, base, self.mode, self.status, 3))

    def _stream(self) -> None:
        if self.now_s >= self._heartbeat_next_s:
            self._heartbeat_next_s = self.now_s + 1.0
            self._heartbeat()
        for msgid, interval_s in self._interval.items():
            if interval_s > 0.0 and self.now_s >= self._next.get(msgid, 0.0) - 1e-9:
                self._next[msgid] = self.now_s + interval_s
                self._send(STREAMS[msgid](self))
        if self.radio and self.now_s >= self._range_next_s:
            self._range_next_s = self.now_s + 0.1
            down = 0.0 if self.beacon_height is None else self.height - self.beacon_height
            cm = round(100.0 * (math.hypot(self.range_m, down) + self._random.gauss(0.0, 0.3)))
            if 10 <= cm <= FARTHEST_CM:
                ms = round(self.now_s * 1e3)
                message = mavlink.MAVLink_distance_sensor_message(ms, 10, FARTHEST_CM, cm, 0, 7, 0, 255)
                self._out.append(message.pack(self._radio_mav))


def attitude(a: FakeArduPilot) -> Any:
    """The body's rates, as the gyros have them."""
    body = (
        a.roll_rate - a.yaw_rate * math.sin(a.pitch),
        a.yaw_rate * math.sin(a.roll) * math.cos(a.pitch),
        a.yaw_rate * math.cos(a.roll) * math.cos(a.pitch),
    )
    return mavlink.MAVLink_attitude_message(round(a.now_s * 1e3), a.roll, a.pitch, a.yaw, *body)


def local_position(a: FakeArduPilot) -> Any:
    return mavlink.MAVLink_local_position_ned_message(round(a.now_s * 1e3), a.n, a.e, -a.height, a.vn, a.ve, -a.climb)


def global_position(a: FakeArduPilot) -> Any:
    mm = round(a.height * 1e3)
    return mavlink.MAVLink_global_position_int_message(round(a.now_s * 1e3), 0, 0, 584000 + mm, mm, 0, 0, 0, 0)


def vfr_hud(a: FakeArduPilot) -> Any:
    speed = math.hypot(a.vn, a.ve)
    eas = a.eas if a.height > 0.0 else 0.0
    return mavlink.MAVLink_vfr_hud_message(eas, speed, 0, 48, 584.0 + a.height, a.climb)


def ekf(a: FakeArduPilot) -> Any:
    flags = 0x33F if a.now_s >= a.ekf_from_s else 0xA7
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.1)


def sys_state(a: FakeArduPilot) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(0, 2 if a.height > 0.3 else 1)


def sys_status(a: FakeArduPilot) -> Any:
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0)


def battery(a: FakeArduPilot) -> Any:
    return mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, [12000] + [65535] * 9, 0, 0, 0, 90, 0, 1)


STREAMS = {
    1: sys_status,
    30: attitude,
    32: local_position,
    33: global_position,
    74: vfr_hud,
    147: battery,
    193: ekf,
    245: sys_state,
}
