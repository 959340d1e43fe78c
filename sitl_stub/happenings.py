"""What the faults of a timeline do to a stub when they begin and end.

A state holds while any line of its kind does: what ends is one line, and the others go on. Where lines disagree (two
values for one range) the one that began last counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from sitl_stub.faults import FRAME_FAULTS, MODES, Fault, assigned
from sitl_stub.foreign import ForeignVehicle

if TYPE_CHECKING:
    from sitl_stub.stub import Stub

GCS_COMPONENT = 190


def happen(stub: Stub, fault: Fault, begins: bool) -> None:
    """Apply a fault that begins, or undo one that ends."""
    if fault.kind in FRAME_FAULTS:
        _frames(stub, fault, begins)
    elif fault.kind in _EVENTS:
        _EVENTS[fault.kind](stub, fault)
    else:
        active = stub.active_faults.setdefault(fault.kind, [])
        active.append(fault) if begins else active.remove(fault)
        _STATES[fault.kind](stub, active)


def _frames(stub: Stub, fault: Fault, begins: bool) -> None:
    link = stub.links["offboard"]
    directions = ("in", "out") if fault.kind == "silence" else (fault.words[0],)
    for direction in directions:
        active = (link.way_in if direction == "in" else link.way_out).active
        active.append(fault) if begins else active.remove(fault)


# -- states: what holds while these lines are active -----------------------------------------------------------------

Active = Sequence[Fault]


def _range_stop(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.stopped = bool(active)


def _range_stick(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.stuck = bool(active)


def _range_add(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.add_m = sum(float(fault.words[0]) for fault in active)


def _range_value(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.value_m = float(active[-1].words[0]) if active else None


def _range_invalid(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.invalid = bool(active)


def _range_id(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.sensor_id = int(active[-1].words[0]) if active else None


def _range_orientation(stub: Stub, active: Active) -> None:
    if stub.radio is not None:
        stub.radio.faults.orientation = int(active[-1].words[0]) if active else None


def _refuse_arm(stub: Stub, active: Active) -> None:
    stub.autopilot.commander.refuse_arming = bool(active)


def _refuse_offboard(stub: Stub, active: Active) -> None:
    stub.autopilot.commander.refuse_offboard = bool(active)


def _deaf(stub: Stub, active: Active) -> None:
    stub.deaf = bool(active)


def _no_gps(stub: Stub, active: Active) -> None:
    stub.autopilot.commander.position_ok = stub.config.gps and not active


def _foreign(stub: Stub, active: Active) -> None:
    here = stub.foreigners
    stub.foreigners = {n: here.get(n) or ForeignVehicle(n, stub.now_s) for n in (int(f.words[0]) for f in active)}


# -- events ----------------------------------------------------------------------------------------------------------


def _gcs(stub: Stub, fault: Fault) -> None:
    stub.autopilot.commander.request_mode(MODES[fault.words[0]], stub.now_s, GCS_COMPONENT)


def _param(stub: Stub, fault: Fault) -> None:
    stub.autopilot.params.set(*assigned(fault))


def _pair(fault: Fault) -> tuple[float, float]:
    east, north = (float(part) for part in fault.words[0].split(","))
    return east, north


def _reboot(stub: Stub, fault: Fault) -> None:
    stub.reboot()


def _clock(stub: Stub, fault: Fault) -> None:
    stub.autopilot.jump_clock(float(fault.words[0]))


def _wind(stub: Stub, fault: Fault) -> None:
    stub.world.set_wind(*_pair(fault))


def _beacon(stub: Stub, fault: Fault) -> None:
    stub.world.put_beacon(*_pair(fault), stub.now_s)


_STATES: dict[str, Callable[[Stub, Active], None]] = {
    "range-stop": _range_stop,
    "range-stick": _range_stick,
    "range-add": _range_add,
    "range-value": _range_value,
    "range-invalid": _range_invalid,
    "range-id": _range_id,
    "range-orientation": _range_orientation,
    "refuse-arm": _refuse_arm,
    "refuse-offboard": _refuse_offboard,
    "deaf": _deaf,
    "no-gps": _no_gps,
    "foreign": _foreign,
}
_EVENTS: dict[str, Callable[[Stub, Fault], None]] = {
    "gcs": _gcs,
    "param": _param,
    "reboot": _reboot,
    "clock": _clock,
    "wind": _wind,
    "beacon": _beacon,
}
