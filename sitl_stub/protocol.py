"""What the autopilot answers to which message. Every handler takes the stub, the sender's link and the message."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sitl_stub import commands, offboard
from sitl_stub.commander import CRITICAL_TEXT
from sitl_stub.link import MAV_TYPE_GCS, Link
from sitl_stub.wire import Message
from sitl_stub.world import HOME_AMSL_M, north_east_m

if TYPE_CHECKING:
    from sitl_stub.stub import Stub

PARAM_VALUE, TIMESYNC, PING, FTP = 22, 111, 4, 110
FTP_NAK, FTP_FILE_NOT_FOUND = 129, 10


def handle(stub: Stub, link: Link, message: Message) -> None:
    """Answer one message, if there is anything to answer."""
    HANDLERS[message.msgid](stub, link, message)


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


def _setpoint(stub: Stub, result: offboard.Setpoint | offboard.Refused) -> None:
    if isinstance(result, offboard.Refused):
        stub.autopilot.commander.texts.append((CRITICAL_TEXT, result.text))
    else:
        stub.autopilot.take_setpoint(result)


def _local_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message) and not stub.deaf:
        _setpoint(stub, offboard.local_ned(message.fields, stub.autopilot.yaw_estimate()))


def _global_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message) and not stub.deaf:
        f, autopilot = message.fields, stub.autopilot
        n, e = north_east_m(f.lat_int * 1e-7, f.lon_int * 1e-7)
        n, e = n - autopilot.origin_n, e - autopilot.origin_e
        _setpoint(stub, offboard.global_int(f, n, e, autopilot.origin_h, HOME_AMSL_M))


def _attitude_setpoint(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message) and not stub.deaf:
        _setpoint(stub, offboard.attitude_target(message.fields))


def _manual_control(stub: Stub, link: Link, message: Message) -> None:
    f, autopilot = message.fields, stub.autopilot
    if f.target not in (0, stub.config.system_id) or int(autopilot.params["COM_RC_IN_MODE"]) not in (1, 2, 3):
        return
    values = (f.x / 1000.0, f.y / 1000.0, (f.z - 500.0) / 500.0, f.r / 1000.0)
    forward, right, up, clockwise = (min(max(v, -1.0), 1.0) for v in values)
    threshold = float(autopilot.params["COM_RC_STICK_OV"]) / 100.0
    moved = max(abs(forward), abs(right), abs(clockwise)) > threshold
    autopilot.pilot.sticks = (forward, right, up, clockwise)
    autopilot.commander.sticks_received(stub.now_s, moved)


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


# -- missions, files ---------------------------------------------------------------------------------------------


def _mission(stub: Stub, link: Link, message: Message) -> None:
    if not _for_us(stub, message):
        return
    f, missions, peer = message.fields, stub.autopilot.missions, (message.sysid, message.compid)
    reply = None
    if message.msgid == 43:
        reply = missions.list(peer, f.mission_type)
    elif message.msgid in (40, 51):
        reply = missions.item(peer, f.seq, f.mission_type, as_int=message.msgid == 51)
    elif message.msgid == 44:
        reply = missions.begin(peer, f.count, f.mission_type)
    elif message.msgid == 45:
        reply = missions.clear(peer, f.mission_type)
    elif message.msgid == 73:
        reply = missions.take(peer, tuple(f)[2:])
    elif message.msgid == 39:
        stored = tuple(f)[2:]
        reply = missions.take(peer, (*stored[:9], _degrees_e7(f.x), _degrees_e7(f.y), *stored[11:]))
    stub.autopilot.commander.has_mission = missions.total() > 0
    if reply is not None:
        stub.send(link, *reply)


def _degrees_e7(degrees: float) -> int:
    return round(degrees * 1e7) if abs(degrees) <= 180.0 else 0


def _file_transfer(stub: Stub, link: Link, message: Message) -> None:
    """No files: say so at once, or ground stations ask again for ten seconds."""
    f = message.fields
    if f.target_system not in (0, stub.config.system_id) or f.payload[3] >= 128:
        return
    seq = (f.payload[0] | f.payload[1] << 8) + 1
    head = struct.pack("<HBBBBBBI", seq & 0xFFFF, f.payload[2], FTP_NAK, 1, f.payload[3], 0, 0, 0)
    stub.send(link, FTP, (0, message.sysid, message.compid, (head + bytes((FTP_FILE_NOT_FOUND,))).ljust(251, b"\0")))


# -- a companion's range finder, echoed --------------------------------------------------------------------------


def _distance_sensor(stub: Stub, link: Link, message: Message) -> None:
    stub.hear_distance(link.name, echoed_distance(message.fields))


def echoed_distance(d: Any) -> tuple[Any, ...]:
    """Return a DISTANCE_SENSOR as PX4 sends it back: through float32 metres and truncation (PX4.md, 7)."""
    quality = 0 if d.signal_quality == 0 else min(max(100 * (d.signal_quality - 1) // 99, 1), 100)
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


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace")


def _command_long(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        f = message.fields
        params = (f.param1, f.param2, f.param3, f.param4, f.param5, f.param6, f.param7)
        commands.take(stub, link, message, f.command, params)


def _command_int(stub: Stub, link: Link, message: Message) -> None:
    if _for_us(stub, message):
        f = message.fields
        params = (f.param1, f.param2, f.param3, f.param4, f.x * 1e-7, f.y * 1e-7, f.z)
        commands.take(stub, link, message, f.command, params)


def _set_mode(stub: Stub, link: Link, message: Message) -> None:
    if message.fields.target_system == stub.config.system_id:
        commands.set_mode(stub, link, message, message.fields.custom_mode)


HANDLERS: dict[int, Callable[[Stub, Link, Message], None]] = {
    0: _heartbeat,
    4: _ping,
    11: _set_mode,
    20: _param_read,
    21: _param_list,
    23: _param_set,
    39: _mission,
    40: _mission,
    43: _mission,
    44: _mission,
    45: _mission,
    51: _mission,
    69: _manual_control,
    73: _mission,
    75: _command_int,
    76: _command_long,
    82: _attitude_setpoint,
    84: _local_setpoint,
    86: _global_setpoint,
    110: _file_transfer,
    111: _timesync,
    132: _distance_sensor,
}
