"""Who flies, in lockstep: the pilot wins at once, nobody is fought, modes are asked for only where that is agreed."""

from __future__ import annotations

import itertools

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.mavlink.offboard import Control
from tests.lockstep import GCS_LINK, Peer, Rig, airborne, config
from tests.trust.rules import (
    HOLD,
    LAND,
    OFFBOARD,
    POSITION,
    RETURN,
    engage,
    keep_the_rules,
    last_setpoint_s,
    mode_requests,
)
from tests.trust.rules import texts as texts_of
from tests.trust.wires import bad

USER_1 = mavlink.MAV_CMD_USER_1
US = (1, 191)


def orbiting(wires=None, app=None, **world) -> Rig:
    rig = Rig(config(**(app or {})), airborne(**{"distance_m": 80.0, "seed": 4, **world}), wires)
    engage(rig)
    rig.run(2.0)
    return rig


class Shown:
    """Remembers when the app's link first carried a mode message that is not OFFBOARD."""

    def __init__(self, rig: Rig) -> None:
        self.at_s = float("inf")
        self._decoder = mavlink.MAVLink(None)
        self._decoder.robust_parsing = True
        self._rig, self._receive = rig, rig.flight.receive
        rig.flight.receive = self._look  # type: ignore[method-assign]

    def _look(self, data, now_s, *args, **kw):
        for message in self._decoder.parse_buffer(bytearray(data)) or []:
            shows = message.get_type() in ("HEARTBEAT", "CURRENT_MODE") and message.get_srcComponent() == 1
            if shows and message.custom_mode != OFFBOARD:
                self.at_s = min(self.at_s, now_s)
        return self._receive(data, now_s, *args, **kw)


@pytest.mark.parametrize("mode", [HOLD, RETURN, LAND], ids=["hold", "return", "land"])
@pytest.mark.parametrize("delay_s", [0.0, 0.3])
def test_the_pilot_wins_at_once_and_for_good(mode, delay_s):
    """Last setpoint within 0.2 s of the first message that shows it, none after, and no mode request ever again."""
    rig = orbiting(bad(1, delay_s=delay_s) if delay_s else None)
    shown = Shown(rig)
    rig.pilot.mode(mode)
    rig.run(3.0)
    assert last_setpoint_s(rig) <= shown.at_s + 0.2
    assert any(text.startswith("circumnav released") for text in texts_of(rig))
    for later in (HOLD, OFFBOARD, RETURN, OFFBOARD):  # whatever is shown later, also OFFBOARD itself
        rig.pilot.mode(later)
        rig.run(2.0)
    assert last_setpoint_s(rig) <= shown.at_s + 0.2
    assert mode_requests(rig) == []
    assert rig.log.ticks[-1].control == "released"
    keep_the_rules(rig)


def test_sticks_win_where_the_autopilot_lets_them():
    rig = orbiting(params={"COM_RC_OVERRIDE": 3})
    for moved in (0, 800):
        for _ in range(10):
            rig.pilot.send(mavlink.MAVLink_manual_control_message(1, moved, 0, 500, 0, 0))
            rig.run(0.05)
    assert rig.log.ticks[-1].control == "released"
    assert rig.log.ticks[-1].mode == "Position"


@pytest.mark.parametrize("how", ["released", "given back", "finished"])
def test_no_command_that_waited_leaves_once_the_aircraft_is_somebody_elses(how):
    """A command that the autopilot never answers is asked again for two seconds, and another waits behind it."""
    rig = orbiting()
    commands = rig.flight.link.commands
    commands.on_ack = lambda command, result: None  # type: ignore[method-assign]
    for command in (mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_DO_SET_ROI):
        commands.push(command, purpose="waits")

    def waited(from_s: float = 0.0) -> list[int]:
        sent = [m for _, m in rig.decoded(from_s) if m.get_type() == "COMMAND_LONG"]
        return [m.command for m in sent if m.command in (mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_DO_SET_ROI)]

    rig.run(0.1)
    assert waited() == [mavlink.MAV_CMD_DO_CHANGE_SPEED]
    if how == "released":
        rig.pilot.mode(RETURN)
    elif how == "given back":
        rig.flight.link.authority.give_back(HOLD, rig.now_s, "a test")
    else:
        rig.flight.end("a test")
    rig.run(5.0, until=lambda: rig.log.ticks[-1].control in ("released", "given back", "not held"))
    over_s = rig.now_s + 1e-6
    rig.run(3.0, until=lambda: rig.flight.done)
    assert rig.flight.done is (how == "finished")
    assert waited(over_s) == []


