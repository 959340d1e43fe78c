"""What no flight may ever break, read off the frames that the app sent; and what tests of trust look at."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from tests.lockstep import ENGAGED_NAMES, Rig

OFFBOARD, HOLD, RETURN, LAND, POSITION = 0x00060000, 0x03040000, 0x05040000, 0x06040000, 0x00030000
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE


def engage(rig: Rig, tries: int = 8) -> Rig:
    """Let the pilot select Offboard until it takes: on a bad link the first setpoints may not have arrived."""
    rig.run(5.0)
    for _ in range(tries):
        rig.pilot.mode(OFFBOARD)
        rig.run(1.5)
        if rig.log.ticks[-1].control == "held":
            return rig
    raise AssertionError(f"not engaged: {rig.flight.events}")


def mode_requests(rig: Rig, from_s: float = 0.0) -> list[tuple[float, int]]:
    """Return (time, custom_mode) of every mode that the app asked for, by whatever message can ask for one."""
    found = []
    for t, m in rig.decoded(from_s):
        if m.get_type() in ("COMMAND_LONG", "COMMAND_INT") and m.command == SET_MODE:
            found.append((t, int(m.param2) << 16 | int(m.param3) << 24))
        elif m.get_type() == "SET_MODE":
            found.append((t, m.custom_mode))
        elif m.get_type() in ("COMMAND_LONG", "COMMAND_INT") and m.command in (16, 17, 20, 21, 22, 92, 185, 252, 300):
            found.append((t, m.command))
    return found


def texts(rig: Rig, from_s: float = 0.0) -> list[str]:
    """Return what the app told the ground station, chunks put together."""
    whole: list[str] = []
    for _, m in rig.decoded(from_s):
        if m.get_type() == "STATUSTEXT":
            if m.chunk_seq:
                whole[-1] += m.text
            else:
                whole.append(m.text)
    return whole


def keep_the_rules(rig: Rig) -> None:
    """Finite, within limits, at the right vehicle, in the right form, none from a stale range or after release."""
    limits, orbit, ranging = rig.config.limits, rig.config.orbit, rig.config.ranging
    for t, m in rig.setpoints():
        values = (m.vx, m.vy, m.vz, m.yaw_rate)
        assert all(math.isfinite(v) for v in values), (t, m)
        assert abs(m.yaw_rate) <= limits.turn_rate_rad_s + 1e-6, (t, m)
        assert math.hypot(m.vx, m.vy) <= orbit.speed_m_s + 1e-4, (t, m)
        assert (m.target_system, m.target_component) == (rig.stub.config.system_id, 1), (t, m)
        assert (m.coordinate_frame, m.type_mask) == (8, 1479), (t, m)
    released_s = math.inf
    before = ""
    for tick in rig.log.ticks:
        sends = tick.turn_rate_sent_rad_s == tick.turn_rate_sent_rad_s
        if tick.phase in ENGAGED_NAMES and sends:
            assert tick.sample_age_s <= max(ranging.coast_s, ranging.max_age_s) + 1e-6, tick
        released_s = min(released_s, tick.t_s) if tick.control == "released" else math.inf
        assert not (sends and before == tick.control and before in ("released", "given back")), tick
        before = tick.control
    if math.isfinite(released_s):
        assert mode_requests(rig, released_s + 1e-6) == []


def last_setpoint_s(rig: Rig) -> float:
    """Return when the last setpoint left."""
    return rig.setpoints()[-1][0]


def first_shown_s(rig: Rig, shows: Any) -> float:
    """Return the time of the first tick whose record shows something."""
    return next(t.t_s for t in rig.log.ticks if shows(t))
