"""What `check` advises beside the gain: slant ranges, old ranges, and vehicles that drift."""

from math import hypot

import pytest

from circumnav_mav.check import findings
from circumnav_mav.config import Config
from circumnav_mav.guidance.slant import level
from circumnav_mav.mavlink.vehicles import VEHICLES


def check(**sections):
    return {f.topic: f for f in findings(Config.model_validate(sections))}


def test_check_says_how_late_a_range_may_come():
    assert "age" not in check(ranging={"max_age_s": 2.0})
    found = check(ranging={"max_age_s": 3.0})["age"]
    assert found.severity == "warning"
    assert "more than 2 s late is not used" in found.text


def test_check_refuses_a_circle_within_the_cone_overhead():
    """At 100 m above the target the cone in which ranges are refused ends at 25.8 m: level() itself is the truth."""
    for height_m, target_m in ((100.0, 0.0), (5.0, 105.0)):
        for radius_m, refused in ((25.0, True), (27.0, False)):
            found = check(orbit={"radius_m": radius_m, "height_m": height_m}, ranging={"target_height_m": target_m})
            slant_m = hypot(radius_m, height_m - target_m)
            assert level(slant_m, 0.0, 0.3, height_m - target_m, 0.0, 0.0).overhead is refused
            assert ("slant" in found) is refused
            if refused:
                assert found["slant"].severity == "error" and "within 25.8 m" in found["slant"].text


@pytest.mark.parametrize(
    ("height_m", "severity", "flown"),
    [
        (14.0, "info", "at 14 m of height has a radius of 48.0 m instead of 50"),  # 14, 48, 50
        (30.0, "warning", "at 30 m of height has a radius of 40.0 m instead of 50"),  # 30, 40, 50
        (None, "info", "at 30 m of height, say, has a radius of 40.0 m instead of 50"),
        (50.0, "warning", "none is shorter than the height, 50 m, and the circle of 50 m is never reached"),
        (500.0, "warning", "none is shorter than the height, 500 m, and the circle of 50 m is never reached"),
    ],
)
def test_check_says_what_comes_of_ranges_that_are_taken_as_horizontal(height_m, severity, flown):
    found = check(orbit={"radius_m": 50.0, "height_m": height_m})["slant"]
    assert found.severity == severity
    assert flown in found.text and "set ranging.target_height_m" in found.text


def test_check_says_that_it_is_found_out_in_flight():
    for sections in (
        {"vehicle": {"class": "px4_fixed_wing"}, "orbit": {"height_m": 100.0}},
        {"ranging": {"target_height_m": "auto"}, "estimator": {"name": "drift"}},
    ):
        found = check(**sections)["slant"]
        assert found.severity == "info" and "until the flight shows whether they are" in found.text


@pytest.mark.parametrize("kind", VEHICLES)
def test_check_says_which_laws_lose_the_target_in_wind(kind):
    drifts = VEHICLES[kind].speed != "ground"
    orbit, hashemi = {"radius_m": 100.0, "speed_m_s": 15.0}, {"name": "hashemi2013"}
    for wind, severity in ((None, "warning"), (4.9, "warning"), (5.0, "error")):
        base = {"vehicle": {"class": kind}, "orbit": orbit, "study": {"wind_m_s": wind}}
        found = check(**base, law=hashemi)
        assert ("law" in found) is drifts
        if drifts:
            assert found["law"].severity == severity and "about a quarter of the speed" in found["law"].text
        assert "law" not in check(**base, law={"name": "tangent"})


def test_check_takes_a_circle_that_the_wind_makes_impossible_as_an_error():
    plane = {"vehicle": {"class": "px4_fixed_wing"}, "orbit": {"radius_m": 60.0, "speed_m_s": 15.0}}
    plane |= {"limits": {"bank_deg": 30.0}}
    assert "bank" not in check(**plane, study={"wind_m_s": 3.0})  # (15 + 3)^2 / (g tan 30 deg) = 57.2 m
    found = check(**plane, study={"wind_m_s": 4.0})["bank"]  # 63.76 m
    assert found.severity == "error" and "holds no circle below 63.76 m downwind" in found.text
