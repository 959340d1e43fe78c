"""Every law and estimator flies on the stub over MAVLink bytes, unasked: a new plug is in these tables by itself."""

from __future__ import annotations

import math
import os
import random

import pytest

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from tests.app.test_table import keep_the_rules
from tests.lockstep import Rig, airborne, config

SEED = int(os.environ.get("SOAK_SEED", "1"))
SWITCHING = {"sliding_mode", "cao2013_saturated"}
"""Laws that throw the turn rate from limit to limit: behind a vehicle's lag they weave about the circle by metres."""


def bound_m(law: str, estimator: str) -> float:
    return 4.0 if law in SWITCHING else 2.5 if estimator == "raw" else 0.6


def orbit(law: str, estimator: str, **world) -> Rig:
    rig = Rig(config(law={"name": law}, estimator={"name": estimator}), airborne(seed=21, **world)).engage()
    rig.run(180.0)
    return rig


@pytest.mark.parametrize("law", LAWS)
def test_every_law_flies(law):
    estimator = next(e for e in ("direct", "drift") if set(LAWS[law].needs) <= ESTIMATORS[e].gives | {"V"})
    rig = orbit(law, estimator, wind_east_m_s=2.0)
    assert rig.log.phases[-1] == "orbiting"
    assert rig.log.rms_m(80.0) < bound_m(law, estimator)
    keep_the_rules(rig)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_every_estimator_flies(estimator):
    rig = orbit("hashemi2013", estimator, bearing_rad=2.0, outlier_share=0.0)
    assert rig.log.phases[-1] == "orbiting"
    assert rig.log.rms_m(80.0) < bound_m("hashemi2013", estimator)
    keep_the_rules(rig)


@pytest.mark.parametrize("estimator", ["polar", "drift"])
@pytest.mark.parametrize("direction", ["clockwise", "anticlockwise"])
def test_the_target_is_put_on_the_map_where_it_is(estimator, direction):
    """The estimated place against the stub's own, within the uncertainty that is claimed; and on the wire."""
    app = config(estimator={"name": estimator}, orbit={"direction": direction})
    rig = Rig(app, airborne(seed=22, bearing_rad=-2.2)).engage()
    rig.run(120.0)
    tick, truth = rig.log.ticks[-1], rig.log.truth[-1]
    east, north = truth.beacon_east_m - truth.east_m, truth.beacon_north_m - truth.north_m
    error_m = math.hypot(tick.target_east_m - east, tick.target_north_m - north)
    assert error_m < max(3.0, 4.0 * tick.target_sigma_m)
    assert 0.0 < tick.target_sigma_m < 15.0
    messages = [m for t, m in rig.decoded(rig.now_s - 10.0) if m.get_type() == "ORBIT_EXECUTION_STATUS"]
    assert 8 <= len(messages) <= 11
    assert math.copysign(1, messages[-1].radius) == (1 if direction == "clockwise" else -1)
    lat, lon = tick.target_lat_deg, tick.target_lon_deg
    assert (messages[-1].x / 1e7, messages[-1].y / 1e7) == pytest.approx((lat, lon), abs=1e-4)
    # A degree of latitude is 60 nautical miles; the stub's home is where GLOBAL_POSITION_INT says that the vehicle is.
    ap = rig.flight.link.autopilot
    assert (lat - ap.lat_deg) * 60 * 1852 == pytest.approx(tick.target_north_m, abs=1.0)
    assert (lon - ap.lon_deg) * 60 * 1852 * math.cos(math.radians(lat)) == pytest.approx(tick.target_east_m, abs=1.0)


@pytest.mark.parametrize(("distance_m", "bearing_rad"), [(72.0, 0.6), (150.0, 2.6)])
def test_the_uncertainty_on_the_map_is_true_from_the_first_metre_on(distance_m, bearing_rad):
    """The start from hover, in which the vehicle gathers way and turns, included."""
    off = sigmas_off(distance_m, bearing_rad, seed=3)
    assert max(off) < 5.0
    assert rms(off) < 2.5


@pytest.mark.soak
def test_over_many_flights_the_uncertainty_on_the_map_is_that_of_the_error():
    rng = random.Random(SEED)
    flights = [sigmas_off(rng.uniform(60.0, 220.0), rng.uniform(-3.1, 3.1), seed) for seed in range(1, 21)]
    assert 0.5 < rms([rms(off) for off in flights]) < 1.5


def rms(values):
    return math.sqrt(sum(value * value for value in values) / len(values))


