"""What `circumnav check` says of a gain: one row a case, hand-made so that one thing is wrong in each."""

from dataclasses import replace
from math import nan, radians

import pytest

from circumnav_mav.guidance.verdict import Flight, report, report_plain, verdict

QUAD = Flight(r_a=50.0, kappa=3.0, V=5.0, turn_rate_limit=1.5, lag_s=0.2, update_s=0.02, wind=1.0)
PLANE = Flight(r_a=80.0, kappa=1.2, V=15.0, turn_rate_limit=0.46, bank_limit=radians(35), lag_s=0.5, update_s=0.05)

ROWS = [
    ("nothing wrong", QUAD, set()),
    ("the orbit turns faster than the vehicle", replace(QUAD, r_a=3.0, lag_s=0.01), {("error", "turn_rate")}),
    ("2 k V above the limit", replace(QUAD, kappa=8.0, lag_s=0.1), {("warning", "saturation")}),
    ("lag is felt", replace(QUAD, lag_s=1.3), {("warning", "lag")}),
    ("lag is too much", replace(QUAD, lag_s=2.5), {("error", "lag")}),
    ("held too long", replace(QUAD, kappa=7.0, lag_s=0.0, update_s=2.4), {("error", "lag"), ("warning", "spin")}),
    ("wind as fast as the vehicle", replace(QUAD, wind=5.0), {("error", "wind")}),
    ("wind moves the circle", replace(QUAD, kappa=1.0, wind=1.0), {("warning", "wind")}),
    ("a speed held over the ground", replace(QUAD, kappa=1.0, wind=1.0, over_ground=True), set()),
    ("and a wind that it can hardly hold it against", replace(QUAD, wind=5.0, over_ground=True), {("warning", "wind")}),
    ("a plane with room", PLANE, set()),
    ("a plane without", replace(PLANE, r_a=30.0, turn_rate_limit=0.6), {("error", "bank"), ("warning", "saturation")}),
    ("a plane without, downwind", replace(PLANE, wind=9.0, kappa=2.0), {("error", "bank"), ("warning", "saturation"),
                                                                        ("warning", "wind")}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "flight", "wrong"), ROWS, ids=[row[0] for row in ROWS])
def test_each_fault_is_named_and_nothing_else(name, flight, wrong):
    findings = report(flight)
    assert {(f.severity, f.topic) for f in findings if f.severity != "info"} == wrong
    assert [f.severity for f in findings] == sorted(
        (f.severity for f in findings), key=["error", "warning", "info"].index
    )
    sentence = verdict(findings)
    if any(severity == "error" for severity, _ in wrong):
        assert "not hold" in sentence
    else:
        assert ("suits" in sentence) is (not wrong)


def test_wind_is_told_for_any_law():
    def told(flight):
        (finding,) = [f for f in report_plain(flight) if f.topic == "wind"]
        return finding.severity, finding.text

    assert told(QUAD)[0] == "info" and "4 to 6 m/s over the ground" in told(QUAD)[1]
    assert told(replace(QUAD, wind=5.0))[0] == "error"
    held = told(replace(QUAD, wind=4.0, over_ground=True))
    assert held[0] == "info" and "moves nothing here, if" in held[1] and "9 m/s through the air" in held[1]
    assert told(replace(QUAD, wind=40.0, over_ground=True))[0] == "warning"
    assert not [f for f in report_plain(replace(QUAD, wind=nan)) if f.topic == "wind"]


def test_the_wind_that_the_circle_bears_is_told_for_any_law():
    """A bank of 30 deg at 12 m/s: the circle of 27 m bears sqrt(27 g tan 30) - 12 = 0.36 m/s, that of 40 m 3.05."""

    def told(flight):
        found = [[f for f in reported if f.topic == "bank"] for reported in (report(flight), report_plain(flight))]
        assert found[0] == found[1]
        return found[0][0].severity, found[0][0].text

    small = Flight(r_a=27.0, kappa=3.0, V=12.0, turn_rate_limit=0.8, bank_limit=radians(30), lag_s=0.2)
    assert told(small)[0] == "warning"
    assert "wind up to 0.364 m/s" in told(small)[1] and "fly 36.62 m or wider" in told(small)[1]  # 1.2^2 144 / 5.662
    assert told(replace(small, wind=0.3))[0] == "info"
    assert told(replace(small, wind=0.4))[0] == "error"
    assert told(replace(small, r_a=40.0)) == (
        "info",
        "a bank of 30 deg at 12 m/s holds this circle in wind up to 3.05 m/s",
    )
    assert "any wind" in told(replace(small, r_a=200.0))[1]
    plain = replace(small, bank_limit=nan, turn_rate_limit=0.4)  # sqrt(0.4 * 12 * 40) - 12 = 1.86
    assert told(replace(plain, r_a=40.0))[0] == "warning" and "wind up to 1.86 m/s" in told(replace(plain, r_a=40.0))[1]
    assert "a turn rate of 0.4 rad/s" in told(replace(plain, r_a=40.0, wind=2.0))[1]
    held = replace(plain, r_a=40.0, over_ground=True)
    assert [f for f in report(held) if f.topic == "bank"] == []


def test_the_least_turn_radius_is_told_saturated_or_not():
    saturated = next(f for f in report(replace(QUAD, kappa=8.0, lag_s=0.1)) if f.topic == "saturation")
    assert "turn on V / limit = 3.333 m" in saturated.text  # 5 m/s at 1.5 rad/s; 2 k V is 1.6
    free = next(f for f in report(QUAD) if f.topic == "turn_rate")
    assert "a turn on 8.333 m" in free.text  # r_a / (2 kappa)


def test_unknown_things_are_left_out_and_a_gain_below_one_is_refused():
    assert {f.topic for f in report(Flight(10.0, 4.0, 1.0))} == {"gain", "recurrence"}
    with pytest.raises(ValueError, match="kappa"):
        report(Flight(10.0, 0.9, 1.0))
