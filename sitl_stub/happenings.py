"""What the faults of a timeline do to a stub when they begin and end."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sitl_stub.faults import FRAME_FAULTS, MODES, Fault
from sitl_stub.foreign import ForeignVehicle

if TYPE_CHECKING:
    from sitl_stub.stub import Stub

GCS_COMPONENT = 190


def check(stub: Stub, faults: list[Fault]) -> None:
    """Refuse a timeline that names what this vehicle does not have. ValueError in words."""
    for fault in faults:
        if fault.kind == "param" and fault.words[0].partition("=")[0] not in stub.autopilot.params:
            raise ValueError(f"fault {fault.line!r}: there is no such parameter")


def happen(stub: Stub, fault: Fault, begins: bool) -> None:
    """Apply a fault that begins, or undo one that ends."""
    if fault.kind in FRAME_FAULTS:
        _frames(stub, fault, begins)
    else:
        _ACTIONS[fault.kind](stub, fault, begins)


def _frames(stub: Stub, fault: Fault, begins: bool) -> None:
    link = stub.links["offboard"]
    directions = ("in", "out") if fault.kind == "silence" else (fault.words[0],)
    for direction in directions:
        active = (link.way_in if direction == "in" else link.way_out).active
        active.append(fault) if begins else active.remove(fault)


def _range(stub: Stub, fault: Fault, begins: bool) -> None:
    if stub.radio is None:
        return
    faults, value = stub.radio.faults, fault.words[0] if fault.words else ""
    if fault.kind == "range-stop":
        faults.stopped = begins
    elif fault.kind == "range-stick":
        faults.stuck = begins
    elif fault.kind == "range-add":
        faults.add_m += float(value) if begins else -float(value)
    elif fault.kind == "range-value":
        faults.value_m = float(value) if begins else None
    elif fault.kind == "range-invalid":
        faults.invalid = begins
    elif fault.kind == "range-id":
        faults.sensor_id = int(value) if begins else None
    elif fault.kind == "range-orientation":
        faults.orientation = int(value) if begins else None


def _refuse_arm(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.autopilot.commander.refuse_arming = begins


def _refuse_offboard(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.autopilot.commander.refuse_offboard = begins


def _deaf(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.deaf = begins


def _no_gps(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.autopilot.commander.position_ok = not begins


def _foreign(stub: Stub, fault: Fault, begins: bool) -> None:
    if begins:
        stub.foreigners[fault] = ForeignVehicle(int(fault.words[0]), stub.now_s)
    else:
        stub.foreigners.pop(fault, None)


def _gcs(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.autopilot.commander.request_mode(MODES[fault.words[0]], stub.now_s, GCS_COMPONENT)


def _param(stub: Stub, fault: Fault, begins: bool) -> None:
    name, _, value = fault.words[0].partition("=")
    stub.autopilot.params.set(name, float(value))


def _pair(fault: Fault) -> tuple[float, float]:
    east, north = (float(part) for part in fault.words[0].split(","))
    return east, north


def _reboot(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.reboot()


def _clock(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.autopilot.jump_clock(float(fault.words[0]))


def _wind(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.world.set_wind(*_pair(fault))


def _beacon(stub: Stub, fault: Fault, begins: bool) -> None:
    stub.world.put_beacon(*_pair(fault), stub.now_s)


_ACTIONS: dict[str, Callable[[Stub, Fault, bool], None]] = {
    "range-stop": _range,
    "range-stick": _range,
    "range-add": _range,
    "range-value": _range,
    "range-invalid": _range,
    "range-id": _range,
    "range-orientation": _range,
    "refuse-arm": _refuse_arm,
    "refuse-offboard": _refuse_offboard,
    "deaf": _deaf,
    "no-gps": _no_gps,
    "foreign": _foreign,
    "gcs": _gcs,
    "param": _param,
    "reboot": _reboot,
    "clock": _clock,
    "wind": _wind,
    "beacon": _beacon,
}
