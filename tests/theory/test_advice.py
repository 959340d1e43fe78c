"""What `check` advises beside the gain: slant ranges, old ranges, and vehicles that drift."""

import json
import re
from dataclasses import replace
from math import hypot

import pytest

from circumnav_mav.check import findings
from circumnav_mav.config import Config
from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.guidance.estimators import ESTIMATORS, direct
from circumnav_mav.guidance.kernel import RESTARTED, EstimatorContext, Memory, Moved, Reading
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.slant import level
from circumnav_mav.guidance.verdict import LOSES_IN
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.study.aircraft import MOST_WIND_SHARE
from circumnav_mav.study.compare import row
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot


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
    ("band", "told"),
    [
        ({}, ""),
        ({"r_min_m": 60.0}, ""),
        ({"r_max_m": 120.0}, ""),
        ({"r_min_m": 60.0, "r_max_m": 120.0}, ""),
        ({"r_min_m": 68.0, "r_max_m": 120.0}, "raise orbit.r_max_m to 125 m"),
        ({"radius_m": 50.0, "r_max_m": 60.0}, "raise orbit.r_max_m to 66 m"),
    ],
)
def test_check_warns_of_a_band_too_narrow_to_turn_round_in(band, told):
    """12 m/s at 30 degrees of bank turn on 25.4 m; counted on are 0.9 of that turn rate: 56.5 m across. The reaction is
    0.2 s of lag and 0.94 s to build the turn up, the margin 3 x 0.3 m and a quarter of the way flown in it: 4.3 m.
    """
    orbit = {"radius_m": 80.0, "speed_m_s": 12.0} | band
    found = check(vehicle={"class": "px4_fixed_wing"}, orbit=orbit, limits={"turn_accel_rad_s2": 0.5}).get("band")
    assert (found.text.split("; ")[1].split(",")[0] if found else "") == told
    assert found is None or (found.severity == "warning" and "56.5 m across" in found.text)


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
    for wind, severity in ((None, "warning"), (3.0, "warning"), (4.9, "warning"), (5.0, "error")):
        base = {"vehicle": {"class": kind}, "orbit": orbit, "study": {"wind_m_s": wind}}
        found = check(**base, law=hashemi)
        assert "law" not in check(**base, law={"name": "tangent"}, estimator={"name": "drift"})
        if drifts:
            assert found["law"].severity == severity and "in wind above 0.2 of the speed" in found["law"].text
        elif wind in (None, 3.0):
            assert "law" not in found
        else:  # of the target, say: wind is held against
            assert found["law"].severity == "warning"
            assert "speed of the target: law hashemi2013 loses flights" in found["law"].text
            assert "if it is wind, the autopilot holds" in found["law"].text


@pytest.mark.parametrize(
    ("kind", "share", "severity"),
    [
        ("px4_fixed_wing", MOST_WIND_SHARE, None),
        ("px4_fixed_wing", MOST_WIND_SHARE + 0.01, "warning"),
        ("px4_fixed_wing", 0.96, "error"),
        ("px4_multirotor_attitude", 0.33, None),
        ("px4_multirotor_attitude", 0.35, "warning"),
        ("px4_multirotor_attitude", 0.96, "error"),
        ("px4_multirotor", MOST_WIND_SHARE, None),
        ("px4_multirotor", MOST_WIND_SHARE + 0.01, "warning"),
        ("px4_multirotor", 2.0, "warning"),
    ],
)
def test_check_says_where_tangent_loses_the_target_too(kind, share, severity):
    """`tune` refuses the same wind: MOST_WIND_SHARE is its bound."""
    orbit, limits = {"radius_m": 300.0, "speed_m_s": 12.0}, {"bank_deg": 30.0}
    pair = {"law": {"name": "tangent"}, "estimator": {"name": "drift"}}
    found = check(vehicle={"class": kind}, orbit=orbit, limits=limits, study={"wind_m_s": share * 12.0}, **pair)
    assert (found["law"].severity if "law" in found else None) == severity


