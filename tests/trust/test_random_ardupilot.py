"""Random flights of ArduPilot's classes against the small ArduPilot of tests/vehicles/ardupilot.py: faults at any time,
and however they end, no safety rule is broken. 400 flights in soak, scaled by SOAK_SHARE.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.flight import Flight
from tests.trust.rules import keep
from tests.vehicles.ardupilot import COPTER, GUIDED, PLANE, STREAMS, FakeArduPilot
from tests.vehicles.test_ardupilot import LOITER, RTL, Rig

FLIGHTS, BATCH = 400, 20
SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))
BATCHES = max(1, round(FLIGHTS * SHARE / BATCH))
LAWS = (("hashemi2013", "direct"), ("hashemi2013", "polar"), ("tangent", "drift"), ("pd_bias", "raw"))

Draw = random.Random
Fault = Callable[[Rig, Draw, pytest.MonkeyPatch], None]


def said(rig: Rig, message: Any, sysid: int, compid: int) -> None:
    rig.flight.receive(message.pack(mavlink.MAVLink(None, sysid, compid)), rig.vehicle.now_s)


def freeze(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.frozen = True
    rig.run(rng.choice((0.1, 0.6, 1.2, 2.0, 3.5, 6.0)))
    rig.frozen = False


def pilot(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    kind = rig.vehicle.kind
    rig.vehicle.set_mode(rng.choice((LOITER[kind], RTL[kind], GUIDED[kind])))


def indecisive_pilot(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    for _ in range(4):
        pilot(rig, rng, patch)
        rig.run(rng.uniform(0.02, 1.5))


def deaf(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """Nothing of what the vehicle sends arrives."""
    take = rig.vehicle.take
    with pytest.MonkeyPatch.context() as cut:
        cut.setattr(rig.vehicle, "take", lambda: take()[:0])
        rig.run(rng.uniform(0.2, 6.0))


def link_out(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    """Nothing passes, either way."""
    with pytest.MonkeyPatch.context() as cut:
        cut.setattr(rig.vehicle, "receive", lambda data: None)
        deaf(rig, rng, patch)


def restart_app(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight = Flight(rig.config)


def no_radio(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.vehicle.radio = False


def streams_stop(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    for msgid in rng.sample(sorted(STREAMS), 2):
        rig.vehicle._interval.pop(msgid, None)


def not_a_number(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    msgid, field = rng.choice(((30, "roll"), (30, "yaw"), (32, "vx"), (74, "airspeed"), (74, "alt")))
    honest, value = STREAMS[msgid], rng.choice((math.nan, math.inf, 1e30))

    def bent(a: FakeArduPilot) -> Any:
        message = honest(a)
        setattr(message, field, value)
        return message

    patch.setitem(STREAMS, msgid, bent)


def estimates_lost(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.vehicle.ekf_from_s = math.inf


def failsafe(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.vehicle.status = 5


def no_answers(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.vehicle.acknowledges = not rig.vehicle.acknowledges


def rubbish(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight.receive(rng.randbytes(rng.randrange(1, 300)), rig.vehicle.now_s)


def stranger(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    sysid, compid, autopilot = rng.choice(((9, 1, 3), (255, 190, 8), (1, 191, 8)))
    mode = rng.choice((0, GUIDED[rig.vehicle.kind]))
    said(rig, mavlink.MAVLink_heartbeat_message(rig.vehicle.kind, autopilot, 217, mode, 4, 3), sysid, compid)


def rival(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    said(rig, mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.5), 1, 195)


def latch(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    command = mavlink.MAV_CMD_USER_1
    said(rig, mavlink.MAVLink_command_long_message(1, 191, command, 0, 0, 0, 0, 0, 0, 0, 0), 255, 190)


def end(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight.end("stopped by the operator")


FAULTS: tuple[Fault, ...] = (
    freeze, pilot, indecisive_pilot, deaf, restart_app, no_radio, streams_stop, not_a_number, estimates_lost, failsafe,
    no_answers, rubbish, stranger, rival, latch, end, link_out,
)  # fmt: skip


def fly(seed: str, patch: pytest.MonkeyPatch) -> list[str]:
    """Fly one random flight of up to 60 s and hold it to the rules; return what was done to it."""
    rng = random.Random(seed)
    kind = rng.choice((COPTER, PLANE))
    auto = rng.random() < 0.2
    law, estimator = rng.choice(LAWS)
    sections: dict[str, Any] = {
        "law": {"name": law},
        "estimator": {"name": estimator},
        "orbit": {"direction": rng.choice(("clockwise", "anticlockwise")), "height_m": 40.0 if auto else None},
        "ranging": {"coast_s": rng.choice((1.0, 5.0, 20.0))},
        "on_range_lost": rng.choice(("hold", "stop", "return")),
        "safety": {"on_estimates_lost": "hold", "flight_time_s": rng.choice((None, 15.0))},
        "engage": "auto" if auto else "pilot",
    }
    place = rng.uniform(30.0, 400.0), rng.uniform(-200.0, 200.0)
    vehicle = FakeArduPilot(kind, 0 if auto else LOITER[kind], height_m=0.0 if auto else 80.0, beacon=place)
    rig = Rig(kind, vehicle, **sections)
    done: list[str] = [rig.config.vehicle.kind, law]
    rig.run(rng.uniform(2.0, 5.0))
    if auto and rng.random() < 0.8:
        rig.run(25.0)
    end_s = rig.vehicle.now_s + rng.uniform(25.0, 50.0)
    while rig.vehicle.now_s < end_s and not rig.flight.done:
        if not auto and rig.ticks[-1].control == "not held" and rng.random() < 0.6:
            rig.vehicle.set_mode(LOITER[kind])
            rig.run(0.5)
            rig.vehicle.set_mode(GUIDED[kind])
            rig.run(rng.uniform(1.5, 12.0))
        else:
            fault = rng.choice(FAULTS)
            done.append(fault.__name__)
            fault(rig, rng, patch)
            rig.run(rng.uniform(0.1, 8.0))
    keep(rig.config, 1, rig.sent, rig.ticks)
    assert not [c for c in vehicle.commands if any(math.isnan(v) for v in c[2])], "a NaN, which ArduPilot never forgets"
    return [*done, *(str(tick.phase) for tick in rig.ticks)]


def batch(number: int) -> None:
    for i in range(BATCH):
        seed = f"{SEED}:{number}:{i}"
        with pytest.MonkeyPatch.context() as patch:
            try:
                fly(seed, patch)
            except Exception as error:
                raise AssertionError(f"flight with seed {seed!r}: {error}") from error


@pytest.mark.soak
@pytest.mark.parametrize("number", range(BATCHES))
def test_no_random_flight_breaks_a_safety_rule(number):
    batch(number)


def test_a_few_random_flights_and_they_do_reach_what_they_are_for():
    seen: set[str] = set()
    for i in range(4):
        with pytest.MonkeyPatch.context() as patch:
            seen |= set(fly(f"few:{i}", patch))
    assert {"arducopter", "arduplane", "acquiring"} <= seen
    assert len({f.__name__ for f in FAULTS} & seen) >= 3