@pytest.mark.parametrize("custom", [HOLD, POSITION, 0], ids=hex)
@pytest.mark.parametrize("sender", [(255, 190), (2, 1), (1, 158), (9, 1)])
def test_modes_of_others_on_the_link_are_not_the_aircrafts(sender, custom):
    """A ground station's heartbeat, another autopilot, the radio: none of them ends the flight or engages one."""
    rig = orbiting()
    stranger = Peer(rig.stub, *sender, link=GCS_LINK)
    kind = 12 if sender[1] == 1 else 8
    for _ in range(4):
        stranger.send(mavlink.MAVLink_heartbeat_message(2, kind, 0x9D, custom, 4, 3))
        stranger.send(mavlink.MAVLink_current_mode_message(0, custom or HOLD, custom or HOLD))
        rig.run(0.25)
    assert rig.log.ticks[-1].control == "held"
    assert rig.log.sent(rig.now_s - 0.1)
    keep_the_rules(rig)


def test_a_second_companion_with_our_ids_keeps_us_from_engaging_and_the_operator_reads_why():
    rig = Rig(config(), airborne(80.0))
    double = Peer(rig.stub, *US, link=GCS_LINK)

    def speak(for_s: float) -> None:
        for _ in range(int(for_s)):
            double.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
            rig.run(1.0)

    speak(6.0)
    assert rig.setpoints() == []
    assert "another program on the link speaks as system 1 component 191" in rig.flight.link.authority.why_not(
        rig.now_s
    )
    rig.pilot.mode(OFFBOARD)
    speak(2.0)
    assert rig.setpoints() == []
    rig.pilot.mode(HOLD)
    rig.run(7.0)  # it has gone
    assert rig.setpoints()


def test_setpoints_of_somebody_else_end_our_flight_at_once():
    rig = orbiting()
    other = Peer(rig.stub, 1, 195, link=GCS_LINK)
    began_s = rig.now_s
    message = mavlink.MAVLink_set_position_target_local_ned_message(0, 0, 1, 8, 1479, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0)
    rig.flight.receive(message.pack(other.mav), rig.now_s)  # by a router that shares everything with everybody
    rig.run(3.0)
    assert last_setpoint_s(rig) <= began_s + 2 * rig.tick_s + 1e-6
    assert rig.log.ticks[-1].control == "released"
    assert "component 195 sends setpoints" in rig.flight.link.authority.reason
    assert mode_requests(rig) == []


def test_a_forwarded_setpoint_for_another_vehicle_is_nobodys_rival():
    rig = orbiting()
    other = Peer(rig.stub, 7, 191, link=GCS_LINK)
    message = mavlink.MAVLink_set_position_target_local_ned_message(0, 7, 1, 8, 1479, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0)
    rig.flight.receive(message.pack(other.mav), rig.now_s)
    rig.run(1.0)
    assert rig.log.ticks[-1].control == "held"


def test_the_latch_opens_only_on_command_and_only_in_a_settled_mode():
    rig = orbiting(params={"COM_OBL_RC_ACT": 5})
    rig.freeze(3.0)  # the failsafe: Hold, but Offboard is still the intention
    rig.run(2.0)
    answers: list[int] = []

    def ask() -> None:
        rig.pilot.heartbeat()
        rig.stub.take(GCS_LINK)
        rig.pilot.command(USER_1, target=US)
        rig.run(1.0)
        decoder = mavlink.MAVLink(None)
        for data in rig.stub.take(GCS_LINK):
            answers.extend(
                m.result
                for m in decoder.parse_buffer(bytearray(data)) or []
                if m.get_type() == "COMMAND_ACK" and m.command == USER_1 and m.get_srcComponent() == 191
            )

    ask()
    assert rig.log.ticks[-1].control == "released"
    rig.pilot.mode(OFFBOARD)  # refused by the autopilot: no stream
    rig.run(1.0)
    ask()
    assert rig.log.ticks[-1].control == "released"
    rig.pilot.mode(HOLD)
    rig.run(1.0)
    assert rig.log.ticks[-1].control == "released", "a settled mode alone opens nothing"
    ask()
    assert rig.log.ticks[-1].control == "not held"
    assert answers == [1, 1, 0]
    engage(rig)
    assert mode_requests(rig) == []


