"""MAV_CMD after MAV_CMD: what PX4 does with it and how it answers (PX4.md, 2, 3, 11).

What the receiver answers comes at once, what the commander decides 8 to 15 ms later; DO_SET_MODE gets both, and only
the second is true (3.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from sitl_stub.commander import ACCEPTED, DENIED, FAILED, TEMPORARILY_REJECTED, UNSUPPORTED
from sitl_stub.link import Link
from sitl_stub.modes import Mode, mode_of, shown_modes, title_of
from sitl_stub.streams import BUILDERS, CONDITIONS
from sitl_stub.wire import Message
from sitl_stub.world import HOME_AMSL_M, north_east_m

if TYPE_CHECKING:
    from sitl_stub.stub import Stub

COMMANDER_DELAY_S = 0.01
FORCE = 21196
COMMAND_ACK, MESSAGE_INTERVAL, AUTOPILOT_VERSION, PROTOCOL_VERSION, AVAILABLE_MODES = 77, 244, 148, 300, 435
CAPABILITIES, PX4_VERSION = 59647, 0x011000FF  # 1.16.0 release
MODE_LEAST_S = 0.5  # CURRENT_MODE follows vehicle_status: 2 Hz at most, and at once on a change
Params = tuple[float, ...]

NAV_TAKEOFF, DO_REPOSITION = 22, 192
CHANGE_MODE = 1  # DO_REPOSITION's flag in param2: without it PX4 does nothing
MODE_COMMANDS = {
    17: Mode.HOLD, 20: Mode.RTL, 21: Mode.LAND, NAV_TAKEOFF: Mode.TAKEOFF, DO_REPOSITION: Mode.HOLD, 300: Mode.MISSION,
}  # fmt: skip

INT32_MOST = 2**31 - 1


def take(stub: Stub, link: Link, message: Message, command: int, p: Params) -> None:
    """Carry out a command for the autopilot and acknowledge it."""
    if command == 176:
        _ack(stub, link, message, command, ACCEPTED)
        mode = mode_of(_whole(p[1]), _whole(p[2])) if _whole(p[0]) & 1 else None
        _request_mode(stub, link, message, command, mode)
    elif command == DO_REPOSITION and not _whole(p[1]) & CHANGE_MODE:
        _ack(stub, link, message, command, UNSUPPORTED, COMMANDER_DELAY_S)
    elif command in MODE_COMMANDS:
        if _request_mode(stub, link, message, command, MODE_COMMANDS[command]) != ACCEPTED:
            return
        if command == NAV_TAKEOFF:
            stub.autopilot.pilot.take_off_to(p[6] - HOME_AMSL_M)
        elif command == DO_REPOSITION:
            stub.autopilot.pilot.go_to(*_place(p))
    elif command in _BY_COMMANDER:
        _ack(stub, link, message, command, _BY_COMMANDER[command](stub, p), COMMANDER_DELAY_S)
    elif command in _BY_RECEIVER:
        _ack(stub, link, message, command, _BY_RECEIVER[command](stub, link, p))
    else:
        _ack(stub, link, message, command, UNSUPPORTED)


def _place(p: Params) -> tuple[float, float, float]:
    """Return north, east, height [m] of DO_REPOSITION; NaN: as it is."""
    if not (abs(p[4]) <= 90.0 and abs(p[5]) <= 180.0):
        return math.nan, math.nan, p[6] - HOME_AMSL_M
    return (*north_east_m(p[4], p[5]), p[6] - HOME_AMSL_M)


def set_mode(stub: Stub, link: Link, message: Message, custom_mode: int) -> None:
    """Take the old SET_MODE message: one truthful acknowledgement, for command 176."""
    _request_mode(stub, link, message, 176, mode_of((custom_mode >> 16) & 0xFF, custom_mode >> 24))


def _request_mode(stub: Stub, link: Link, message: Message, command: int, mode: Mode | None) -> int:
    result = TEMPORARILY_REJECTED
    if mode is not None:
        result = stub.autopilot.commander.request_mode(mode, stub.now_s, message.compid)
    _ack(stub, link, message, command, result, COMMANDER_DELAY_S)
    return result


def _ack(stub: Stub, link: Link, message: Message, command: int, result: int, after_s: float = 0.0) -> None:
    stub.send_later(after_s, link, COMMAND_ACK, (command, result, 0, 0, message.sysid, message.compid))


# -- the commander's -----------------------------------------------------------------------------------------------


def _arm_disarm(stub: Stub, p: Params) -> int:
    commander = stub.autopilot.commander
    if p[0] == 1.0:
        return commander.arm(stub.now_s)
    return commander.disarm(stub.now_s, p[1] == FORCE) if p[0] == 0.0 else DENIED


def _terminate(stub: Stub, p: Params) -> int:
    if p[0] > 0.5:
        stub.autopilot.commander.terminate()
    return ACCEPTED


def _reboot(stub: Stub, p: Params) -> int:
    if p[0] != 1.0:
        return DENIED
    if stub.autopilot.commander.armed:
        return TEMPORARILY_REJECTED
    stub.reboot()
    return ACCEPTED


# -- the receiver's ------------------------------------------------------------------------------------------------


def _set_interval(stub: Stub, link: Link, p: Params) -> int:
    msgid, interval_s = _whole(p[0]), p[1] * 1e-6
    if msgid not in BUILDERS or msgid == 0 or not math.isfinite(interval_s):
        return FAILED  # HEARTBEAT cannot be changed, and PX4 has no other streams
    if interval_s == 0.0:
        rate = stub.default_rates(link).get(msgid, 0.0)
        interval_s = 1.0 / rate if rate else -1.0
    if msgid == 436 and 0.0 < interval_s < MODE_LEAST_S:
        interval_s = MODE_LEAST_S
    if interval_s > 0.0:
        interval_s = max(interval_s, stub.config.step_s)  # PX4 too has a fastest rate
    link.set_interval(msgid, interval_s, stub.now_s)
    return ACCEPTED


def _get_interval(stub: Stub, link: Link, p: Params) -> int:
    interval = link.intervals_s.get(_whole(p[0]))
    stub.send(
        link,
        MESSAGE_INTERVAL,
        (_whole(p[0]) & 0xFFFF, -1 if interval is None else min(round(interval * 1e6), INT32_MOST)),
    )
    return ACCEPTED


def _request_message(stub: Stub, link: Link, p: Params) -> int:
    return _send_once(stub, link, _whole(p[0]), _whole(p[1]))


def _send_once(stub: Stub, link: Link, msgid: int, index: int = 0) -> int:
    if msgid in CONDITIONS and not CONDITIONS[msgid](stub.autopilot):
        return DENIED  # by PX4's source, not measured: there is nothing to tell
    if msgid in BUILDERS:
        stub.send(link, msgid, BUILDERS[msgid](stub.autopilot))
    elif msgid == AUTOPILOT_VERSION:
        versions = (CAPABILITIES, PX4_VERSION, PX4_VERSION, 0x0B0000FF, 0)
        stub.send(link, msgid, (*versions, bytes(8), bytes(8), bytes(8), 0, 0, stub.config.system_id, bytes(18)))
    elif msgid == PROTOCOL_VERSION:
        stub.send(link, msgid, (200, 100, 200, bytes(8), bytes(8)))
    elif msgid == AVAILABLE_MODES:
        _send_modes(stub, link, index)
    else:
        return UNSUPPORTED
    return ACCEPTED


def _send_modes(stub: Stub, link: Link, index: int) -> None:
    modes = shown_modes()
    for i, mode in enumerate(modes, start=1):
        if index in (0, i):
            stub.send(link, AVAILABLE_MODES, (len(modes), i, 0, int(mode), 0, title_of(mode).encode()))


def _accept(stub: Stub, link: Link, p: Params) -> int:
    return ACCEPTED


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else 0


_BY_COMMANDER: dict[int, Callable[[Stub, Params], int]] = {185: _terminate, 246: _reboot, 400: _arm_disarm}
_BY_RECEIVER: dict[int, Callable[[Stub, Link, Params], int]] = {
    178: _accept,  # DO_CHANGE_SPEED: accepted, and of no effect here
    179: _accept,  # DO_SET_HOME
    410: lambda stub, link, p: _send_once(stub, link, 242),
    510: _get_interval,
    511: _set_interval,
    512: _request_message,
    519: lambda stub, link, p: _send_once(stub, link, PROTOCOL_VERSION),
    520: lambda stub, link, p: _send_once(stub, link, AUTOPILOT_VERSION),
}
