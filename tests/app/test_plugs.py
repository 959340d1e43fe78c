"""Every law and estimator flies on the stub over MAVLink bytes, unasked: a new plug is in these tables by itself."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from tests.app.test_table import keep_the_rules
from tests.lockstep import Rig, airborne, config

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
    lat, lon = rig.flight.target_place
    assert (messages[-1].x / 1e7, messages[-1].y / 1e7) == pytest.approx((lat, lon), abs=1e-4)


def test_a_range_filter_alone_puts_nothing_on_the_map():
    rig = orbit("hashemi2013", "direct")
    assert math.isnan(rig.log.ticks[-1].target_east_m)
    assert not [m for _, m in rig.decoded(rig.now_s - 5.0) if m.get_type() == "ORBIT_EXECUTION_STATUS"]
