"""The table of docs/safety.md, row by row: a cause, what the app does within what time, what the operator reads."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub.streams import BUILDERS
from tests.lockstep import OFFBOARD_LINK, Peer, Rig, airborne, config
from tests.trust.rules import (
    HOLD,
    LAND,
    OFFBOARD,
    RETURN,
    engage,
    keep_the_rules,
    last_setpoint_s,
    mode_requests,
    texts,
)

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
BATTERY_STATUS, ESTIMATOR_STATUS, SYS_STATUS, ATTITUDE, LOCAL_POSITION = 147, 230, 1, 30, 32
PLANE = {
    "vehicle": {"class": "px4_fixed_wing"},
    "orbit": {"radius_m": 80.0, "speed_m_s": 12.0},
    "limits": {"turn_accel_rad_s2": 0.5},
}
PLANE_WORLD = {"airframe": "fixed_wing", "height_m": 60.0, "start_speed_m_s": 13.0}
HEIGHT = (33, 32, 74)  # GLOBAL_POSITION_INT, LOCAL_POSITION_NED, VFR_HUD


def silence(rig: Rig, msgids: tuple[int, ...]) -> None:
    """The autopilot stops some of its streams on the app's link."""
    for msgid in msgids:
        Peer(rig.stub, 1, 200, OFFBOARD_LINK).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(msgid), -1.0)


def shows(msgid: int, index: int, value: Any) -> Callable[[Rig, pytest.MonkeyPatch], None]:
    """The autopilot shows another value in one field of a stream."""

    def act(rig: Rig, patch: pytest.MonkeyPatch) -> None:
        honest = BUILDERS[msgid]

        def build(a: Any) -> tuple[Any, ...]:
            values = list(honest(a))
            values[index] = value
            return tuple(values)

        patch.setitem(BUILDERS, msgid, build)

    return act


def bend_ranges(rig: Rig, patch: pytest.MonkeyPatch, bend: Callable[[float, float], float]) -> None:
    """Ranges become bend(true range, seconds since now)."""
    true, began_s = rig.stub.world.range_and_rate, rig.stub.now_s

    def bent(t_s: float, v: Any) -> tuple[float, float]:
        range_m, rate_m_s = true(t_s, v)
        return bend(range_m, t_s - began_s), rate_m_s

    patch.setattr(rig.stub.world, "range_and_rate", bent)


def moved_beacon(rig: Rig, patch: pytest.MonkeyPatch) -> None:
    """Every 5 s the beacon is elsewhere, and nowhere twice within half a minute: no ranges that belong together."""
    bend_ranges(rig, patch, lambda r, t: r + 20.0 * (3 * int(t / 5.0) % 7))


def not_finite(rig: Rig, patch: pytest.MonkeyPatch) -> None:
    estimator = rig.flight.computer.estimator
    honest = estimator.at
    patch.setattr(estimator, "at", lambda now_s, motion: honest(now_s, motion)._replace(r=float("nan")))


def following_beacon(rig: Rig, patch: pytest.MonkeyPatch) -> None:
    """What the barrier cannot stop: the beacon itself comes along, faster than the vehicle flies."""
    bend_ranges(rig, patch, lambda r, t: max(1.0, r - 8.0 * t))


@dataclass(frozen=True)
class Row:
    """A cause; modes asked for (None: none), how soon the app hands over or falls silent, what is read."""

    act: Callable[[Rig, pytest.MonkeyPatch], None]
    within_s: float
    asks: int | None
    reads: str
    control: str = "not held"
    app: dict[str, Any] = field(default_factory=dict)
    world: dict[str, Any] = field(default_factory=dict)
    for_s: float = 12.0
    flies_on: bool = False


def pilot(mode: int) -> Callable[[Rig, pytest.MonkeyPatch], None]:
    return lambda rig, patch: rig.pilot.mode(mode)