def test_a_command_for_somebody_else_does_not_open_the_latch():
    rig = orbiting()
    rig.pilot.mode(HOLD)
    rig.run(1.0)
    for target in ((1, 1), (1, 0), (0, 0), (2, 191), (1, 195)):
        rig.pilot.command(USER_1, target=target)
        rig.run(0.3)
    assert rig.log.ticks[-1].control == "released"


ACTIONS = {"hold": HOLD, "return": RETURN, "land": LAND, "stop": None}


@pytest.mark.parametrize("action", ACTIONS)
def test_a_lost_range_does_what_is_configured_and_only_that(action):
    app = {"on_range_lost": action, "ranging": {"coast_s": 3.0}}
    rig = orbiting(app=app, range_dropouts_s=((8.0, 1e9),), params={"COM_OBL_RC_ACT": 5})
    rig.run(14.0)
    lost_s = next(t.t_s for t in rig.log.ticks if t.phase == "range_lost")
    assert lost_s == pytest.approx(8.0 + 3.0, abs=0.3)
    steered = [t for t in rig.log.ticks if t.turn_rate_sent_rad_s == t.turn_rate_sent_rad_s and t.t_s >= lost_s]
    assert all(t.turn_rate_sent_rad_s == 0.0 for t in steered), "flown on without a range"
    asked = {mode for _, mode in mode_requests(rig)}
    if action == "stop":
        assert asked == set()
        assert last_setpoint_s(rig) <= lost_s + 1e-6
    else:
        assert asked == {ACTIONS[action]}
        assert rig.stub.truth().mode == {"hold": "AUTO/LOITER", "return": "AUTO/RTL", "land": "AUTO/LAND"}[action]
        assert last_setpoint_s(rig) <= lost_s + 1.5
    keep_the_rules(rig)


def test_a_range_that_comes_back_after_a_hand_over_engages_nothing_by_itself():
    app = {"ranging": {"coast_s": 2.0}}
    rig = orbiting(app=app, range_dropouts_s=((8.0, 14.0),))
    rig.run(20.0)
    assert rig.log.ticks[-1].phase == "ready"
    assert rig.stub.truth().mode == "AUTO/LOITER"
    assert len({mode for _, mode in mode_requests(rig)}) == 1
    engage(rig)


def lost_and_handed_over() -> Rig:
    """The radio fell silent, and the vehicle has just been handed over to Hold."""
    rig = orbiting(app={"ranging": {"coast_s": 2.0}}, params={"COM_OBL_RC_ACT": 5})
    rig.stub.radio.faults.stopped = True
    rig.run(10.0, until=lambda: rig.log.ticks[-1].control == "not held")
    assert (rig.log.ticks[-1].phase, rig.stub.truth().mode) == ("range_lost", "AUTO/LOITER")
    return rig


def test_offboard_selected_again_right_after_the_hand_over_is_not_joined_and_no_dead_end():
    rig = lost_and_handed_over()
    again_s = rig.now_s + 1e-6
    rig.pilot.mode(OFFBOARD)  # the autopilot still counts our stream of before
    rig.run(0.3)
    assert rig.stub.truth().mode == "OFFBOARD"
    rig.run(3.0)
    assert rig.setpoints(again_s) == []
    assert rig.stub.truth().mode == "AUTO/LOITER"
    rig.pilot.mode(HOLD)
    rig.stub.radio.faults.stopped = False
    rig.run(2.0)
    assert rig.log.ticks[-1].phase == "ready"
    engage(rig)
    assert rig.log.ticks[-1].phase in ("acquiring", "orbiting")
    keep_the_rules(rig)


def held_again(rig: Rig) -> Rig:
    """However it came about: the mode shows that we hold the vehicle, in range_lost."""
    rig.pilot.mode(OFFBOARD)
    rig.run(0.2)
    rig.flight.link.authority._to(Control.HELD, "the pilot selected Offboard")
    return rig


