"""Random flights in lockstep: a vehicle class, a law, a start, a wind, faults at any time. However they end, no safety
rule is broken.

One fault a flight at least; the seed is in the name of the test. 2,000 flights in soak, scaled by SOAK_SHARE.
ArduPilot's classes fly in test_random_ardupilot.py.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config import Config, guidance_settings
from circumnav_mav.config_checks import cross_checks
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.mavlink.vehicles import VEHICLES
from sitl_stub.config import AIRFRAMES, StubConfig
from sitl_stub.streams import BUILDERS
from tests.lockstep import OFFBOARD_LINK, Rig, airborne, config
from tests.trust import outage
from tests.trust.rules import HOLD, LAND, OFFBOARD, POSITION, RETURN, keep_the_rules
from tests.trust.setpoint_rules import JUDGES
from tests.trust.test_safety import bend_ranges, shows, silence
from tests.trust.wires import bad

FLIGHTS, BATCH = 2000, 20
SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))
BATCHES = max(1, round(FLIGHTS * SHARE / BATCH))
US = (1, 191)

Draw = random.Random
Fault = Callable[[Rig, Draw, pytest.MonkeyPatch], None]


def freeze(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.freeze(rng.choice((0.1, 0.3, 0.6, 0.9, 1.3, 3.0)))


def pilot(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.pilot.mode(rng.choice((HOLD, RETURN, LAND, POSITION, OFFBOARD)))


def indecisive_pilot(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    for _ in range(4):
        rig.pilot.mode(rng.choice((HOLD, OFFBOARD, OFFBOARD, RETURN)))
        rig.run(rng.uniform(0.02, 1.5))


def deaf(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.deaf = True
    rig.run(rng.uniform(0.2, 6.0))
    rig.deaf = False


def link_out(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    outage.outage(rig, rng.uniform(0.3, 4.0))


def restart_app(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    if rng.random() < 0.5:
        rig.freeze(rng.uniform(0.1, 4.0))
    rig.restart_app()


def wild_ranges(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    kind, much = rng.randrange(4), rng.uniform(-60.0, 60.0)
    bends: tuple[Callable[[float, float], float], ...] = (
        lambda r, t: max(0.5, r + much),
        lambda r, t: max(0.5, r + much * math.sin(t)),
        lambda r, t: 5.0 + abs(much),
        lambda r, t: rng.uniform(0.5, 600.0),
    )
    bend_ranges(rig, patch, bends[kind])


def no_radio(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(rig.stub, "radio", None)


def streams_stop(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    silence(rig, tuple(rng.sample((30, 32, 33, 74, 436, 1, 230, 147, 245), rng.randrange(1, 5))))


def not_a_number(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """A field of a stream that the app steers by turns to nonsense."""
    msgid, index = rng.choice(((30, 1), (30, 3), (30, 6), (32, 3), (32, 4), (32, 5), (32, 6), (74, 0)))
    shows(msgid, index, rng.choice((math.nan, math.inf, -math.inf, 1e30)))(rig, patch)


def low_battery(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    shows(1, 6, rng.choice((-1, 0, 5)))(rig, patch)


def position_lost(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.stub.autopilot.commander.position_ok = False


def rubbish(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    for _ in range(20):
        rig.flight.receive(rng.randbytes(rng.randrange(1, 300)), rig.now_s)


def stranger(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """Another autopilot, or a forwarded ground station: their modes are not ours."""
    vehicle = rig.stub.config.system_id
    other = mavlink.MAVLink(None, *rng.choice(((vehicle % 250 + 1, 1), (255, 190), (vehicle, 158))))
    for _ in range(4):
        shown = heartbeat(2, 12 if other.srcComponent == 1 else 8, rng.choice((HOLD, OFFBOARD, 0)))
        rig.flight.receive(shown.pack(other), rig.now_s)
        rig.run(0.3)


def heartbeat(kind: int, autopilot: int, custom_mode: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 157, custom_mode, 4, 3)


def end(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight.end("stopped by the operator")


def stopped(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight.stopped()


def reboot(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """A brown-out: the autopilot starts anew where it is, in the air or on the ground."""
    rig.reboot_vehicle(
        start(rng, rig.config, rng.choice((0.0, 40.0)), rig.stub.config.system_id), silent_s=rng.uniform(0.0, 6.0)
    )


def cable(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """The link breaks and is opened again."""
    rig.deaf = True
    rig.flight.link_lost("vehicle", rig.now_s, "unplugged")
    rig.run(rng.uniform(0.02, 4.0))
    rig.flight.link_back("vehicle", rig.now_s, "open again")
    rig.deaf = False


def rival(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """A second companion, with our ids or with setpoints of its own."""
    vehicle = rig.stub.config.system_id
    other = mavlink.MAVLink(None, *rng.choice(((vehicle, 191), (vehicle, 195), (255, 190))))
    setpoint = mavlink.MAVLink_set_attitude_target_message(0, vehicle, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.5)
    rig.flight.receive(rng.choice((setpoint, heartbeat(18, 8, 0))).pack(other), rig.now_s)


def latch(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.pilot.command(mavlink.MAV_CMD_USER_1, target=(rig.stub.config.system_id, US[1]))


def sticks(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    for _ in range(rng.randrange(1, 20)):
        moved = rng.choice((0, 0, 800, -800))
        rig.pilot.send(mavlink.MAVLink_manual_control_message(rig.stub.config.system_id, moved, 0, 500, 0, 0))
        rig.run(0.05)


def drained(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """What the autopilot answers is lost: commands are asked again, and must not leave too late."""
    honest, lost_s = rig.stub.take, rig.now_s + rng.uniform(0.2, 3.0)

    def take(link: str) -> list[bytes]:
        data = honest(link)
        return [] if link == OFFBOARD_LINK and rig.now_s < lost_s else data

    patch.setattr(rig.stub, "take", take)


FAULTS: tuple[Fault, ...] = (
    freeze, pilot, indecisive_pilot, deaf, restart_app, wild_ranges, no_radio, streams_stop, not_a_number, low_battery,
    position_lost, rubbish, stranger, end, stopped, reboot, cable, rival, latch, sticks, drained, link_out,
)  # fmt: skip


CLASSES: dict[str, dict[str, Any]] = {
    "px4_multirotor": {},
    "px4_multirotor_attitude": {
        "vehicle": {"pitch_deg": -4.37},
        "limits": {"turn_rate_rad_s": 0.6, "turn_accel_rad_s2": 1.0, "bank_deg": 20.0},
    },
    "px4_fixed_wing": {"limits": {"turn_accel_rad_s2": 0.5, "bank_deg": 30.0}},
    "px4_fixed_wing_position": {"limits": {"turn_accel_rad_s2": 0.5, "bank_deg": 30.0}},
}
"""What each needs beside its name."""


def application(rng: Draw, name: str, *, auto: bool) -> Config:
    """Return a configuration that the app would take."""
    plane = "fixed_wing" in name
    law = rng.choice(list(LAWS))
    estimators = [e for e, it in ESTIMATORS.items() if set(LAWS[law].needs) <= it.gives | {"V"}]
    app = {
        **CLASSES[name],
        "vehicle": {"class": name, **CLASSES[name].get("vehicle", {})},
        "orbit": {
            "radius_m": rng.uniform(50.0, 120.0) if plane else rng.uniform(20.0, 80.0),
            "speed_m_s": 12.0 if plane else rng.choice((3.0, 5.0, 8.0)),
            "direction": rng.choice(("clockwise", "anticlockwise")),
            "height_m": (30.0 if plane else 8.0) if auto else rng.choice((None, 40.0)),
        },
        "law": {"name": law},
        "estimator": {"name": rng.choice(estimators)},
        "ranging": {"coast_s": rng.choice((1.0, 2.0, 20.0)), "max_age_s": rng.choice((0.3, 1.0))},
        "safety": {"flight_time_s": rng.choice((None, None, 15.0)), "on_height_lost": rng.choice(("hold", "fly_on"))},
        "engage": "auto" if auto else "pilot",
        "on_range_lost": rng.choice(("hold", "stop", "return", "land")),
        "loop": {"rate_hz": 50.0},
    }
    if rng.random() < 0.3:
        app["orbit"]["r_min_m"] = max(2.0, app["orbit"]["radius_m"] - rng.uniform(8.0, 40.0))
    made = config(**app)
    faults = list(cross_checks(made, guidance_settings(made)))
    return application(rng, name, auto=auto) if faults else made


def start(rng: Draw, app: Config, height_m: float, system_id: int) -> StubConfig:
    """Return a vehicle and its world."""
    plane = app.vehicle_class.airframe == "fixed_wing"
    return airborne(
        rng.choice((0.2, 0.5, 1.0, 1.2, 2.0, 4.0)) * app.orbit.radius_m,
        rng.uniform(-3.0, 3.0),
        seed=rng.randrange(10**6),
        system_id=system_id,
        airframe=app.vehicle_class.airframe,
        height_m=height_m,
        start_speed_m_s=13.0 if plane and height_m > 0.0 else 0.0,
        heading_rad=rng.uniform(-math.pi, math.pi),
        wind_east_m_s=rng.uniform(-3.0, 3.0),
        wind_north_m_s=rng.uniform(-2.0, 2.0),
        range_sigma_m=rng.choice((0.1, 0.3, 1.0)),
        outlier_share=rng.choice((0.0, 0.0, 0.1)),
        params={"COM_OBL_RC_ACT": rng.choice((0, 1, 3, 4, 5)), "COM_RC_OVERRIDE": rng.choice((1, 3))},
        gust_sigma_m_s=rng.choice((0.0, 0.0, 1.0)),
    )


def fly(seed: str, patch: pytest.MonkeyPatch) -> list[str]:
    """Fly one random flight of up to 60 s and hold it to the rules; return what was done to it."""
    rng = random.Random(seed)
    auto = rng.random() < 0.2
    app = application(rng, rng.choice(list(CLASSES)), auto=auto)
    wires = None
    if rng.random() < 0.3:
        wires = bad(rng.randrange(10**6), loss=rng.choice((0.0, 0.1, 0.3)), doubled=rng.choice((0.0, 0.2)),
                    held_back=rng.choice((0.0, 0.2)), delay_s=rng.choice((0.0, 0.1, 0.3)))  # fmt: skip
    in_air_m = 60.0 if app.vehicle_class.airframe == "fixed_wing" else 15.0
    rig = Rig(app, start(rng, app, 0.0 if auto else in_air_m, rng.choice((1, 1, 7, 250))), wires)
    done: list[str] = [app.vehicle.kind, app.engage, app.law.name, app.estimator.name]
    taken_back = outage.watch(patch)
    rig.run(rng.uniform(2.0, 5.0))
    if auto and rng.random() < 0.8:  # else something happens on the way up
        rig.run(50.0, until=lambda: rig.log.ticks[-1].control == "held" or bool(rig.flight.problem))
    end_s = rig.now_s + rng.uniform(25.0, 55.0)
    while rig.now_s < end_s and not rig.flight.done:
        if not auto and rig.log.ticks[-1].control == "not held" and rng.random() < 0.6:
            rig.pilot.mode(OFFBOARD)
            rig.run(rng.uniform(1.5, 12.0))
        else:
            fault = rng.choice(FAULTS)
            done.append(fault.__name__)
            fault(rig, rng, patch)
            rig.run(rng.uniform(0.1, 8.0))
    keep_the_rules(rig, restarted=bool({"reboot", "cable"} & set(done)))
    assert taken_back == [], "a stream that resumed took the aircraft out of the failsafe"
    return [*done, *rig.log.phases]


def batch(number: int) -> list[str]:
    seen: list[str] = []
    for i in range(BATCH):
        seed = f"{SEED}:{number}:{i}"
        with pytest.MonkeyPatch.context() as patch:
            try:
                seen += fly(seed, patch)
            except Exception as error:
                raise AssertionError(f"flight with seed {seed!r}: {error}") from error
    return seen


@pytest.mark.soak
@pytest.mark.parametrize("number", range(BATCHES))
def test_no_random_flight_breaks_a_safety_rule(number):
    batch(number)


def test_a_few_random_flights_and_they_do_reach_what_they_are_for(monkeypatch):
    seen: list[str] = []
    honest = dict(BUILDERS)
    for i in range(6):
        with pytest.MonkeyPatch.context() as patch:
            seen += fly(f"few:{i}", patch)
    assert "acquiring" in seen
    assert len({f.__name__ for f in FAULTS} & set(seen)) >= 3
    assert len(set(CLASSES) & set(seen)) >= 3
    assert dict(BUILDERS) == honest


def test_there_is_a_judge_for_every_vehicle_class():
    assert set(JUDGES) == set(VEHICLES)
    assert set(CLASSES) == {
        name for name, it in VEHICLES.items() if name.startswith("px4") and it.airframe in AIRFRAMES
    }


def good(name: str) -> Any:
    """Return a setpoint of the class as it should be."""
    place = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    if name == "px4_fixed_wing_position":
        fields = place | {"vx": 12.0, "afy": 2.0}
        return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 3072, *fields.values())
    if "attitude" in name or name in ("px4_fixed_wing", "arduplane"):
        mask = {"px4_multirotor_attitude": 3, "px4_fixed_wing": 7, "arduplane": 254}[name]
        return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5)
    return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 1479, *place.values())


STEEP = [math.cos(0.5), math.sin(0.5), 0.0, 0.0]  # 57 degrees of bank
NOSE_DOWN = [math.cos(0.2), 0.0, -math.sin(0.2), 0.0]  # 23 degrees
WRONG: list[tuple[str, str, Any]] = [
    *((name, "type_mask", 71) for name in JUDGES),
    *((name, "vx", math.nan) for name in ("px4_multirotor", "arducopter", "px4_rover", "px4_fixed_wing_position")),
    *((name, "vx", 90.0) for name in ("px4_multirotor", "arducopter", "px4_rover", "px4_fixed_wing_position")),
    *((name, "yaw_rate", 2.0) for name in ("px4_multirotor", "arducopter", "px4_rover")),
    ("px4_multirotor", "vz", 2.0),
    ("px4_multirotor", "coordinate_frame", 1),
    ("px4_fixed_wing_position", "coordinate_frame", 8),
    ("px4_fixed_wing_position", "afy", 9.0),
    ("px4_fixed_wing_position", "afx", 2.0),
    *((name, "q", q) for name in ("px4_multirotor_attitude", "px4_fixed_wing", "arduplane")
      for q in (STEEP, NOSE_DOWN, [math.nan] * 4, [0.0] * 4)),
    *((name, "thrust", t) for name in ("px4_multirotor_attitude", "px4_fixed_wing", "arduplane")
      for t in (math.nan, 1.7, -0.5)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "field", "value"), WRONG)
def test_a_judge_sees_what_is_wrong(name, field, value):
    app = config(vehicle={"class": name, "pitch_deg": -4.0}, orbit={"speed_m_s": 12.0, "radius_m": 80.0})
    message = good(name)
    JUDGES[name](message, app)
    setattr(message, field, value)
    with pytest.raises(AssertionError):
        JUDGES[name](message, app)
