"""The notice that ranges are noisier than configured: never of ranges as configured, always of three times that."""

from __future__ import annotations

import os

import pytest

from circumnav_mav.config import parse
from tests.lockstep import Rig, airborne

SHARE = float(os.environ.get("SOAK_SHARE", "1"))
SEED = int(os.environ.get("SOAK_SEED", "1"))

CLASSES = {
    "multirotor": ("orbit: {radius_m: 50}", 0.3, 200.0, 15.0, {}),
    "multirotor, slant": (
        "{orbit: {height_m: 40}, ranging: {target_height_m: 0}}",
        0.3,
        200.0,
        40.0,
        {"beacon_height_m": 0.0},
    ),
    "plane, slant": (
        "{vehicle: {class: px4_fixed_wing}, orbit: {height_m: 100}, ranging: {target_height_m: 0, sigma_m: 1.0}}",
        1.0,
        400.0,
        100.0,
        {"beacon_height_m": 0.0, "airframe": "fixed_wing"},
    ),
}
"""Configuration, its sigma [m], where the flight starts: distance and height [m], and what more the stub is told."""


def notices(kind: str, seed: int, times: float, for_s: float = 60.0) -> list[str]:
    """Fly 20 s in Hold and then, engaged, for so long; return what was said of noise."""
    text, sigma_m, distance_m, height_m, more = CLASSES[kind]
    world = airborne(distance_m, 0.7 * seed, height_m=height_m, seed=seed, range_sigma_m=times * sigma_m, **more)
    rig = Rig(parse(text), world)
    rig.run(20.0)
    rig.engage().run(for_s)
    return [event.text for event in rig.flight.events if "noisier" in event.text]


@pytest.mark.parametrize("kind", CLASSES)
def test_ranges_as_noisy_as_configured_are_not_called_noisier(kind):
    assert notices(kind, 3, 1.0, 60.0 if "plane" in kind else 10.0) == []


@pytest.mark.parametrize("kind", CLASSES)
def test_ranges_three_times_as_noisy_are_told_of_once(kind):
    (said,) = notices(kind, 2, 3.0, 10.0)
    sigma_m = CLASSES[kind][1]
    assert f"ranging.sigma_m = {sigma_m:g} m" in said
    assert float(said.split("about ")[1].split(" m")[0]) == pytest.approx(3.0 * sigma_m, rel=0.5)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(SEED, SEED + max(1, round(14 * SHARE))))
@pytest.mark.parametrize("kind", CLASSES)
def test_no_false_notice_in_many_flights(kind, seed):
    assert notices(kind, seed, 1.0) == []