def test_held_again_without_a_range_it_is_given_back_again():
    rig = held_again(lost_and_handed_over())
    again_s = rig.now_s + 1e-6
    rig.run(3.0)
    assert {mode for _, mode in mode_requests(rig, again_s)} == {HOLD}
    assert rig.stub.truth().mode == "AUTO/LOITER"
    assert rig.log.ticks[-1].control == "not held"
    assert any("engaged again: range lost: hold" in text for text in texts_of(rig, again_s))
    assert rig.log.ticks[-1].phase == "range_lost"


def test_held_again_with_the_range_back_it_is_flown_on():
    rig = lost_and_handed_over()
    rig.stub.radio.faults.stopped = False
    held_again(rig)
    rig.run(1.0)
    assert rig.log.ticks[-1].phase == "acquiring"


def test_a_polite_end_asks_for_hold_and_falls_silent():
    rig = orbiting()
    rig.flight.end("stopped by the operator")
    ended_s = rig.now_s
    rig.run(8.0, until=lambda: rig.flight.done)
    assert rig.flight.done
    assert {mode for _, mode in mode_requests(rig)} == {HOLD}
    assert rig.stub.truth().mode == "AUTO/LOITER"
    assert last_setpoint_s(rig) <= ended_s + 1.5
    assert all(abs(m.yaw_rate) < 1e-9 and m.vx == 0.0 for _, m in rig.setpoints(ended_s + 1e-6))


def test_a_polite_end_after_the_pilot_took_over_asks_for_nothing():
    rig = orbiting()
    rig.pilot.mode(RETURN)
    rig.run(1.0)
    rig.flight.end("stopped by the operator")
    rig.run(3.0)
    assert rig.flight.done
    assert mode_requests(rig) == []


def test_an_end_while_the_autopilot_is_not_heard_asks_for_nothing():
    """Blind after a gap: Offboard was ours, but whether it still is nobody has said."""
    rig = orbiting()
    rig.deaf = True
    rig.freeze(0.8)
    rig.flight.end("stopped by the operator")
    rig.run(5.0)
    assert mode_requests(rig) == []
    assert rig.flight.done


BAD = {
    "30 % loss": {"loss": 0.3},
    "duplicates": {"doubled": 0.3},
    "reordering": {"held_back": 0.3, "held_back_s": 0.15},
    "300 ms delay": {"delay_s": 0.3},
    "all of it": {"loss": 0.2, "doubled": 0.2, "held_back": 0.2, "delay_s": 0.15},
}


@pytest.mark.parametrize(("name", "seed"), list(itertools.product(BAD, (1,))))
def test_on_a_bad_link_the_orbit_is_held_or_released_cleanly(name, seed):
    wires = bad(seed, **BAD[name])
    rig = Rig(config(), airborne(80.0, seed=seed), wires)
    engage(rig)
    rig.run(30.0)
    keep_the_rules(rig)
    assert rig.log.ticks[-1].control == "held", rig.flight.events
    assert rig.log.furthest_m(5.0) < 10.0
    assert mode_requests(rig) == []


def test_on_the_ground_nothing_is_streamed_and_offboard_is_refused():
    """Armed on the grass with the beacon heard: Offboard would drag it along. In the air it is streamed as ever."""
    rig = Rig(config(), airborne(80.0, height_m=0.0, params={"COM_DISARM_PRFLT": -1}))
    rig.run(3.0)
    rig.pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    rig.run(2.0)
    assert rig.stub.truth().armed and rig.log.ticks[-1].phase == "ready"
    assert "on the ground" in rig.flight.link.authority.why_not(rig.now_s)
    rig.pilot.mode(OFFBOARD)
    rig.run(2.0)
    assert rig.setpoints() == []
    assert rig.stub.truth().mode != "OFFBOARD"
    assert not any("to engage" in event.text for event in rig.flight.events)
    nan = float("nan")
    rig.pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, nan, nan, nan, nan)
    rig.run(15.0)
    assert rig.log.sent(rig.now_s - 0.1), (rig.stub.truth(), rig.flight.link.authority.why_not(rig.now_s))
    assert any("select Offboard to engage" in event.text for event in rig.flight.events)
