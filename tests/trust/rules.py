"""What no flight may ever break, read off the frames that the app sent; and what tests of trust look at."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config import Config
from circumnav_mav.flight_record import TickRecord
from tests.lockstep import ENGAGED_NAMES, Rig
from tests.trust.setpoint_rules import JUDGES

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
    return requests(rig.decoded(from_s))


def requests(sent: list[tuple[float, Any]]) -> list[tuple[float, int]]:
    """The same, of decoded messages; a command that changes the mode on its way counts as one."""
    found = []
    for t, m in sent:
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


def keep_the_rules(rig: Rig, *, restarted: bool = False) -> None:
    """Hold a flight of the stub to the rules. restarted: the autopilot was, at some time."""
    keep(rig.config, rig.stub.config.system_id, rig.decoded(), rig.log.ticks, restarted=restarted)


def keep(
    config: Config, sysid: int, sent: list[tuple[float, Any]], ticks: list[TickRecord], *, restarted: bool = False
) -> None:
    """Finite, within limits, at the right vehicle, in the right form, none from a stale range or after release.

    sent: every message that left the app, with its time. A restarted autopilot is asked for its streams, whoever flies.
    """
    ranging, judge = config.ranging, JUDGES[config.vehicle.kind]
    for t, m in sent:
        if m.get_type().startswith("SET_"):
            assert (m.target_system, m.target_component) == (sysid, 1), (t, m)
            try:
                judge(m, config)
            except AssertionError as error:
                raise AssertionError(f"{t:.2f} s: {error}") from error
        elif hasattr(m, "target_system") and m.get_type() not in ("COMMAND_ACK",):
            assert m.target_system == sysid, (t, m)
    asked = {t for t, _ in requests(sent)}
    released_s = math.inf
    before = ""
    for tick in ticks:
        sends = tick.turn_rate_sent_rad_s == tick.turn_rate_sent_rad_s
        if tick.phase in ENGAGED_NAMES and sends:
            assert tick.sample_age_s <= max(ranging.coast_s, ranging.max_age_s) + 1e-6, tick
        if sends and tick.control == "not held":  # the stream that a pilot engages: it must not steer
            assert tick.turn_rate_sent_rad_s == 0.0, tick
        if tick.t_s in asked:
            assert tick.control in ("asked for", "giving back", "given back") or config.engage == "auto", tick
        released_s = min(released_s, tick.t_s) if tick.control == "released" else math.inf
        assert not (sends and before == tick.control and before in ("released", "given back")), tick
        before = tick.control
    if math.isfinite(released_s):
        after = [(t, m) for t, m in sent if t >= released_s - 1e-6]
        assert requests([(t, m) for t, m in after if t >= released_s + 1e-6]) == []
        assert beyond_talk(after, streams=restarted) == []


def beyond_talk(messages: list[tuple[float, Any]], *, streams: bool = False) -> list[tuple[float, Any]]:
    """Return what may not leave after a release: all but heartbeats, answers, texts, the circle on the map, requests to
    be told the mode (streams: and for any stream).
    """
    talk = ("HEARTBEAT", "TIMESYNC", "STATUSTEXT", "COMMAND_ACK", "ORBIT_EXECUTION_STATUS")

    def asks_to_be_told(m: Any) -> bool:
        if m.get_type() != "COMMAND_LONG":
            return False
        if streams and m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return True
        return m.command == mavlink.MAV_CMD_REQUEST_MESSAGE and m.param1 in (0, 436)

    return [(t, m) for t, m in messages if m.get_type() not in talk and not asks_to_be_told(m)]


def last_setpoint_s(rig: Rig) -> float:
    """Return when the last setpoint left."""
    return rig.setpoints()[-1][0]


def first_shown_s(rig: Rig, shows: Any) -> float:
    """Return the time of the first tick whose record shows something."""
    return next(t.t_s for t in rig.log.ticks if shows(t))
