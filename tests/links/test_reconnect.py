"""After a broken link nothing is sent until a newer mode message shows that the aircraft is still held. In lockstep."""

from __future__ import annotations

import pytest

from circumnav_mav.flight import RANGING, VEHICLE
from tests.lockstep import OFFBOARD_LINK, Rig, airborne, config

HOLD, POSCTL, OFFBOARD = 0x03040000, 0x00030000, 0x00060000
SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, DO_SET_MODE = 511, 512, 176


class BreakableRig(Rig):
    """The vehicle's link can be cut; the app learns of it at once or not at all, as links are."""

    cut = False

    def step(self):
        if self.cut:
            self.stub.advance((self._n + 1) * self.tick_s)
            self.stub.take(OFFBOARD_LINK)
        return super().step()

    def send(self, frames):
        if not self.cut:
            super().send(frames)

    def break_link(self, *, noticed: bool = True) -> float:
        if noticed:
            self.flight.link_lost(VEHICLE, self.now_s, "serial:///dev/ttyACM0: the other end is gone")
        self.cut = True
        return self.now_s

    def mend_link(self) -> float:
        self.stub.take(OFFBOARD_LINK)  # what the vehicle said meanwhile is gone with the old link
        self.cut = False
        self.flight.link_back(VEHICLE, self.now_s, "open again")
        return self.now_s

    def shown_mode_s(self, after_s: float, mode: int) -> float:
        """Return when the vehicle's mode was first known again."""
        ap = self.flight.link.autopilot
        self.run(5.0, until=lambda: ap.mode_s > after_s and ap.custom_mode == mode)
        assert ap.mode_s > after_s and ap.custom_mode == mode
        return ap.mode_s


def in_orbit(**app) -> BreakableRig:
    rig = BreakableRig(config(orbit={"radius_m": 30.0}, **app), airborne(distance_m=60.0, seed=5)).engage()
    rig.run(20.0)
    return rig


def commands(rig: Rig, from_s: float, command: int) -> list:
    return [m for _, m in rig.decoded(from_s) if m.get_type() == "COMMAND_LONG" and m.command == command]


def test_nothing_is_sent_while_the_link_is_down_and_the_record_says_so():
    rig = in_orbit()
    broken_s = rig.break_link()
    rig.run(0.5)
    assert rig.log.sent(broken_s + 1e-6) == []
    assert "vehicle link lost" in rig.flight.events[-1].text


def test_a_break_shorter_than_the_loss_timeout_is_flown_through_after_fresh_news():
    rig = in_orbit()
    rig.break_link()
    rig.run(0.3)
    back_s = rig.mend_link()
    known_s = rig.shown_mode_s(back_s, OFFBOARD)
    rig.run(5.0)
    sent = rig.setpoints(back_s)
    assert sent and sent[0][0] >= known_s
    assert rig.log.ticks[-1].control == "held" and rig.stub.truth().mode == "OFFBOARD"
    assert rig.log.ticks[-1].phase in ("acquiring", "orbiting")


@pytest.mark.parametrize("noticed", [True, False], ids=["noticed", "unnoticed"])
def test_after_a_failsafe_the_aircraft_is_not_taken_back(noticed):
    rig = in_orbit()
    rig.break_link(noticed=noticed)
    rig.run(4.0)
    assert rig.stub.truth().mode != "OFFBOARD"
    back_s = rig.mend_link()
    rig.run(20.0)
    assert rig.setpoints(back_s) == []
    assert commands(rig, back_s, DO_SET_MODE) == []
    assert rig.log.ticks[-1].phase == "released"
    assert rig.stub.truth().mode != "OFFBOARD"


def test_the_pilot_who_took_over_during_the_break_keeps_the_aircraft():
    rig = in_orbit()
    rig.break_link()
    rig.pilot.mode(HOLD)
    rig.run(0.4)
    back_s = rig.mend_link()
    rig.run(10.0)
    assert rig.setpoints(back_s) == []
    assert rig.log.ticks[-1].phase == "released" and rig.stub.truth().mode == "AUTO/LOITER"


def test_a_request_that_was_under_way_is_not_taken_up_again():
    rig = BreakableRig(config(orbit={"radius_m": 30.0}), airborne(distance_m=60.0, seed=5))
    rig.run(20.0, until=lambda: bool(rig.log.sent(rig.now_s - 0.1)))
    rig.flight.link.authority.ask(rig.now_s)
    rig.break_link()
    rig.run(0.5)
    back_s = rig.mend_link()
    rig.run(10.0)
    assert commands(rig, 0.0, DO_SET_MODE) == [] and rig.setpoints(back_s) == []
    assert rig.log.ticks[-1].phase == "released"
    assert "the link was lost while Offboard was asked for" in [
        e.text.removeprefix("released: ") for e in rig.flight.events
    ]


def test_streams_are_asked_for_again_and_the_mode_first_of_all():
    rig = in_orbit()
    rig.break_link()
    rig.run(0.3)
    back_s = rig.mend_link()
    rig.run(5.0)
    dated, first = (m for _, m in rig.decoded(back_s)[:2])
    assert (dated.get_type(), dated.tc1) == ("TIMESYNC", 0)  # its answer dates the mode that follows
    assert (first.get_type(), first.command, first.param1) == ("COMMAND_LONG", REQUEST_MESSAGE, 436.0)
    asked = {int(m.param1) for m in commands(rig, back_s, SET_MESSAGE_INTERVAL)}
    assert {436, 30, 32} <= asked


def test_a_lost_ranging_link_stops_nothing_by_itself():
    rig = in_orbit()
    rig.flight.link_lost(RANGING, rig.now_s, "serial:///dev/ttyUSB0: the other end is gone")
    at_s = rig.now_s
    rig.run(1.0)
    assert len(rig.log.sent(at_s)) > 40
    rig.flight.link_back(RANGING, rig.now_s, "open again")
    assert commands(rig, at_s, REQUEST_MESSAGE) == []


def test_before_any_autopilot_is_known_a_caller_gets_no_command():
    rig = BreakableRig(config(), airborne())
    rig.flight.link_back(VEHICLE, 0.0, "127.0.0.1 has called")
    assert [m.get_type() for _, m in rig.decoded()] == []
    rig.step()
    assert {m.get_type() for _, m in rig.decoded()} == {"HEARTBEAT"}