def test_check_names_no_cure_where_there_is_none():
    """tangent on drift, too, has its end, at 0.8 of the speed."""
    for kind, wind_m_s, cured in (
        ("px4_multirotor", 2.0, True),
        ("px4_multirotor", 40.0, False),
        ("arduplane", 4.5, False),
    ):
        base = {"vehicle": {"class": kind}, "orbit": {"radius_m": 100.0, "speed_m_s": 5.0}}
        told = check(**base, study={"wind_m_s": wind_m_s}, law={"name": "hashemi2013"}, estimator={"name": "direct"})
        assert ("law tangent on estimator drift does not" in told["law"].text) is cured
        assert ("bears 4 m/s, and no more" in told["law"].text) is not cured


@pytest.mark.soak  # both pairs are compiled
def test_the_default_multirotor_does_lose_a_target_that_moves_and_tangent_does_not():
    """What the warning says, flown: a target at 0.4 of the speed, and one at 0.2."""
    pairs = (("hashemi2013", "direct"), ("tangent", "drift"))
    scenario = replace(
        SCENARIOS["R_calm"], V_m_s=5.0, r_a_m=50.0, sigma_r_m=0.3, lag_s=0.45, limit_rad_s=0.8, start_m=(75.0, 300.0)
    )
    lost = {
        (law, share): row(replace(scenario, target_m_s=5.0 * share), Pilot(law, on), 30, seed=1).lost
        for law, on in pairs
        for share in (LOSES_IN, 2.0 * LOSES_IN)
    }
    assert lost["hashemi2013", 2.0 * LOSES_IN] > 0.1
    assert lost["hashemi2013", LOSES_IN] == lost["tangent", LOSES_IN] == lost["tangent", 2.0 * LOSES_IN] == 0.0


def test_check_takes_a_circle_that_the_wind_makes_impossible_as_an_error():
    plane = {"vehicle": {"class": "px4_fixed_wing"}, "orbit": {"radius_m": 60.0, "speed_m_s": 15.0}}
    plane |= {"limits": {"bank_deg": 30.0}}
    assert check(**plane, study={"wind_m_s": 3.0})["bank"].severity == "info"  # (15 + 3)^2 / (g tan 30 deg) = 57.2 m
    found = check(**plane, study={"wind_m_s": 4.0})["bank"]  # 63.76 m
    assert found.severity == "error" and "holds no circle below 63.76 m downwind" in found.text


def test_check_says_which_hand_overs_a_class_without_a_position_cannot_have():
    alone = {"vehicle": {"class": "px4_multirotor_attitude", "pitch_deg": -4.4}}
    asked = {"on_range_lost": "hold", "safety": {"on_battery_low": "return", "on_band_broken": "fly_on"}}

    def told(**sections):
        return [f.text for f in findings(Config.model_validate(sections)) if f.topic == "hand_over"]

    assert told(**alone) == []
    assert told(vehicle={"class": "px4_multirotor"}, **asked) == []
    texts = told(**alone, **asked)
    assert [text.split(":")[0] for text in texts] == ["on_range_lost", "safety.on_battery_low"]
    assert all("needs a position" in text for text in texts)


HOSTILE = (1e-300, 1e-6, 1e9, 1e300)
NUMBERS = {
    "orbit": ("radius_m", "speed_m_s", "height_m", "r_min_m", "r_max_m"),
    "limits": ("turn_rate_rad_s", "turn_accel_rad_s2"),
    "study": ("wind_m_s", "range_rate_hz", "turn_lag_s"),
    "ranging": ("sigma_m", "max_age_s", "latency_s", "target_height_m"),
}


