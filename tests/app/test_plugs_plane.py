"""Every law and estimator on the stub's airplane over MAVLink bytes, and the study's rows flown again on it.

The multirotor's table is test_plugs.py. Errors are the stub's truth. A few flights always, all of them in the soak.
"""

from __future__ import annotations

import math
import os

import pytest

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.compare import flies_on
from circumnav_mav.study.scenarios import SCENARIOS
from tests.app.test_plugs import SWITCHING
from tests.lockstep import Rig
from tests.stub_rows import BANK_DEG, HEIGHT_M, ROWS, fly, main, rig_of

SHARE, SEED = float(os.environ.get("SOAK_SHARE", "1")), int(os.environ.get("SOAK_SEED", "1"))
SEEDS = range(SEED, SEED + max(1, round(3 * SHARE)))
PLANE = "R_calm"
"""Laws on range and range rate are flown in still air: in wind they lose a plane (docs/estimation.md)."""

EVERY_LAW = [(law, next(e for e in ("direct", "drift") if flies_on(law, e))) for law in LAWS]
EVERY_ESTIMATOR = [("hashemi2013", estimator) for estimator in ESTIMATORS if estimator != "direct"]
PAIRS = [*EVERY_LAW, *EVERY_ESTIMATOR]
ALWAYS = {("hashemi2013", "polar")}


def bound_m(law: str, estimator: str) -> float:
    """The rms that a flight may have; for those that weave, half of what counts as lost.

    Full turns from side to side take 2.3 s at 0.5 rad/s^2; and raw feeds the difference of two noisy ranges to the law.
    """
    return 10.0 if law in SWITCHING or estimator == "raw" else 1.2


def some(items, always):
    """Mark all but a few for the soak."""
    return [item if item in always else pytest.param(*item, marks=pytest.mark.soak) for item in items]


def keep_the_rules(rig: Rig) -> None:
    """What holds in every flight: finite, never steeper than the bank limit, at the height, at the right vehicle."""
    for t, message in rig.setpoints():
        w, x, y, z = message.q
        assert all(math.isfinite(v) for v in (w, x, y, z, message.thrust)), (t, message)
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        assert abs(math.degrees(roll)) <= BANK_DEG + 1e-3, (t, message)
        assert (message.target_system, message.type_mask) == (rig.stub.config.system_id, 7)
    engaged_s = rig.setpoints()[0][0]
    heights = [truth.height_m for truth in rig.log.truth if truth.t_s > engaged_s + 5.0]
    assert abs(max(heights) - HEIGHT_M) < 4.0
    assert abs(min(heights) - HEIGHT_M) < 4.0


@pytest.mark.parametrize(("law", "estimator"), some(PAIRS, ALWAYS))
def test_every_law_and_estimator_flies_the_plane(law, estimator):
    rig = rig_of(SCENARIOS[PLANE], SEED, law, estimator).engage()
    log = rig.run(200.0)
    assert log.phases[-1] == "orbiting" or law in SWITCHING or estimator == "raw", (log.phases, rig.flight.events)
    assert log.phases[-1] in ("acquiring", "orbiting")
    assert log.rms_m(80.0) < bound_m(law, estimator), f"seed {SEED}"
    keep_the_rules(rig)


@pytest.mark.soak
@pytest.mark.parametrize("name", ROWS)
def test_a_row_of_the_study_is_flown_as_well_on_the_stub(name):
    flown_as_well(name, SEEDS)


@pytest.mark.soak
def test_a_row_with_a_wrong_airspeed_is_flown_as_well_on_the_stub():
    flown_as_well("R_airspeed_high", [SEED])


def flown_as_well(name, seeds):
    row = fly(name, seeds)
    assert row.lost == 0, f"seeds {seeds}"
    assert row.rms_m <= row.bound_m, f"seeds {seeds}: {row}"


def test_the_command_names_the_rows_there_are(capsys):
    assert main(["R_nothing"]) == 2
    assert "R_wind7" in capsys.readouterr().err
