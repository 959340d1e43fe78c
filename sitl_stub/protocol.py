"""What the autopilot answers to which message. Every handler takes the sender's link and the decoded message."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sitl_stub import offboard
from sitl_stub.commander import ACCEPTED, CRITICAL_TEXT, DENIED, FAILED, TEMPORARILY_REJECTED, UNSUPPORTED
from sitl_stub.link import MAV_TYPE_GCS, Link
from sitl_stub.modes import Mode, mode_of
from sitl_stub.streams import BUILDERS
from sitl_stub.wire import Message
from sitl_stub.world import HOME_AMSL_M, north_east_m

if TYPE_CHECKING:
    from sitl_stub.stub import Stub

COMMANDER_DELAY_S = 0.01  # what the commander answers comes 8 to 15 ms later
FORCE_DISARM = 21196
PARAM_VALUE, COMMAND_ACK, TIMESYNC, PING = 22, 77, 111, 4
CURRENT_MODE_LEAST_S = 0.5  # CURRENT_MODE follows vehicle_status: 2 Hz at most, and at once on a change


def handle(stub: Stub, link: Link, message: Message) -> None:
    """Answer one message, if there is anything to answer."""
    handler = HANDLERS.get(message.msgid)
    if handler is not None:
        handler(stub, link, message)


def _for_us(stub: Stub, message: Message) -> bool:
    fields = message.fields
    return fields.target_system in (0, stub.config.system_id) and fields.target_component in (0, 1)


def _heartbeat(stub: Stub, link: Link, message: Message) -> None:
    if message.fields.type == MAV_TYPE_GCS:
        link.gcs_heard_s = stub.now_s


def _ping(stub: Stub, link: Link, message: Message) -> None:
    f = message.fields
    if f.target_system == 0 and f.target_component == 0:
        stub.send(link, PING, (f.time_usec, f.seq, message.sysid, message.compid))


def _timesync(stub: Stub, link: Link, message: Message) -> None:
    if message.fields.tc1 == 0:
        stub.send(link, TIMESYNC, (stub.autopilot.boot_us * 1000, message.fields.ts1))


# -- setpoints ---------------------------------------------------------------------------------------------------


def _setpoint(stub: Stub, message: Message, result: offboard.Setpoint | offboard.Refused) -> None:
    if isinstance(result, offboard.Refused):
        stub.autopilot.commander.texts.append((CRITICAL_TEXT, result.text))
    else:
        stub.autopilot.take_setpoint(result)


def _local_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        _setpoint(stub, message, offboard.local_ned(message.fields, stub.autopilot.yaw_estimate()))


def _global_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        f, autopilot = message.fields, stub.autopilot
        n, e = north_east_m(f.lat_int * 1e-7, f.lon_int * 1e-7)
        _setpoint(stub, message, offboard.global_int(f, n - autopilot.origin_n, e - autopilot.origin_e, HOME_AMSL_M))


def _attitude_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        _setpoint(stub, message, offboard.attitude_target(message.fields))


def _manual_control(stub: Stub, link: Link, message: Message) -> None:
    f = message.fields
    if f.target not in (0, stub.config.system_id) or int(stub.autopilot.params["COM_RC_IN_MODE"]) not in (1, 2, 3):
        return
    forward, right, up, clockwise = f.x / 1000.0, f.y / 1000.0, (f.z - 500.0) / 500.0, f.r / 1000.0
    threshold = float(stub.autopilot.params["COM_RC_STICK_OV"]) / 100.0
    moved = max(abs(forward), abs(right), abs(clockwise)) > threshold
    stub.autopilot.pilot.sticks = (forward, right, up, clockwise)
    stub.autopilot.commander.sticks_received(stub.now_s, moved)


# -- parameters --------------------------------------------------------------------------------------------------


def _param_read(stub: Stub, link: Link, message: Message) -> None:
    if not _for_us(stub, message):
        return
    params, index = stub.autopilot.params, message.fields.param_index
    name = params.names[index] if 0 <= index < len(params) else _text(message.fields.param_id)
    if name in params:
        stub.send(link, PARAM_VALUE, params.wire(name))


def _param_list(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        for name in stub.autopilot.params:
            stub.send(link, PARAM_VALUE, stub.autopilot.params.wire(name))


def _param_set(stub: Stub, link: Link, message: Message) -> None:
    f = message.fields
    name = _text(f.param_id)
    params = stub.autopilot.params
    if _for_us(stub, message) and params.set_from_wire(name, f.param_value, f.param_type):
        stub.send_everywhere(PARAM_VALUE, params.wire(name))


# -- commands ----------------------------------------------------------------------------------------------------


def _command_long(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        f = message.fields
        params = (f.param1, f.param2, f.param3, f.param4, f.param5, f.param6, f.param7)
        _command(stub, link, message, f.command, params)


def _command_int(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        f = message.fields
        params = (f.param1, f.param2, f.param3, f.param4, f.x * 1e-7, f.y * 1e-7, f.z)
        _command(stub, link, message, f.command, params)


def _set_mode(stub: Stub, link: Link, message: Message) -> None:
    if message.fields.target_system == stub.config.system_id:
        word = message.fields.custom_mode
        _request_mode(stub, link, message, 176, mode_of((word >> 16) & 0xFF, word >> 24))


Params = tuple[float, ...]


def _command(stub: Stub, link: Link, message: Message, command: int, p: Params) -> None:
    commander = stub.autopilot.commander
    if command == 176:
        _ack(stub, link, message, command, ACCEPTED)  # the receiver's word, not the commander's (PX4.md, 3.1)
        mode = mode_of(_whole(p[1]), _whole(p[2])) if _whole(p[0]) & 1 else None
        _request_mode(stub, link, message, command, mode)
    elif command == 400:
        if p[0] == 1.0:
            _verdict(stub, link, message, command, commander.arm(stub.now_s))
        elif p[0] == 0.0:
            _verdict(stub, link, message, command, commander.disarm(stub.now_s, p[1] == FORCE_DISARM))
        else:
            _verdict(stub, link, message, command, DENIED)
    elif command in _MODE_COMMANDS:
        if command == 22:
            stub.autopilot.pilot.takeoff_height_m = p[6] - HOME_AMSL_M
        _request_mode(stub, link, message, command, _MODE_COMMANDS[command])
    elif command == 185:
        if p[0] > 0.5:
            commander.terminate()
        _verdict(stub, link, message, command, ACCEPTED)
    elif command == 511:
        _ack(stub, link, message, command, _set_interval(stub, link, _whole(p[0]), p[1]))
    elif command == 510:
        interval = link.intervals_s.get(_whole(p[0]))
        stub.send(link, 244, (_whole(p[0]) & 0xFFFF, -1 if interval is None else round(interval * 1e6)))
        _ack(stub, link, message, command, ACCEPTED)
    elif command in (512, 519, 520, 410):
        wanted = {519: 300, 520: 148, 410: 242}.get(command, _whole(p[0]))
        _ack(stub, link, message, command, _send_once(stub, link, wanted, _whole(p[1])))
    else:
        _ack(stub, link, message, command, UNSUPPORTED)


_MODE_COMMANDS = {22: Mode.TAKEOFF, 21: Mode.LAND, 20: Mode.RTL, 17: Mode.HOLD, 300: Mode.MISSION}


def _request_mode(stub: Stub, link: Link, message: Message, command: int, mode: Mode | None) -> None:
    if mode is None:
        _verdict(stub, link, message, command, TEMPORARILY_REJECTED)
    else:
        _verdict(stub, link, message, command, stub.autopilot.commander.request_mode(mode, stub.now_s, message.compid))


def _set_interval(stub: Stub, link: Link, msgid: int, interval_us: float) -> int:
    if msgid not in BUILDERS or msgid == 0:
        return FAILED
    interval_s = interval_us * 1e-6
    if interval_us == 0.0:
        rate = stub.default_rates(link).get(msgid, 0.0)
        interval_s = 1.0 / rate if rate else -1.0
    if msgid == 436 and 0.0 < interval_s < CURRENT_MODE_LEAST_S:
        interval_s = CURRENT_MODE_LEAST_S
    link.set_interval(msgid, interval_s, stub.now_s)
    return ACCEPTED


def _send_once(stub: Stub, link: Link, msgid: int, index: int) -> int:
    if msgid in BUILDERS:
        stub.send(link, msgid, BUILDERS[msgid](stub.autopilot))
    elif msgid == 148:
        stub.send(link, msgid, _autopilot_version(stub.config.system_id))
    elif msgid == 300:
        stub.send(link, msgid, (200, 100, 200, bytes(8), bytes(8)))
    else:
        return UNSUPPORTED
    return ACCEPTED


def _autopilot_version(uid: int) -> tuple[object, ...]:
    return (59647, 0x011000FF, 0x011000FF, 0x0B0000FF, 0, bytes(8), bytes(8), bytes(8), 0, 0, uid, bytes(18))


def _ack(stub: Stub, link: Link, message: Message, command: int, result: int, after_s: float = 0.0) -> None:
    stub.send_later(after_s, link, COMMAND_ACK, (command, result, 0, 0, message.sysid, message.compid))


def _verdict(stub: Stub, link: Link, message: Message, command: int, result: int) -> None:
    _ack(stub, link, message, command, result, COMMANDER_DELAY_S)


# -- a companion's range finder, echoed ---------------------------------------------------------------------------


def _distance_sensor(stub: Stub, link: Link, message: Message) -> None:
    stub.hear_distance(link.name, echoed_distance(message.fields))


def echoed_distance(d: Any) -> tuple[Any, ...]:
    """Return a DISTANCE_SENSOR as PX4 sends it back: through float32 metres and truncation (PX4.md, 7)."""
    quality = 0 if d.signal_quality == 0 else max(1, 100 * (d.signal_quality - 1) // 99)
    return (
        _through_metres(d.min_distance), _through_metres(d.max_distance), _through_metres(d.current_distance),
        d.type, d.orientation, int(_f32(_f32(d.covariance * _f32(1e-4)) * 1e4)), d.horizontal_fov, d.vertical_fov,
        d.quaternion, quality,
    )  # fmt: skip


def _through_metres(cm: int) -> int:
    return int(_f32(_f32(cm * _f32(1e-2)) * 1e2))


def _f32(value: float) -> float:
    rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return rounded


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else 0


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace")


HANDLERS: dict[int, Callable[[Stub, Link, Message], None]] = {
    0: _heartbeat,
    4: _ping,
    11: _set_mode,
    20: _param_read,
    21: _param_list,
    23: _param_set,
    69: _manual_control,
    75: _command_int,
    76: _command_long,
    82: _attitude_setpoint,
    84: _local_setpoint,
    86: _global_setpoint,
    111: _timesync,
    132: _distance_sensor,
}