ROWS: dict[str, Row] = {
    "pilot or ground station chooses a mode": Row(
        pilot(RETURN), 0.2, None, "pilot or ground station chose Return", "released"
    ),
    "failsafe of the autopilot": Row(
        lambda rig, patch: setattr(rig.stub.autopilot.commander, "position_ok", False),
        0.4,
        None,
        "the autopilot left Offboard",
        "released",
    ),
    "range lost": Row(
        lambda rig, patch: patch.setattr(rig.stub, "radio", None),
        3.2,
        HOLD,
        "no range for longer than coast_s",
        app={"ranging": {"coast_s": 3.0}},
    ),
    "link lost": Row(
        lambda rig, patch: setattr(rig, "deaf", True), 3.6, None, "the autopilot was not heard for 3.5 s", "released"
    ),
    "autopilot restarted": Row(
        lambda rig, patch: rig.reboot_vehicle(airborne(80.0, height_m=15.0), silent_s=1.0),
        1.5,
        None,
        "the autopilot has restarted",
        "released",
    ),
    "app held up": Row(lambda rig, patch: rig.freeze(0.7), 0.0, None, "the loop was held up", "held", flies_on=True),
    "estimate not finite": Row(not_finite, 0.1, HOLD, "no range, and no estimate to carry"),
    "estimator diverged": Row(moved_beacon, 50.0, HOLD, "the ranges outvoted the estimate 5 times", for_s=55.0),
    "height lost": Row(lambda rig, patch: silence(rig, HEIGHT), 3.7, HOLD, "no height from the autopilot for 3."),
    "height lost, told only": Row(
        lambda rig, patch: silence(rig, HEIGHT),
        0.0,
        None,
        "s: fly on",
        "held",
        app={"safety": {"on_height_lost": "fly_on"}},
        for_s=6.0,
        flies_on=True,
    ),
    "autopilot's estimates lost": Row(
        shows(ESTIMATOR_STATUS, 1, 0b10100101), 2.0, LAND, "the autopilot's estimator has lost"
    ),
    "attitude lost (place, for `px4_fixed_wing_position`)": Row(
        lambda rig, patch: silence(rig, (ATTITUDE,)),
        0.8,
        HOLD,
        "no attitude from the autopilot: no setpoint can be made",
        app=PLANE,
        world=PLANE_WORLD,
    ),
    "battery low": Row(shows(SYS_STATUS, 6, 12), 4.3, RETURN, "battery low: 12 %, the limit is 20 %"),
    "battery called low by the autopilot": Row(shows(BATTERY_STATUS, 10, 2), 4.3, RETURN, "battery low: 100 %"),
    "range band broken": Row(
        following_beacon,
        15.0,
        HOLD,
        "outside 40 to 300 m",
        app={"orbit": {"r_min_m": 40.0, "r_max_m": 300.0}},
        for_s=16.0,
    ),
    "flight time used up": Row(
        lambda rig, patch: None, 4.0, HOLD, "8 s are flown", app={"safety": {"flight_time_s": 8.0}}, for_s=8.0
    ),
    "laps used up": Row(
        lambda rig, patch: None,
        90.0,
        LAND,
        "0.5 laps are flown",
        app={"safety": {"laps": 0.5, "on_used_up": "land"}, "orbit": {"radius_m": 30.0}},
        for_s=90.0,
    ),
    "ended by the operator": Row(
        lambda rig, patch: rig.flight.end("stopped by the operator"), 1.2, HOLD, "stopped by the operator", for_s=5.0
    ),
    "setpoints of somebody else": Row(
        lambda rig, patch: rig.flight.receive(
            mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.5).pack(
                mavlink.MAVLink(None, 1, 195)
            ),
            rig.now_s,
        ),
        0.1,
        None,
        "component 195 sends setpoints to this vehicle",
        "released",
        for_s=4.0,
    ),
    "another program with our ids": Row(
        lambda rig, patch: Peer(rig.stub, 1, 191).send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)),
        0.0,
        None,
        "",
        "held",
        for_s=3.0,
        flies_on=True,
    ),
}


@pytest.mark.parametrize("name", ROWS)
def test_row(name, monkeypatch):
    row = ROWS[name]
    world = {"seed": 6, "params": {"COM_OBL_RC_ACT": 5}, **row.world}
    rig = engage(Rig(config(**row.app), airborne(70.0, **world)))
    rig.run(3.0)
    began_s = rig.now_s
    row.act(rig, monkeypatch)
    rig.run(row.for_s, until=lambda: rig.flight.done)
    control = rig.flight.link.authority.control
    assert control == row.control or (rig.flight.done and control == "given back")
    asked = {mode for _, mode in mode_requests(rig, began_s)}
    assert asked == (set() if row.asks is None else {row.asks})
    if row.flies_on:
        assert rig.log.sent(rig.now_s - 0.2)
    elif row.asks is None:
        assert last_setpoint_s(rig) <= began_s + row.within_s + 1e-6
    else:
        first_s = min(t for t, _ in mode_requests(rig, began_s))
        assert first_s <= began_s + row.within_s
        steered = [
            m
            for t, m in rig.setpoints(first_s + 1e-6)
            if m.get_type() == "SET_ATTITUDE_TARGET" or m.vx or m.vy or m.yaw_rate
        ]
        assert not [m for m in steered if rig.stub.truth().mode == "OFFBOARD"]
    said = [*texts(rig, began_s), *(e.text for e in rig.flight.events if e.t_s >= began_s - 1e-9)]
    assert not row.reads or any(row.reads in text for text in said), said
    if row.asks is not None or row.control == "released":
        assert any(row.reads in text for text in texts(rig, began_s)), "the ground station was not told"
    if name != "autopilot restarted":
        keep_the_rules(rig)


