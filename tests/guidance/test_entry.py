"""Entries of the study that came nearer than a quarter of the radius while the bearing was not known yet."""

from __future__ import annotations

from dataclasses import replace

import pytest

from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot, fly_one

OURS = Pilot("tangent", "drift")
CAME_TO_M = {
    ("R_wind7", 5, 728): 17.2,  # it changed sides outside the circle, too late for the other turn, and back again
    ("R_wind7", 10, 753): 17.2,
    ("R_wind7", 227, 261): 7.9,  # the leader was another for half a second, at 90 m
    ("R_wind7", 336, 968): 2.0,
    ("R_wind7", 403, 45): 2.0,
    ("R_lag1", 71, 514): 13.8,
    ("R_lag1", 480, 597): 1.8,  # it lags by twice what is believed
    ("R_moving", 45, 582): 10.8,  # one turn throughout, in a drift of 9 m/s that most hypotheses missed
    ("R_moving", 263, 997): 6.6,
}


@pytest.mark.parametrize(("name", "seed", "index"), CAME_TO_M)
def test_an_entry_down_wind_whose_side_is_not_known_yet_keeps_half_of_the_radius(name, seed, index):
    """What they came to is how they were flown before the other hypotheses had a say: in all, a way out was there."""
    scenario = replace(SCENARIOS[name], duration_s=40.0)
    outcome, _ = fly_one(scenario, OURS, seed, index)
    assert outcome.least_range > 0.5 * scenario.r_a_m
    assert outcome.settle_s < 40.0