def sigmas_off(distance_m, bearing_rad, seed):
    """Return the error of the place in sigmas at every tick at which that is said to be known to a tenth of the range:
    from there on the field guide trusts it.
    """
    app = config(estimator={"name": "drift"}, law={"name": "tangent"})
    rig = Rig(app, airborne(distance_m=distance_m, bearing_rad=bearing_rad, seed=seed)).engage()
    rig.run(50.0)
    off = []
    for tick, truth in zip(rig.log.ticks, rig.log.truth, strict=True):
        if tick.target_sigma_m < 0.1 * distance_m:
            east, north = truth.beacon_east_m - truth.east_m, truth.beacon_north_m - truth.north_m
            off.append(math.hypot(tick.target_east_m - east, tick.target_north_m - north) / tick.target_sigma_m)
    assert len(off) > 20 * 50
    return off


@pytest.mark.parametrize(("estimator", "moves"), [("polar", 0.0), ("drift", 1.0)])
def test_the_target_with_its_uncertainty_and_drift_is_on_the_wire_for_ground_stations(estimator, moves):
    """Read with pymavlink itself. In still air the drift is the beacon's velocity with the sign turned."""
    app = config(estimator={"name": estimator})
    world = {"beacon_east_m_s": 0.6 * moves, "beacon_north_m_s": -0.3 * moves}
    rig = Rig(app, airborne(seed=5, distance_m=100.0, **world)).engage()
    rig.run(60.0)
    last_s = rig.now_s - 10.0
    vectors = [(t, m) for t, m in rig.decoded(last_s) if m.get_type() == "DEBUG_VECT"]
    assert 9 <= len(vectors) <= 11, "once a second"
    truth = {round(tick.t_s, 3): t for tick, t in zip(rig.log.ticks, rig.log.truth, strict=True)}
    for t, m in vectors:
        true = truth[round(t, 3)]
        assert m.name == "TARGET"
        error_m = math.hypot(m.x - (true.beacon_north_m - true.north_m), m.y - (true.beacon_east_m - true.east_m))
        assert error_m < max(3.0, 4.0 * m.z)
        assert 0.0 < m.z < 15.0
    arrays = [m for t, m in rig.decoded(last_s) if m.get_type() == "DEBUG_FLOAT_ARRAY"]
    assert len(arrays) == (len(vectors) if estimator == "drift" else 0)
    for m in arrays:
        north, east, sigma = m.data[:3]
        assert m.name == "DRIFT"
        assert math.hypot(north - 0.3, east + 0.6) < max(0.3, 4.0 * sigma)
        assert 0.0 < sigma < 1.0
        assert not any(m.data[3:])


@pytest.mark.parametrize("estimator", ["polar", "drift"])
def test_before_the_first_turn_the_map_does_not_claim_to_know(estimator):
    """A vehicle that hovers has seen one circle of ranges: the target may be anywhere on it."""
    rig = Rig(config(estimator={"name": estimator}), airborne(seed=5))
    rig.run(4.0)
    shown = [m for _, m in rig.decoded() if m.get_type() == "DEBUG_VECT"]
    assert all(m.z > 50.0 for m in shown), shown


def test_the_place_of_the_target_gets_vaguer_without_ranges_and_is_not_sent_after_a_release():
    app = config(estimator={"name": "drift"}, law={"name": "tangent"})
    rig = Rig(app, airborne(seed=5, distance_m=80.0, range_dropouts_s=((50.0, 99.0),))).engage()
    rig.run(62.0 - rig.now_s)
    before = max((t for t in rig.log.ticks if t.t_s <= 49.5), key=lambda t: t.t_s)
    after = rig.log.ticks[-1]
    assert after.phase == "coasting"
    blur_m = before.drift_sigma_m_s * (62.0 - 50.0)
    assert after.target_sigma_m == pytest.approx(math.hypot(before.target_sigma_m, blur_m), rel=0.3)
    assert after.target_sigma_m > 1.2 * before.target_sigma_m
    rig.pilot.mode(0x03040000)
    rig.run(3.0)
    assert rig.log.phases[-1] == "released"
    assert not [m for _, m in rig.decoded(rig.now_s - 2.0) if m.get_type().startswith(("DEBUG", "ORBIT"))]


def test_a_range_filter_alone_puts_nothing_on_the_map():
    rig = orbit("hashemi2013", "direct")
    assert math.isnan(rig.log.ticks[-1].target_east_m)
    assert math.isnan(rig.log.ticks[-1].target_sigma_m)
    assert math.isnan(rig.log.ticks[-1].target_lat_deg)
    assert not [m for _, m in rig.decoded(rig.now_s - 5.0) if m.get_type() == "DEBUG_VECT"]
    assert not [m for _, m in rig.decoded(rig.now_s - 5.0) if m.get_type() == "ORBIT_EXECUTION_STATUS"]
