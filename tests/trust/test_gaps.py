"""The app held up, restarted, or the autopilot restarted: nothing blind leaves, and nothing is taken back."""

from __future__ import annotations

import asyncio
import os
import signal

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.flight import VEHICLE, Flight
from circumnav_mav.runtime.stopped import on_continue
from tests.lockstep import Rig, airborne, config
from tests.trust.outage import outage, watch
from tests.trust.rules import HOLD, OFFBOARD, engage, keep_the_rules, last_setpoint_s, mode_requests, texts
from tests.trust.wires import bad

ARM = 400
LOSS_ACTIONS = {
    0: "POSCTL",
    1: "ALTCTL",
    2: "STABILIZED",
    3: "AUTO/RTL",
    4: "AUTO/LAND",
    5: "AUTO/LOITER",
    6: "TERMINATION",
}


def orbiting(seed: int = 3, **params: float) -> Rig:
    rig = Rig(config(), airborne(80.0, seed=seed, height_m=40.0, params=params)).engage()
    rig.run(5.0)
    return rig


@pytest.mark.parametrize("for_s", [0.3, 0.6, 0.9])
def test_a_short_stall_is_survived_and_nothing_blind_follows_it(for_s):
    rig = orbiting()
    rig.freeze(for_s)
    thawed_s = rig.now_s
    mode_heard = rig.flight.link.autopilot
    rig.run(5.0)
    first = rig.setpoints(thawed_s)[0][0]
    if for_s > 0.5:  # half of COM_OF_LOSS_T: what waited proves nothing
        assert first > thawed_s + rig.tick_s + 1e-6
        assert any("held up" in text for text in texts(rig, thawed_s))
    else:
        assert first <= thawed_s + rig.tick_s + 1e-6
    assert mode_heard.custom_mode == OFFBOARD
    assert rig.log.ticks[-1].control == "held"
    assert rig.stub.truth().mode == "OFFBOARD"
    assert mode_requests(rig) == []
    keep_the_rules(rig)


def test_a_stall_before_any_autopilot_is_heard_asks_nobody():
    """Whoever it would ask is not known: system 1 may be another aircraft."""
    flight, sent = Flight(config()), []
    for now_s in (0.02, 0.04, 9.0, 9.02, 9.04):
        flight.resume(now_s, lambda now_s=now_s: now_s)
        sent += flight.tick(now_s)[0]
    flight.link_back(VEHICLE, 9.06, "open again")
    sent += flight.tick(9.08)[0]
    assert {mavlink.MAVLink(None).decode(bytearray(frame)).get_type() for frame in sent} == {"HEARTBEAT"}
    assert any("held up" in event.text for event in flight.events)


def test_after_a_stall_no_setpoint_leaves_before_a_mode_message_sent_after_it():
    """The first answer after the thaw is lost: the app stays silent until it has asked again and been told."""
    rig = orbiting()
    rig.freeze(0.6)
    thawed_s = rig.now_s
    rig.step()
    rig.stub.take("offboard")  # lost: among it the mode that was asked for
    count = len(rig.setpoints())
    while len(rig.setpoints()) == count and rig.now_s < thawed_s + 3.0:
        rig.step()
    assert rig.log.ticks[-1].control == "held"
    shown_s = rig.flight.link.autopilot.mode_s
    assert rig.setpoints()[-1][0] >= shown_s > thawed_s + rig.tick_s


@pytest.mark.parametrize("action", LOSS_ACTIONS)
def test_a_long_stall_ends_in_the_failsafe_and_the_aircraft_is_not_taken_back(action):
    rig = orbiting(COM_OBL_RC_ACT=action)
    rig.freeze(3.0)
    thawed_s = rig.now_s
    assert rig.stub.truth().mode == LOSS_ACTIONS[action]
    rig.run(5.0)
    assert rig.setpoints(thawed_s) == []
    assert mode_requests(rig) == []
    assert rig.log.ticks[-1].control == "released"
    assert rig.stub.truth().mode == LOSS_ACTIONS[action]
    keep_the_rules(rig)


def test_ranges_that_waited_in_the_socket_are_not_flown_on():
    rig = orbiting()
    rig.freeze(0.9)
    before = rig.flight.rejected["waited"]
    rig.step()
    assert rig.flight.rejected["waited"] - before >= 7  # 10 Hz for 0.9 s
    assert rig.log.ticks[-1].sample_age_s > 0.9