@pytest.mark.parametrize("kind", ["px4_fixed_wing"])
@pytest.mark.parametrize("law", LAWS)
def test_no_number_that_a_file_can_hold_is_more_than_check_can_bear(kind, law):
    """Each number of a file in turn, at sizes that end floating-point arithmetic: a fault in words, or findings."""
    estimator = "drift" if law == "tangent" else "direct"
    numbers = NUMBERS | {"law": LAWS[law].options, "estimator": ESTIMATORS[estimator].options}
    base = {"vehicle": {"class": kind}, "law": {"name": law}, "estimator": {"name": estimator}}
    for section, keys in numbers.items():
        for key in keys:
            for value in HOSTILE:
                text = json.dumps(base | {section: base.get(section, {}) | {key: value}})
                try:
                    config = parse(text)
                except ConfigError as error:
                    assert value not in (1e-300, 1e300) or any(key in fault.path for fault in error.faults)
                    continue
                assert 1e-6 <= value <= 1e9
                assert not [f.text for f in findings(config) if " nan " in f.text]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "estimator: {name: direct, accel_m_s2: 1.0e-300}",
            "estimator.accel_m_s2: must be 0, or between 1e-06 and 1e+09",
        ),
        ("orbit: {radius_m: 1.0e+300}", "orbit.radius_m: must be 0, or between"),
        ("orbit: {radius_m: 1.0e+6}", "orbit.radius_m: input should be less than or equal to 100000"),
        ("orbit: {speed_m_s: 2000}", "orbit.speed_m_s: input should be less than or equal to 1000"),
        ("law: {kappa: 1.0e+308}", "law.kappa: must be 0, or between"),
        ("law: {name: pd_bias, damping: 1.0e-200}", "law.damping: must be 0, or between"),
        ("law: tangent", "law: write {name: tangent}"),
        ("estimator: polar", "estimator: write {name: polar}"),
    ],
)
def test_a_value_that_is_none_for_a_flight_is_a_fault_in_words(text, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        parse(text)


def test_a_law_that_is_all_jump_is_an_error_not_a_crash():
    """So short a run-in leaves no slope: the command is at its limit a hair beside the circle."""
    found = check(vehicle={"class": "px4_fixed_wing"}, law={"name": "tangent", "reach_s": 1e-6})["lag"]
    assert found.severity == "error"


RAW = {"estimator": {"name": "raw"}, "orbit": {"radius_m": 50.0, "speed_m_s": 5.0}, "law": {"name": "hashemi2013"}}


def test_check_reckons_with_the_rate_of_ranges_that_the_file_gives():
    """kappa 3 at 50 m and 5 m/s: k V T = 1 at T = 3.3 s, and held ranges 2 s apart count 2 s (no rate is measured)."""
    fast = check(**RAW, study={"range_rate_hz": 20.0}, ranging={"max_age_s": 4.0})["range_rate"]
    slow = check(**RAW, study={"range_rate_hz": 0.25}, ranging={"max_age_s": 4.0})["range_rate"]
    none = check(**RAW, ranging={"max_age_s": 4.0})["range_rate"]
    assert fast.severity == "info" and "0.05 s apart (study.range_rate_hz)" in fast.text
    assert slow.severity == "warning" and "4 s apart (study.range_rate_hz)" in slow.text
    assert none.severity == "warning" and "4 s apart (ranging.max_age_s)" in none.text
    direct = check(**RAW | {"estimator": {"name": "direct"}}, study={"range_rate_hz": 20.0})["range_rate"]
    assert "one in 0.05 s" in direct.text


def test_check_warns_of_ranges_that_are_stale_before_the_next():
    assert "seldom" not in check(study={"range_rate_hz": 1.0})
    found = check(study={"range_rate_hz": 0.8}, law={"name": "tangent"}, estimator={"name": "drift"})["seldom"]
    assert found.severity == "warning" and "one range in 1.25 s (study.range_rate_hz)" in found.text
    assert "seldom" not in check(study={"range_rate_hz": 0.8}, ranging={"max_age_s": 1.5})


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 10.0])
def test_check_warns_where_the_range_is_lost_before_a_jump_is_believed(rate_hz):
    needed_s = readings_until_believed(1.0 / rate_hz) / rate_hz
    section = {"study": {"range_rate_hz": rate_hz}, "estimator": {"name": "direct"}}
    found = check(**section, ranging={"coast_s": 0.9 * needed_s, "max_age_s": 0.5 * needed_s})["jumps"]
    assert found.severity == "warning" and f"({needed_s:.3g} s with {rate_hz:g} ranges a second)" in found.text
    assert "jumps" not in check(**section, ranging={"coast_s": needed_s, "max_age_s": 0.5 * needed_s})


def readings_until_believed(period_s: float) -> int:
    """Stand still beside a beacon, then beside one 200 m farther off; return how many of its ranges it takes."""
    par = direct.parameters({}, EstimatorContext(r_a=50.0, V=5.0, turn_rate_limit=0.5))
    bank, mem, moved = direct.begin(par), Memory(), Moved(period_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(200):
        mem = direct.observe(bank, mem, moved, Reading(50.0), par)
    for count in range(1, 200):
        mem = direct.observe(bank, mem, moved, Reading(250.0), par)
        if mem.verdict == RESTARTED:
            return count
    raise AssertionError("never believed")
