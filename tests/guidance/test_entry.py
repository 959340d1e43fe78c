"""Entries of the study that came nearer than a quarter of the radius while the bearing was not known yet."""

from __future__ import annotations

from dataclasses import replace

import pytest

from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot, fly_one


@pytest.mark.parametrize(("seed", "index"), [(5, 728), (10, 753)])
def test_an_entry_down_wind_whose_side_is_not_known_yet_keeps_a_quarter_of_the_radius(seed, index):
    """Each came to 17.2 m: it changed sides outside the circle, too late for the other turn, and back again."""
    scenario = replace(SCENARIOS["R_wind7"], duration_s=20.0)
    outcome, _ = fly_one(scenario, Pilot("tangent", "drift"), seed, index)
    assert outcome.least_range > 0.25 * scenario.r_a_m
