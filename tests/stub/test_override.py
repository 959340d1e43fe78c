"""Pilot override and a ground station beside the companion, row by row: PX4.md, section 8; and flights without GPS."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.stub.rig import HOLD, OFFBOARD, Rig, first_time, flying

POSCTL = 0x00030000


class Station:
    """A ground station 255/190 on the gcs link of a rig's stub."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.mav.robust_parsing = True
        self.heard: list[Any] = []
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def send(self, message: Any) -> None:
        self.rig.stub.receive("gcs", message.pack(self.mav))

    def set_mode(self, custom_mode: int) -> list[int]:
        main, sub = (custom_mode >> 16) & 0xFF, custom_mode >> 24
        self.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, main, sub, 0, 0, 0, 0))
        self.rig.run(0.1)
        self.listen()
        return [m.result for m in self.heard if m.get_type() == "COMMAND_ACK"]

    def listen(self) -> None:
        for datagram in self.rig.stub.take("gcs"):
            self.heard += self.mav.parse_buffer(datagram) or []

    def texts(self) -> list[str]:
        self.listen()
        return [m.text for m in self.heard if m.get_type() == "STATUSTEXT"]


def sticks(rig: Rig, x: int = 0) -> None:
    rig.send(mavlink.MAVLink_manual_control_message(1, x, 0, 500, 0, 0))


def with_sticks(rig: Rig, seconds: float, x: int = 0) -> None:
    for _ in range(round(seconds / 0.05)):
        sticks(rig, x)
        rig.run(0.05)


def in_offboard(**fields: Any) -> Rig:
    rig = flying(**fields)
    rig.command(511, 436, 100000)
    rig.enter_offboard(lambda _: rig.local(velocity=(3, 0, 0)))
    rig.run(2.0)
    return rig


def test_gcs_takes_over_with_hold() -> None:
    rig = in_offboard()
    station = Station(rig)
    rig.run(0.5)
    asked_s = rig.now_s
    assert station.set_mode(HOLD) == [0, 0]
    rig.run(2.0)
    assert rig.mode == "AUTO/LOITER"
    assert rig.acks(176, asked_s) == []  # the companion sees no acknowledgement
    seen_s = next(t for t, m in rig.heard if t > asked_s and m.get_type() == "CURRENT_MODE")
    assert seen_s - asked_s <= 0.15
    assert rig.all("CURRENT_MODE")[-1].custom_mode == HOLD
    assert rig.all("HEARTBEAT")[-1].system_status == 4
    rig.run(5.0)  # the stream goes on, without effect and without complaint
    assert rig.mode == "AUTO/LOITER"
    assert not [t for t in station.texts() if "SET_POSITION" in t]


def test_the_companion_may_take_it_back_at_once() -> None:
    rig = in_offboard()
    Station(rig).set_mode(HOLD)
    assert rig.mode == "AUTO/LOITER"
    assert rig.set_mode(OFFBOARD) == [0, 0]
    assert rig.mode == "OFFBOARD"


def test_posctl_without_a_joystick_is_refused() -> None:
    rig = in_offboard()
    station = Station(rig)
    assert station.set_mode(POSCTL) == [0, 1]
    assert rig.mode == "OFFBOARD"
    assert "Switching to Position is currently not available\t" in station.texts()


def test_a_refused_mode_of_the_companion_is_not_commented() -> None:
    rig = flying()
    rig.gcs_heartbeat()
    assert rig.set_mode(OFFBOARD) == [0, 1]
    assert rig.texts() == []