def test_a_process_that_was_stopped_for_a_moment_starts_no_blind_stream():
    """SIGSTOP and SIGCONT within half the loss timeout: too short to be seen by the clock alone."""
    rig = orbiting()
    rig.flight.stopped()
    rig.step()
    assert rig.log.ticks[-1].turn_rate_sent_rad_s != rig.log.ticks[-1].turn_rate_sent_rad_s
    rig.run(2.0)
    assert rig.log.sent(rig.now_s - 0.5)


def test_the_continued_process_knows_it_before_any_callback_that_is_due():
    """The tick was due while the process was stopped: it must find the flag set, and the flag is set once only."""
    seen: list[str] = []

    async def run() -> None:
        loop = asyncio.get_running_loop()
        with on_continue(lambda: seen.append("continued")):
            loop.call_soon(os.kill, os.getpid(), signal.SIGCONT)
            loop.call_soon(seen.append, "tick")
            for _ in range(5):
                await asyncio.sleep(0)

    before = signal.getsignal(signal.SIGCONT)
    asyncio.run(run())
    assert seen == ["continued", "tick"]
    assert signal.getsignal(signal.SIGCONT) is before


def test_being_stopped_is_told_once():
    rig = orbiting()
    stopped_s = rig.now_s
    rig.freeze(0.7)
    rig.flight.stopped()
    rig.run(3.0)
    assert len([text for text in texts(rig, stopped_s) if "held up" in text]) == 1
    assert rig.log.ticks[-1].control == "held"


@pytest.mark.parametrize("action", [None, *LOSS_ACTIONS, 7])
def test_a_restarted_app_leaves_the_aircraft_to_whoever_flies_it(action):
    """action None: the old stream goes on from somewhere else, and OFFBOARD is shown; else the failsafe acts."""
    rig = orbiting(COM_OBL_RC_ACT=5 if action is None else action)
    if action is not None:
        rig.freeze(4.0)
    rig.restart_app()
    restarted_s = rig.now_s + 1e-6
    if action is None:
        rig.run(1.0)  # shorter than the loss timeout: OFFBOARD is still shown
        assert rig.stub.truth().mode == "OFFBOARD"
    rig.run(8.0)
    assert rig.setpoints(restarted_s) == []
    assert mode_requests(rig, restarted_s) == []
    truth = rig.stub.truth()
    assert truth.mode == LOSS_ACTIONS.get(5 if action is None else action) or not truth.armed, truth


def test_a_restarted_app_may_be_engaged_again_by_the_pilot():
    rig = orbiting(COM_OBL_RC_ACT=5)
    rig.freeze(3.0)
    rig.restart_app()
    rig.run(3.0)
    rig.pilot.mode(HOLD)
    rig.engage()
    assert mode_requests(rig) == []


def test_a_restarted_app_with_engage_auto_does_not_take_off_again():
    """The failsafe landed the aircraft, Offboard is still its intention: only a person may start that again."""
    rig = Rig(
        config(engage="auto", orbit={"height_m": 5.0}), airborne(80.0, height_m=5.0, params={"COM_OBL_RC_ACT": 4})
    )
    rig.engage()
    rig.run(5.0)
    rig.freeze(20.0)
    assert not rig.stub.truth().armed
    rig.restart_app()
    restarted_s = rig.now_s
    rig.run(10.0)
    assert not rig.stub.truth().armed
    assert rig.setpoints(restarted_s) == []
    assert mode_requests(rig, restarted_s) == []
    assert not [m for _, m in rig.decoded(restarted_s) if m.get_type() == "COMMAND_LONG" and m.command == ARM]


@pytest.mark.parametrize("silent_s", [0.1, 2.0, 8.0])
@pytest.mark.parametrize("height_m", [0.0, 40.0])
def test_a_restarted_autopilot_is_not_flown_on(silent_s, height_m):
    """In the air (a brown-out that the motors outlive) or on the ground: released, said, latched."""
    rig = orbiting()
    left_s = rig.now_s
    rig.reboot_vehicle(airborne(80.0, height_m=height_m, seed=9), silent_s=silent_s)
    rig.run(silent_s + 3.0)
    assert last_setpoint_s(rig) <= left_s + 1.1  # the stub answers a question of ours even while it boots
    assert rig.log.ticks[-1].control == "released"
    assert ("restarted" if silent_s < 1.0 else "nothing came") in rig.flight.link.authority.reason
    assert mode_requests(rig) == []
    rig.pilot.mode(OFFBOARD)
    rig.run(3.0)
    assert rig.log.sent(left_s + 5.0) == []


