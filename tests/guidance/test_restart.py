"""What the drift filter does with hypotheses that cannot be, and what it keeps when its belief falls."""

import math

import pytest

from circumnav_mav.guidance.estimators import drift
from circumnav_mav.guidance.estimators.drift_gaussian import Drift
from circumnav_mav.guidance.kernel import NAN, RESTARTED, EstimatorContext, Memory, Moved, Reading

V = 15.0
PAR = drift.parameters({}, EstimatorContext(80.0, V, 0.46))
DT = 0.1
MOVED = Moved(DT, V * DT, 0.0, 0.0, V, 0.0, 0.0)  # due east
MEM = Memory(known=1.0, alarm=1.0)


def believing(bearing_deg, wind=(0.0, 0.0), r=90.0, log_weight=0.0) -> Drift:
    """A settled hypothesis: metres and fractions of a metre a second."""
    angle = math.radians(bearing_deg)
    c, s = math.cos(angle), math.sin(angle)
    return Drift(r * c, r * s, *wind, 0.0, 4, 0, 0, 0, 0, 4, 0, 0, 0, 0.1, 0, 0, 0.1, 0, 1e-4, 1.0, log_weight)


def reading(h: Drift) -> Reading:
    """What the sensor says a moment later if the hypothesis is right."""
    return Reading(math.hypot(h.px - (V + h.wx) * DT, h.py - h.wy * DT), NAN, 1.0)


def test_where_the_leader_cannot_be_the_ring_starts_from_the_likeliest_that_can():
    right = believing(-60.0, (-2.0, -8.0))
    impossible = believing(-9.0, (-9.0, -14.0), log_weight=3.0)  # 16.6 m/s of drift at 15
    bank = [impossible, right]
    assert drift.observe(bank, MEM, MOVED, reading(right), PAR).verdict == RESTARTED
    assert math.degrees(math.atan2(bank[0].py, bank[0].px)) == pytest.approx(-60.0, abs=360.0 / drift.RING / 2.0)


def test_one_that_is_hardly_likely_is_no_heir():
    impossible = believing(-9.0, (-9.0, -14.0))
    bank = [impossible, believing(-60.0, (-2.0, -8.0), log_weight=-drift.LIKELY - 3.0)]
    assert drift.heir(bank, PAR) == 0
    assert drift.heir([impossible, bank[1]._replace(log_weight=-1.0)], PAR) == 1


@pytest.mark.parametrize("bearing_deg", [-75.0, 60.0, 140.0])
def test_a_belief_that_falls_leaves_its_bearing_and_its_range_rate(bearing_deg):
    """Without drift the vehicle closes at V cos(bearing): a ring member elsewhere asks for a drift, and costs it."""
    falling = believing(bearing_deg)
    bank = [falling]
    mem = drift.observe(bank, MEM._replace(alarm=100.0), MOVED, reading(falling), PAR)
    assert mem.verdict == RESTARTED
    assert len(bank) > 2
    bearings = [math.degrees(math.atan2(h.py, h.px)) for h in bank]
    assert bearings[0] == pytest.approx(bearing_deg, abs=3.0)
    closing = V * math.cos(math.radians(bearing_deg))
    most = max(h.log_weight for h in bank)
    for h, bearing in zip(bank, bearings, strict=True):
        asked = abs(V * math.cos(math.radians(bearing)) - closing)  # of drift, so that the range rate fits
        assert asked > 0.3 * V or h.log_weight > most - 1.0
        assert asked < 0.8 * V or h.log_weight < most - 1.0


def test_the_first_ring_knows_nothing():
    bank = drift.begin(PAR)
    drift.observe(bank, Memory(), MOVED, Reading(200.0, NAN, 1.0), PAR)
    assert [h.log_weight for h in bank] == [0.0] * drift.RING
    assert all(h.wx == h.wy == 0.0 for h in bank)
