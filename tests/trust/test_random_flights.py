"""Random flights in lockstep: a start, a wind, faults at any time. However they end, no safety rule is broken.

One fault a flight at least; the seed is in the name of the test. 2,000 flights in soak, scaled by SOAK_SHARE.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub.streams import BUILDERS
from tests.lockstep import Peer, Rig, airborne, config
from tests.trust.rules import HOLD, LAND, OFFBOARD, POSITION, RETURN, keep_the_rules
from tests.trust.test_safety import bend_ranges, shows, silence
from tests.trust.wires import bad

FLIGHTS, BATCH = 2000, 20
SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))
BATCHES = max(1, round(FLIGHTS * SHARE / BATCH))

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
    other = Peer(rig.stub, *rng.choice(((2, 1), (255, 190), (1, 158))))
    for _ in range(4):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 12 if other.mav.srcComponent == 1 else 8, 157, HOLD, 4, 3)
        rig.flight.receive(heartbeat.pack(other.mav), rig.now_s)
        rig.run(0.3)


def end(rig: Rig, rng: Draw, patch: pytest.MonkeyPatch) -> None:
    rig.flight.end("stopped by the operator")


FAULTS: tuple[Fault, ...] = (
    freeze, pilot, indecisive_pilot, deaf, restart_app, wild_ranges, no_radio, streams_stop, not_a_number, low_battery,
    position_lost, rubbish, stranger, end,
)  # fmt: skip


def fly(seed: str, patch: pytest.MonkeyPatch) -> list[str]:
    """Fly one random flight of up to 60 s and hold it to the rules; return what was done to it."""
    rng = random.Random(seed)
    app = {
        "orbit": {"radius_m": rng.uniform(20.0, 80.0), "direction": rng.choice(("clockwise", "anticlockwise"))},
        "ranging": {"coast_s": rng.choice((0.0, 2.0, 20.0)), "max_age_s": rng.choice((0.3, 1.0))},
        "on_range_lost": rng.choice(("hold", "stop", "return", "land")),
        "loop": {"rate_hz": 50.0},
    }
    if rng.random() < 0.3:
        app["orbit"]["r_min_m"] = app["orbit"]["radius_m"] - 8.0
    world = {
        "seed": rng.randrange(10**6),
        "heading_rad": rng.uniform(-math.pi, math.pi),
        "wind_east_m_s": rng.uniform(-3.0, 3.0),
        "range_sigma_m": rng.choice((0.1, 0.3, 1.0)),
        "outlier_share": rng.choice((0.0, 0.0, 0.1)),
        "params": {"COM_OBL_RC_ACT": rng.choice((0, 1, 3, 4, 5))},
    }
    wires = None
    if rng.random() < 0.3:
        wires = bad(rng.randrange(10**6), loss=rng.choice((0.0, 0.1, 0.3)), doubled=rng.choice((0.0, 0.2)),
                    held_back=rng.choice((0.0, 0.2)), delay_s=rng.choice((0.0, 0.1, 0.3)))  # fmt: skip
    rig = Rig(config(**app), airborne(rng.uniform(10.0, 250.0), rng.uniform(-3.0, 3.0), **world), wires)
    done: list[str] = []
    rig.run(rng.uniform(2.0, 5.0))
    while rig.now_s < rng.uniform(30.0, 60.0) and not rig.flight.done:
        if rig.log.ticks[-1].control == "not held" and rng.random() < 0.6:
            rig.pilot.mode(OFFBOARD)
            rig.run(rng.uniform(1.5, 12.0))
        else:
            fault = rng.choice(FAULTS)
            done.append(fault.__name__)
            fault(rig, rng, patch)
            rig.run(rng.uniform(0.1, 8.0))
    keep_the_rules(rig)
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
    for i in range(3):
        with pytest.MonkeyPatch.context() as patch:
            seen += fly(f"few:{i}", patch)
    assert "acquiring" in seen
    assert len({f.__name__ for f in FAULTS} & set(seen)) >= 3
    assert dict(BUILDERS) == honest