def test_an_autopilot_that_falls_silent_gets_nothing_and_keeps_its_freedom_when_it_is_back():
    rig = orbiting()
    left_s = rig.now_s
    rig.deaf = True
    rig.run(5.0)
    assert rig.log.ticks[-1].control == "released"
    assert last_setpoint_s(rig) <= left_s + 0.52
    assert "nothing came from the autopilot" in rig.flight.link.authority.reason
    rig.deaf = False
    rig.run(10.0)
    assert rig.log.sent(left_s + 3.7) == []
    assert mode_requests(rig) == []


@pytest.mark.parametrize("for_s", [0.6, 0.9, 1.1, 1.2, 1.3, 1.4])
def test_what_was_under_way_before_the_gap_is_not_taken_for_news(for_s):
    """300 ms late: modes sent before the failsafe still arrive after the thaw. A failsafe that began is not undone."""
    rig = engage(Rig(config(), airborne(80.0, seed=3, params={"COM_OBL_RC_ACT": 5}), bad(1, delay_s=0.3)))
    rig.run(3.0)
    rig.freeze(for_s)
    modes = []
    for _ in range(250):
        rig.step()
        modes.append(rig.stub.truth().mode)
    changes = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] != mode]
    assert changes in (["OFFBOARD"], ["OFFBOARD", "AUTO/LOITER"], ["AUTO/LOITER"]), changes
    assert rig.log.ticks[-1].control == ("held" if changes == ["OFFBOARD"] else "released")
    assert mode_requests(rig) == []


@pytest.mark.parametrize("doubled", [0.0, 0.3])
def test_a_gap_before_the_engagement_on_a_slow_link_does_not_end_it(doubled):
    """300 ms each way: the answers to the later questions come after the first one, and must not count as its delay."""
    wires = bad(1, delay_s=0.3, doubled=doubled)
    rig = Rig(config(), airborne(80.0, seed=3, params={"COM_OBL_RC_ACT": 5}), wires)
    rig.run(5.0)
    rig.freeze(0.7)
    rig.run(3.0)
    rig.pilot.mode(OFFBOARD)
    rig.run(10.0)
    assert rig.log.ticks[-1].control == "held", rig.flight.events
    assert rig.stub.truth().mode == "OFFBOARD"


@pytest.mark.parametrize("out_s", [0.4, 0.9, 1.06, 1.14, 1.2, 2.0, 3.4, 4.0])
@pytest.mark.parametrize("began_s", [0.0, 0.25])
def test_a_link_that_is_out_both_ways_leaves_the_failsafe_to_the_autopilot(out_s, began_s, monkeypatch):
    """Setpoints that leave into the void must not count, and the first that arrives again must not take it back."""
    rig, taken_back = orbiting(COM_OBL_RC_ACT=5), watch(monkeypatch)
    rig.run(began_s)
    modes = outage(rig, out_s)
    back_s = rig.now_s
    for _ in range(250):
        rig.step()
        modes.append(rig.stub.truth().mode)
    changes = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] != mode]
    held = out_s < 1.0
    assert changes == (["OFFBOARD"] if held else ["OFFBOARD", "AUTO/LOITER"])
    assert rig.log.ticks[-1].control == ("held" if held else "released")
    assert held or rig.setpoints(back_s) == []
    assert taken_back == []
    assert mode_requests(rig) == []
    keep_the_rules(rig)


def test_the_watch_sees_a_stream_that_takes_the_aircraft_back(monkeypatch):
    rig, taken_back = orbiting(COM_OBL_RC_ACT=5), watch(monkeypatch)
    monkeypatch.setattr(rig.flight.link, "fell_silent", lambda now_s: False)
    outage(rig, 2.0)
    rig.run(0.2)
    assert len(taken_back) == 1


def test_an_outage_after_the_pilot_engaged_unseen_takes_nothing_back(monkeypatch):
    """The pilot selects Offboard as the link goes: PX4 has the stream of before, and its failsafe has begun."""
    rig, taken_back = Rig(config(), airborne(80.0, seed=3, params={"COM_OBL_RC_ACT": 5})), watch(monkeypatch)
    rig.run(5.0)
    rig.pilot.mode(OFFBOARD)
    outage(rig, 2.0)
    rig.run(3.0)
    assert rig.stub.truth().mode == "AUTO/LOITER"
    assert taken_back == []


@pytest.mark.parametrize("loss_s", [1.0, 0.6])
def test_a_link_that_loses_every_third_frame_is_not_an_outage(loss_s):
    world = airborne(80.0, seed=3, params={"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": loss_s})
    rig = engage(Rig(config(), world, bad(5, loss=0.3, delay_s=0.1, held_back=0.2)))
    rig.run(60.0)
    assert not any("nothing came" in event.text for event in rig.flight.events), rig.flight.events
    assert rig.log.ticks[-1].control == "held"