def test_posctl_with_a_joystick() -> None:
    rig = in_offboard()
    with_sticks(rig, 0.5)
    assert rig.set_mode(POSCTL) == [0, 0]
    with_sticks(rig, 1.2)
    beat = rig.all("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.base_mode, beat.system_status) == (POSCTL, 209, 4)


def test_sticks_do_nothing_in_offboard_by_default() -> None:
    rig = in_offboard()
    with_sticks(rig, 2.0, x=800)
    assert rig.mode == "OFFBOARD"


@pytest.mark.parametrize(("override", "command", "taken"), [(1, 17, True), (1, 20, True), (1, 21, True), (0, 17, False),
                                                            (2, 17, False)])  # fmt: skip
def test_sticks_take_over_from_what_flies_by_itself(override: int, command: int, taken: bool) -> None:
    """COM_RC_OVERRIDE bit 0, set by default: Hold, Return and Land give way, by PX4's documents."""
    rig = flying(params={"COM_RC_OVERRIDE": override})
    rig.gcs_heartbeat()
    rig.command(command)
    before = rig.mode
    with_sticks(rig, 0.5)
    assert rig.mode == before
    with_sticks(rig, 1.0, x=800)
    assert rig.mode == ("POSCTL" if taken else before)
    assert rig.texts().count("Pilot took over using sticks\t") == int(taken)


def test_sticks_do_not_take_over_an_airplane() -> None:
    rig = Rig(airframe="fixed_wing", start_height_m=100.0, params={"COM_RC_OVERRIDE": 3})
    rig.run(0.5)
    with_sticks(rig, 1.0, x=800)
    assert rig.mode == "AUTO/LOITER"


def test_sticks_take_over_with_COM_RC_OVERRIDE_3() -> None:
    rig = in_offboard(params={"COM_RC_OVERRIDE": 3})
    rig.gcs_heartbeat()
    with_sticks(rig, 0.5)
    assert rig.mode == "OFFBOARD"
    with_sticks(rig, 1.0, x=800)
    assert rig.mode == "POSCTL"
    assert "Pilot took over using sticks\t" in rig.texts()
    sticks(rig)
    assert rig.set_mode(OFFBOARD) == [0, 0]


def test_joystick_lost_in_offboard() -> None:
    """Hold (status 5) after 0.66 s, RTL after 5.8 s; the intention stays OFFBOARD."""
    rig = in_offboard()
    rig.gcs_heartbeat()
    with_sticks(rig, 1.0)
    lost_s = rig.now_s - 0.05
    first_time(rig, lambda: rig.mode == "AUTO/LOITER", 3.0)
    assert rig.now_s - lost_s == pytest.approx(0.66, abs=0.1)
    assert "Failsafe activated: entering Hold for 5 seconds\t" in rig.texts()
    first_time(rig, lambda: rig.mode == "AUTO/RTL", 8.0)
    assert rig.now_s - lost_s == pytest.approx(5.8, abs=0.2)
    rig.run(1.1)
    assert rig.all("HEARTBEAT")[-1].system_status == 5
    assert rig.all("CURRENT_MODE")[-1].intended_custom_mode == OFFBOARD


def test_offboard_flies_on_without_a_joystick_if_asked_again() -> None:
    rig = in_offboard()
    with_sticks(rig, 1.0)
    rig.run(2.0)
    assert rig.mode == "AUTO/LOITER"
    assert rig.set_mode(OFFBOARD) == [0, 0]
    rig.run(10.0)
    assert rig.mode == "OFFBOARD"


def test_COM_RCL_EXCEPT_4_ignores_the_loss() -> None:
    rig = in_offboard(params={"COM_RCL_EXCEPT": 4})
    with_sticks(rig, 1.0)
    rig.run(10.0)
    assert rig.mode == "OFFBOARD"


def test_a_lost_ground_station_does_nothing() -> None:
    rig = in_offboard()
    Station(rig)
    rig.run(20.0)
    assert rig.mode == "OFFBOARD"
    assert not rig.stub.truth().failsafe


def test_current_mode_tells_the_intention_in_a_failsafe() -> None:
    rig = in_offboard(params={"COM_OBL_RC_ACT": 5})
    rig.streaming = None
    rig.run(1.6)
    shown = rig.all("CURRENT_MODE")[-1]
    assert (shown.custom_mode, shown.intended_custom_mode) == (HOLD, OFFBOARD)


def test_current_mode_asked_at_10_hz_comes_at_2_hz_and_on_every_change() -> None:
    rig = in_offboard()
    began_s = rig.now_s
    rig.run(10.0)
    assert len(rig.all("CURRENT_MODE", began_s)) == pytest.approx(20, abs=1)
    changed_s = rig.now_s
    rig.set_mode(HOLD)
    assert min(t for t, m in rig.heard if t >= changed_s and m.get_type() == "CURRENT_MODE") - changed_s <= 0.11


# -- without GPS -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "acks"), [("velocity", [0, 1]), ("position", [0, 1]), ("attitude", [0, 0])])
def test_without_gps_only_attitudes_fly(kind: str, acks: list[int]) -> None:
    rig = Rig(gps=False, start_height_m=30.0)
    rig.streaming = lambda _: {
        "velocity": rig.local(velocity=(1, 0, 0)),
        "position": rig.local(frame=1, mask=0b110111111000),
        "attitude": rig.attitude(0.0, 0.0, 0.0, 0.489),
    }[kind]
    rig.run(0.5)
    assert rig.set_mode(OFFBOARD) == acks


def test_without_gps_there_is_no_global_position() -> None:
    rig = Rig(gps=False, streams=(32, 33, 24))
    rig.run(2.0)
    assert rig.all("GLOBAL_POSITION_INT") == []
    assert rig.all("GPS_RAW_INT")[-1].fix_type == 0
    assert math.hypot(rig.all("LOCAL_POSITION_NED")[-1].x, rig.all("LOCAL_POSITION_NED")[-1].y) == 0.0


def test_without_gps_there_is_no_home_before_there_is_a_position() -> None:
    """HOME_POSITION waits for the first position after booting; with that lost again, home stays what it was."""
    rig = Rig(gps=False, streams=(242,))
    rig.run(5.0)
    assert rig.all("HOME_POSITION") == []
    assert [rig.command(410), rig.command(512, 242), rig.command(512, 33)] == [[2], [2], [2]]
    assert rig.all("HOME_POSITION") + rig.all("GLOBAL_POSITION_INT") == []

    rig = Rig(faults=("2-9 no-gps", "3 reboot", "12-inf no-gps"))
    rig.run(2.5)
    assert rig.all("HOME_POSITION")
    rig.run(6.4)
    assert rig.all("HOME_POSITION", since_s=3.0) == []
    rig.run(8.0)
    assert rig.all("HOME_POSITION", since_s=9.0) and rig.all("HOME_POSITION", since_s=13.0)


def test_home_looks_where_the_nose_looked() -> None:
    rig = Rig(start_heading_rad=0.0, streams=(242,))  # east: 90 degrees clockwise from north
    rig.run(3.0)
    assert rig.all("HOME_POSITION")[-1].q == pytest.approx([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], abs=1e-3)


def test_without_gps_no_message_tells_where_it_really_is() -> None:
    """It drifts with the wind over ground that it cannot see: nothing horizontal may change with that."""
    rig = Rig(gps=False, start_height_m=30.0, start_speed_m_s=4.0, wind_east_m_s=6.0, streams=(24, 33, 85, 331))
    rig.stub.links["offboard"].set_interval(87, 0.1, 0.0)
    rig.run(5.0)
    truth = rig.stub.truth()
    assert math.hypot(truth.north_m, truth.east_m) > 2.0
    assert rig.all("GLOBAL_POSITION_INT") + rig.all("POSITION_TARGET_GLOBAL_INT") == []
    fix = rig.all("GPS_RAW_INT")[-1]
    assert (fix.fix_type, fix.lat, fix.lon, fix.alt) == (0, 0, 0, 0)
    assert (fix.vel, fix.cog, fix.eph, fix.epv, fix.satellites_visible) == (65535, 65535, 65535, 65535, 255)
    for kind in ("ODOMETRY", "POSITION_TARGET_LOCAL_NED"):
        shown = rig.all(kind)
        assert len(shown) > 20
        assert all(math.isnan(value) for m in shown for value in (m.x, m.y, m.vx, m.vy)), kind
        assert shown[-1].z == pytest.approx(-0.46 - truth.height_m, abs=0.1)
    assert {m.groundspeed for m in rig.all("VFR_HUD")} == {0.0}
