"""ArduCopter and ArduPlane in Guided, in lockstep with a small ArduPilot made of what was measured."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config_file import load
from circumnav_mav.flight import Flight
from circumnav_mav.flight_record import TickRecord
from tests.lockstep import config
from tests.trust.rules import beyond_talk
from tests.vehicles.ardupilot import COPTER, GUIDED, PLANE, STEP_S, FakeArduPilot

CONFIGS = Path(__file__).parents[2] / "configs"
LOITER = {COPTER: 5, PLANE: 12}
RTL = {COPTER: 6, PLANE: 11}
ENGAGED = ("acquiring", "orbiting", "coasting")
APPS: dict[int, dict[str, Any]] = {
    COPTER: {"vehicle": {"class": "arducopter"}, "limits": {"turn_rate_rad_s": 0.5, "turn_accel_rad_s2": 1.5}},
    PLANE: {
        "vehicle": {"class": "arduplane"},
        "orbit": {"radius_m": 120.0, "speed_m_s": 23.5},
        "law": {"kappa": 4.0},
        "limits": {"turn_accel_rad_s2": 0.3, "bank_deg": 40.0},
    },
}


class Rig:
    """App and autopilot on one clock, 50 Hz."""

    def __init__(self, kind: int, vehicle: FakeArduPilot | None = None, **sections: Any) -> None:
        app = {**APPS[kind], **sections}
        if "orbit" in sections:
            app["orbit"] = {**APPS[kind].get("orbit", {}), **sections["orbit"]}
        self.config = config(**app)
        self.flight = Flight(self.config)
        self.vehicle = vehicle or FakeArduPilot(kind, LOITER[kind], height_m=80.0)
        self.radius_m = self.flight.computer._settings.context.r_a
        self.ticks: list[TickRecord] = []
        self.ranges: list[float] = []
        self.sent: list[tuple[float, Any]] = []
        self.decoder = mavlink.MAVLink(None)
        self.frozen = False

    def run(self, for_s: float) -> Rig:
        for _ in range(round(for_s / STEP_S)):
            self.vehicle.advance()
            if self.frozen:
                continue
            now_s = self.vehicle.now_s
            for data in self.vehicle.take():
                self.flight.receive(data, now_s)
            now_s = self.flight.resume(now_s, lambda: self.vehicle.now_s)
            frames, record = self.flight.tick(now_s)
            for frame in frames:
                self.sent.append((now_s, self.decoder.decode(bytearray(frame))))
                self.vehicle.receive(frame)
            self.ticks.append(record)
            self.ranges.append(self.vehicle.range_m)
        return self

    def engage(self) -> Rig:
        self.run(4.0)
        assert self.phase == "ready", (self.phases, self.flight.waiting_for)
        self.vehicle.set_mode(GUIDED[self.vehicle.kind])
        return self.run(0.1)

    @property
    def phase(self) -> str:
        return self.ticks[-1].phase

    @property
    def phases(self) -> list[str]:
        return list(dict.fromkeys(str(tick.phase) for tick in self.ticks))

    def setpoints(self, from_s: float = 0.0) -> list[tuple[float, Any]]:
        return [(t, m) for t, m in self.sent if t >= from_s and m.get_type().startswith("SET_")]

    def commanded(self, command: int, from_s: float = 0.0) -> list[tuple[float, ...]]:
        return [p for t, c, p, _ in self.vehicle.commands if c == command and t >= from_s]

    def rms_m(self, last_s: float) -> float:
        errors = [r - self.radius_m for r in self.ranges[-round(last_s / STEP_S) :]]
        return math.sqrt(sum(e * e for e in errors) / len(errors))


KINDS = pytest.mark.parametrize("kind", [COPTER, PLANE], ids=["copter", "plane"])


@KINDS
def test_nothing_is_streamed_before_guided_and_the_pilots_choice_of_it_is_taken_at_once(kind):
    rig = Rig(kind).run(4.0)
    assert rig.phase == "ready"
    assert rig.setpoints() == []
    assert any("select Guided" in event.text for event in rig.flight.events)
    rig.engage()
    assert rig.phase == "acquiring"
    assert rig.setpoints()[0][0] - 8.0 < 0.05, "the first setpoint leaves as the mode is seen"


@pytest.mark.parametrize(("kind", "rms_m"), [(COPTER, 0.6), (PLANE, 2.0)], ids=["copter", "plane"])
def test_it_circles(kind, rms_m):
    rig = Rig(kind).engage().run(120.0)
    assert rig.phase == "orbiting", (rig.phases, rig.flight.events)
    assert rig.rms_m(40.0) < rms_m
    assert rig.vehicle.status == 4, "no internal error: nothing was NaN"
    assert rig.vehicle.height == pytest.approx(80.0, abs=1.0)
    masks = {m.type_mask for _, m in rig.setpoints()}
    assert masks == {1479 if kind == COPTER else 254}


@pytest.mark.parametrize(
    ("kind", "beacon_height"),
    [(COPTER, None), (PLANE, None), (PLANE, 0.0)],
    ids=["copter", "plane level", "plane slant"],
)
def test_the_shipped_configuration_settles(kind, beacon_height):
    """As it is in the file: the plane is not told whether its beacon lies on the ground, and ranges are slant."""
    shipped = load(CONFIGS / ("arducopter.yaml" if kind == COPTER else "arduplane.yaml"))
    rig = Rig(kind)
    rig.config, rig.flight, rig.radius_m = shipped, Flight(shipped), shipped.orbit.radius_m
    rig.vehicle.beacon_height = beacon_height
    rig.engage().run(120.0)
    assert rig.phase == "orbiting", (rig.phases, rig.flight.events)
    assert rig.rms_m(30.0) < 0.03 * shipped.orbit.radius_m


def test_the_plane_turns_as_asked_though_its_bank_turns_it_by_less():
    """0.745 of a coordinated turn: on the settled orbit the turn rate flown is the one that was asked for."""
    rig = Rig(PLANE).engage().run(120.0)
    tail = rig.ticks[-1500:]
    asked = sum(t.turn_rate_sent_rad_s for t in tail) / len(tail)
    flown = sum(t.turn_rate_flown_rad_s for t in tail) / len(tail)
    assert flown == pytest.approx(asked, rel=0.03)
    assert flown == pytest.approx(-22.0 * 1.067 / 120.0, rel=0.03)


def test_the_plane_gets_its_fall_back_heading_and_height_once():
    rig = Rig(PLANE, orbit={"height_m": 95.0}).engage().run(30.0)
    assert len(rig.commanded(43002)) == 1
    assert [p[6] for p in rig.commanded(43001)] == [95.0]
    assert all(result == 0 for _, c, _, result in rig.vehicle.commands if c in (43001, 43002))
    assert rig.vehicle.height == pytest.approx(95.0, abs=1.0)


@KINDS
def test_no_stream_is_asked_for_that_it_refuses(kind):
    rig = Rig(kind).run(5.0)
    assert rig.vehicle.texts == []


@KINDS
@pytest.mark.parametrize("to", [LOITER, RTL], ids=["loiter", "rtl"])
def test_the_mode_left_is_released_for_good(kind, to):
    rig = Rig(kind).engage().run(20.0)
    rig.vehicle.set_mode(to[kind])
    left_s = rig.vehicle.now_s
    rig.run(5.0)
    assert rig.phase == "released"
    assert max(t for t, _ in rig.setpoints()) - left_s <= 0.05
    rig.vehicle.set_mode(GUIDED[kind])
    rig.run(3.0)
    assert rig.phase == "released", "latched, also when Guided comes back"
    assert rig.setpoints(left_s + 0.05) == []
    assert rig.commanded(176) == []


@KINDS
@pytest.mark.parametrize("engaged_s", [0.02, 0.3, 1.0])
def test_no_command_that_waited_leaves_after_a_release(kind, engaged_s):
    """Its acknowledgements are lost, so that heading and height are still asked for as the pilot takes over."""
    rig = Rig(kind, orbit={"height_m": 95.0}).run(4.0)
    rig.vehicle.acknowledges = False
    rig.vehicle.set_mode(GUIDED[kind])
    rig.run(engaged_s)
    assert rig.phase == "acquiring"
    rig.vehicle.set_mode(RTL[kind])
    left_s = rig.vehicle.now_s + STEP_S / 2
    rig.run(5.0)
    assert rig.phase == "released"
    assert beyond_talk([(t, m) for t, m in rig.sent if t > left_s + STEP_S]) == []


@KINDS
def test_guided_that_was_on_before_is_somebody_elses(kind):
    rig = Rig(kind, FakeArduPilot(kind, GUIDED[kind], height_m=80.0)).run(8.0)
    assert rig.phase == "ready"
    assert rig.setpoints() == []
    assert "choose another mode, then Guided again" in rig.flight.link.authority.why_not(rig.vehicle.now_s)
    rig.vehicle.set_mode(LOITER[kind])
    rig.run(2.0)
    rig.vehicle.set_mode(GUIDED[kind])
    assert rig.run(0.1).phase == "acquiring"


@KINDS
def test_guided_without_a_range_is_not_taken_not_even_when_the_range_comes(kind):
    rig = Rig(kind)
    rig.vehicle.radio = False
    rig.run(4.0)
    rig.vehicle.set_mode(GUIDED[kind])
    rig.run(3.0)
    rig.vehicle.radio = True
    rig.run(3.0)
    assert rig.phase == "ready"
    assert rig.setpoints() == []


@KINDS
def test_a_loop_that_was_away_for_longer_than_the_timeout_gives_up(kind):
    """GUIDED stays GUIDED when setpoints stop: the mode does not say that the vehicle has stopped by itself."""
    rig = Rig(kind).engage().run(20.0)
    rig.frozen = True
    rig.run(5.0)
    rig.frozen = False
    back_s = rig.vehicle.now_s
    rig.run(5.0)
    assert rig.vehicle.mode == GUIDED[kind]
    assert rig.phase == "released"
    assert rig.setpoints(back_s + 0.01) == []


@KINDS
def test_a_range_that_is_lost_hands_over_to_the_autopilot(kind):
    rig = Rig(kind, ranging={"coast_s": 3.0}).engage().run(20.0)
    rig.vehicle.radio = False
    rig.run(8.0)
    assert rig.vehicle.mode == (17 if kind == COPTER else 12)  # Brake: Loiter would follow the throttle stick
    last_s = rig.setpoints()[-1][0]
    rig.run(3.0)
    assert rig.setpoints()[-1][0] == last_s


@KINDS
def test_engage_auto_takes_off_and_circles(kind):
    vehicle = FakeArduPilot(kind, 0, beacon=(250.0, 100.0))
    vehicle.ekf_from_s, vehicle.arm_from_s = 6.0, 9.0
    rig = Rig(kind, vehicle, engage="auto", orbit={"height_m": 40.0}).run(90.0)
    assert rig.flight.problem == ""
    assert "acquiring" in rig.phases, (rig.phases, rig.flight.waiting_for, rig.flight.events)
    first_s = rig.setpoints()[0][0]
    climbed = [r.height_m for r in rig.ticks if r.t_s <= first_s][-1]
    assert climbed > 38.0
    assert vehicle.mode == GUIDED[kind]
    assert vehicle.height == pytest.approx(40.0, abs=2.0)


def test_a_plane_that_takes_off_to_less_climbs_the_rest_once_engaged():
    vehicle = FakeArduPilot(PLANE, 0, beacon=(250.0, 100.0))
    vehicle.ekf_from_s, vehicle.arm_from_s = 6.0, 9.0
    vehicle.parameters["TKOFF_ALT"] = 30.0
    rig = Rig(PLANE, vehicle, engage="auto", orbit={"height_m": 60.0}).run(90.0)
    assert rig.flight.problem == ""
    assert "acquiring" in rig.phases
    first_s = rig.setpoints()[0][0]
    assert [r.height_m for r in rig.ticks if r.t_s <= first_s][-1] == pytest.approx(30.0, abs=3.0)
    assert vehicle.height == pytest.approx(60.0, abs=2.0)


@KINDS
def test_a_link_that_loses_a_third_does_not_end_the_orbit(kind):
    """HEARTBEAT alone tells the mode, once a second: three lost in a row are common, and were taken for silence."""
    draw = random.Random(3)
    rig = Rig(kind).engage()
    take, receive = rig.vehicle.take, rig.vehicle.receive
    rig.vehicle.take = lambda: [data for data in take() if draw.random() > 0.3]
    rig.vehicle.receive = lambda data: receive(data) if draw.random() > 0.3 else None
    rig.run(200.0)
    assert rig.phase == "orbiting", (rig.phases, rig.flight.events)


@KINDS
def test_one_that_has_restarted_and_streams_nothing_is_asked_again(kind):
    rig = Rig(kind).run(6.0)
    assert rig.phase == "ready"
    rig.vehicle._interval.clear()
    begin = len(rig.ticks)
    rig.run(12.0)
    assert any(tick.phase != "ready" for tick in rig.ticks[begin:])
    assert rig.phase == "ready", rig.flight.waiting_for


@KINDS
def test_one_that_has_restarted_and_streams_nothing_is_never_flown_blind(kind):
    rig = Rig(kind).run(6.0)
    rig.vehicle._interval.clear()
    rig.vehicle.receive = lambda data: None
    rig.run(3.0)
    rig.vehicle.set_mode(GUIDED[kind])
    rig.run(5.0)
    assert rig.setpoints() == []


def test_the_copter_waits_for_its_estimator():
    vehicle = FakeArduPilot(COPTER, LOITER[COPTER], height_m=20.0)
    vehicle.ekf_from_s = 1e9
    rig = Rig(COPTER, vehicle).run(10.0)
    assert rig.phase == "waiting_autopilot"
    assert "no horizontal velocity" in rig.flight.waiting_for or "no position" in rig.flight.waiting_for


def test_guided_on_the_ground_is_not_taken():
    vehicle = FakeArduPilot(COPTER, LOITER[COPTER])
    vehicle.armed = True
    rig = Rig(COPTER, vehicle).run(4.0)
    assert rig.phase == "ready"
    assert not any("to engage" in event.text for event in rig.flight.events)
    vehicle.set_mode(GUIDED[COPTER])
    rig.run(3.0)
    assert rig.setpoints() == []
    assert rig.phase == "ready"


@KINDS
@pytest.mark.parametrize(("out_s", "held"), [(1.0, True), (2.2, True), (3.2, False)])
def test_an_outage_longer_than_it_holds_a_setpoint_ends_the_flight(kind, out_s, held, monkeypatch):
    """3 s by GUID_TIMEOUT (fixed on a plane): until then it flies on the last one, and stays in Guided after it.

    Released as silent for 3.5 s where the last HEARTBEAT was one second old when the link went."""
    rig = Rig(kind).engage().run(5.0)
    take, began_s = rig.vehicle.take, rig.vehicle.now_s
    with monkeypatch.context() as cut:
        cut.setattr(rig.vehicle, "receive", lambda data: None)
        cut.setattr(rig.vehicle, "take", lambda: take()[:0])
        rig.run(out_s)
    assert rig.setpoints()[-1][0] == pytest.approx(began_s + min(1.5, out_s), abs=0.05)
    back_s = rig.vehicle.now_s
    rig.run(3.0)
    assert bool(rig.setpoints(back_s + 0.01)) is held
    assert rig.ticks[-1].control == ("held" if held else "released")