def test_the_document_has_exactly_these_rows():
    table = re.findall(r"^\| ([^|]+?) \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)
    causes = [cell for cell in table if cell not in ("cause",) and not set(cell) <= set("- ")]
    assert causes == list(ROWS)


@pytest.mark.parametrize(
    ("app", "world", "lost", "within_s", "reads"),
    [
        (PLANE, PLANE_WORLD, ATTITUDE, 0.52, "no attitude from the autopilot"),
        (
            PLANE | {"vehicle": {"class": "px4_fixed_wing_position"}},
            PLANE_WORLD,
            LOCAL_POSITION,
            1.05,
            "no place and course from the autopilot",
        ),
        ({"vehicle": {"class": "px4_multirotor_attitude", "pitch_deg": -4.37}}, {}, ATTITUDE, 0.52, "no attitude"),
    ],
    ids=["fixed wing", "fixed wing by position", "multirotor by attitude"],
)
@pytest.mark.parametrize("action", ["hold", "stop"])
def test_what_a_setpoint_is_made_of_is_lost(app, world, lost, within_s, reads, action):
    """Silence as it goes stale, the reason in words, and with stop no mode request: the autopilot's failsafe acts."""
    rig = Rig(config(**app, safety={"on_blind": action}), airborne(70.0, **world, params={"COM_OBL_RC_ACT": 5}))
    engage(rig)
    rig.run(3.0)
    began_s = rig.now_s
    silence(rig, (lost,))
    rig.run(6.0)
    late = [tick for tick in rig.log.sent(began_s + within_s + 1e-6) if tick.control != "not held"]
    assert late == [], "not before it is given back, and what is missed has come again"
    said = texts(rig, began_s)
    assert any(reads in text and "no setpoint can be made" in text for text in said), said
    assert not any("no setpoint for" in text for text in said), "that is the effect, not the cause"
    assert {mode for _, mode in mode_requests(rig, began_s)} == ({HOLD} if action == "hold" else set())
    assert rig.stub.truth().mode == "AUTO/LOITER"
    keep_the_rules(rig)


def test_a_class_that_can_do_without_the_attitude_flies_on():
    rig = engage(Rig(config(), airborne(70.0)))
    silence(rig, (ATTITUDE,))
    rig.run(6.0)
    assert rig.log.ticks[-1].control == "held"
    assert rig.log.sent(rig.now_s - 0.1)


def test_with_a_low_battery_an_engagement_is_handed_back_at_once(monkeypatch):
    shows(SYS_STATUS, 6, 5)(None, monkeypatch)
    rig = Rig(config(), airborne(70.0))
    rig.run(6.0)
    rig.pilot.mode(OFFBOARD)
    rig.run(3.0)
    assert "broken_off" in rig.log.phases
    assert not {"acquiring", "orbiting"} & set(rig.log.phases)
    assert {mode for _, mode in mode_requests(rig)} == {RETURN}
    assert rig.stub.truth().mode == "AUTO/RTL"


def test_a_battery_that_the_autopilot_does_not_measure_ends_nothing(monkeypatch):
    shows(SYS_STATUS, 6, -1)(None, monkeypatch)
    rig = engage(Rig(config(), airborne(70.0)))
    rig.run(6.0)
    assert rig.log.ticks[-1].control == "held"


def test_a_hand_over_whose_request_is_lost_flies_on_at_no_speed():
    """Height lost, the mode request lost too: fit or not, what is being given back is not flown again."""
    rig = Rig(config(), airborne(80.0))
    engage(rig)
    send = rig.send
    rig.send = lambda frames: send([f for f in frames if not is_mode_request(f)])
    began_s = rig.now_s
    silence(rig, HEIGHT)
    rig.run(8.0)
    given_s = began_s + 3.7
    speeds = [m.vx for t, m in rig.setpoints(given_s)]
    assert speeds and max(speeds) == 0.0
    assert not {t.phase for t in rig.log.ticks if t.t_s > given_s} & {"acquiring", "orbiting"}
    assert "not heard" not in " ".join(event.text for event in rig.flight.events)


def is_mode_request(frame: bytes) -> bool:
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    return message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE


def test_a_battery_that_is_well_does_not_hide_one_that_is_low():
    rig = Rig(config(), airborne(80.0))
    ap = rig.flight.link.autopilot
    assert not ap.battery_alarm
    for k, (battery, state) in enumerate([(0, 3), (1, 1)] * 3):
        ap._battery_status(SimpleNamespace(id=battery, charge_state=state), float(k))
        assert ap.battery_alarm
    ap._battery_status(SimpleNamespace(id=0, charge_state=1), 9.0)
    assert not ap.battery_alarm
