"""DISTANCE_SENSOR, from real MAVLink frames to samples: whose it is, what its fields mean, what is turned away."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.ranging import MessageReceiver, Settings, open_receiver
from circumnav_mav.types import RangeSample, Rejected

COMPANION = (1, 158)


def frame(**changes):
    """A decoded DISTANCE_SENSOR that has been through the wire; 12.34 m, sigma 4 cm, quality 77."""
    fields = {
        "time_boot_ms": 0,
        "min_distance": 20,
        "max_distance": 4000,
        "current_distance": 1234,
        "type": 0,
        "id": 5,
        "orientation": 0,
        "covariance": 16,
        "signal_quality": 77,
    } | changes
    sent = mavlink.MAVLink_distance_sensor_message(**fields)
    packed = sent.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=158))
    return mavlink.MAVLink(None).decode(bytearray(packed))


def receiver(**settings) -> MessageReceiver:
    opened = open_receiver("distance_sensor", Settings(**settings))
    assert isinstance(opened, MessageReceiver)
    opened.moving = True
    return opened


def reason(result) -> str:
    assert isinstance(result, Rejected), result
    return str(result.reason)


def test_centimetres_become_metres_and_variance_a_standard_deviation():
    sample = receiver().on_message(*COMPANION, frame(), 7.0)
    assert isinstance(sample, RangeSample)
    assert sample.range_m == pytest.approx(12.34, abs=1e-9)
    assert sample.sigma_m == pytest.approx(0.04, abs=1e-9)
    assert sample.t_s == 7.0
    assert math.isnan(sample.range_rate_m_s)


@pytest.mark.parametrize("covariance", [0, 255])
def test_an_unknown_variance_is_nan(covariance):
    sample = receiver().on_message(*COMPANION, frame(covariance=covariance), 7.0)
    assert isinstance(sample, RangeSample)
    assert math.isnan(sample.sigma_m)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"current_distance": 0}, "no_reading"),
        ({"current_distance": 65535, "max_distance": 65535}, "no_reading"),
        ({"current_distance": 19}, "out_of_range"),
        ({"current_distance": 4001}, "out_of_range"),
        ({"signal_quality": 1}, "invalid_quality"),
        ({"orientation": 25}, "decoy_orientation"),
    ],
)
def test_turned_away(changes, expected):
    assert reason(receiver().on_message(*COMPANION, frame(**changes), 7.0)) == expected


@pytest.mark.parametrize(
    "changes",
    [
        {"current_distance": 20},
        {"current_distance": 4000},
        {"signal_quality": 0},
        {"signal_quality": 100},
        {"max_distance": 0, "current_distance": 65534},
        {"orientation": 100},
    ],
)
def test_let_through(changes):
    assert isinstance(receiver().on_message(*COMPANION, frame(**changes), 7.0), RangeSample)


@pytest.mark.parametrize("told", [None, (1, 1), (7, 1)])
def test_an_autopilots_own_stream_and_its_echo_are_never_flown_on(told):
    ranging = receiver()
    ranging.autopilot = told
    for echo in (frame(id=1, covariance=9, signal_quality=76, min_distance=19), frame(id=0, orientation=25)):
        assert reason(ranging.on_message(1, 1, echo, 7.0)) == "wrong_source"
    assert isinstance(ranging.on_message(*COMPANION, frame(), 7.0), RangeSample)


def test_where_the_configuration_names_the_autopilot_its_ranges_count_and_nothing_else():
    ranging = receiver(from_=(1, 1))
    ranging.autopilot = (1, 1)
    assert reason(ranging.on_message(*COMPANION, frame(), 6.9)) == "wrong_source"
    assert reason(ranging.on_message(1, 1, frame(id=0, orientation=25), 6.9)) == "decoy_orientation"
    assert isinstance(ranging.on_message(1, 1, frame(id=1), 7.0), RangeSample)
    assert reason(ranging.on_message(1, 1, frame(id=2), 7.0)) == "wrong_sensor"


def test_the_configured_sender_sensor_and_orientation_only():
    ranging = receiver(from_=COMPANION, sensor_id=5, orientation=0)
    assert reason(ranging.on_message(1, 159, frame(), 7.0)) == "wrong_source"
    assert reason(ranging.on_message(2, 158, frame(), 7.0)) == "wrong_source"
    assert reason(ranging.on_message(*COMPANION, frame(id=6), 7.0)) == "wrong_sensor"
    assert reason(ranging.on_message(*COMPANION, frame(orientation=2), 7.0)) == "decoy_orientation"
    assert isinstance(ranging.on_message(*COMPANION, frame(), 7.0), RangeSample)
    assert ranging.counts.accepted == 1
    assert ranging.counts.rejected == {"wrong_source": 2, "wrong_sensor": 1, "decoy_orientation": 1}


def test_left_open_the_first_accepted_sender_and_sensor_are_kept():
    ranging = receiver()
    assert reason(ranging.on_message(1, 160, frame(signal_quality=1), 7.0)) == "invalid_quality"
    assert isinstance(ranging.on_message(*COMPANION, frame(), 7.1), RangeSample)
    assert reason(ranging.on_message(1, 160, frame(), 7.2)) == "wrong_source"
    assert reason(ranging.on_message(*COMPANION, frame(id=6), 7.3)) == "wrong_sensor"
    assert "ranging.sensor_id" in ranging.counts.last_detail["wrong_sensor"]


def test_the_bias_is_taken_off_and_the_configured_limits_see_the_true_range():
    ranging = receiver(bias_m=12.0, min_m=0.3, max_m=1.0)
    sample = ranging.on_message(*COMPANION, frame(), 7.0)
    assert isinstance(sample, RangeSample)
    assert sample.range_m == pytest.approx(0.34, abs=1e-9)
    assert reason(ranging.on_message(*COMPANION, frame(current_distance=1229), 7.1)) == "out_of_range"
    assert reason(ranging.on_message(*COMPANION, frame(current_distance=1301), 7.2)) == "out_of_range"
    assert reason(receiver(bias_m=12.34).on_message(*COMPANION, frame(), 7.0)) == "out_of_range"


def test_a_fixed_latency_dates_the_sample_back():
    sample = receiver(latency_s=0.15).on_message(*COMPANION, frame(), 7.0)
    assert isinstance(sample, RangeSample)
    assert sample.t_s == pytest.approx(6.85)


def test_a_delayed_message_is_dated_by_its_stamp_and_too_old_a_one_is_stale():
    ranging = receiver(max_age_s=1.0)
    sent_ms, delays_s = [1000, 1100, 1200, 1300], [0.02, 0.32, 0.9, 1.5]
    results = [
        ranging.on_message(*COMPANION, frame(time_boot_ms=ms), 50.0 + ms * 1e-3 + delay_s)
        for ms, delay_s in zip(sent_ms, delays_s, strict=True)
    ]
    # The first delay, 0.02 s, is the shortest seen: it cannot be told from the offset of the clocks.
    assert [round(r.t_s, 6) for r in results[:3] if isinstance(r, RangeSample)] == [51.02, 51.12, 51.22]
    assert reason(results[3]) == "stale"


def test_the_same_message_twice_counts_once_and_an_older_one_does_not():
    ranging = receiver()
    assert isinstance(ranging.on_message(*COMPANION, frame(time_boot_ms=1000), 7.0), RangeSample)
    assert isinstance(ranging.on_message(*COMPANION, frame(time_boot_ms=1100), 7.1), RangeSample)
    assert reason(ranging.on_message(*COMPANION, frame(time_boot_ms=1100), 7.15)) == "duplicate"
    assert reason(ranging.on_message(*COMPANION, frame(time_boot_ms=1000), 7.2)) == "time_backwards"


def test_a_sender_that_reboots_is_believed_again():
    ranging = receiver()
    ranging.moving = False
    for n in range(50):
        assert isinstance(
            ranging.on_message(*COMPANION, frame(time_boot_ms=90_000 + 100 * n), 7 + 0.1 * n), RangeSample
        )
    after = [ranging.on_message(*COMPANION, frame(time_boot_ms=500 + 100 * n), 20 + 0.1 * n) for n in range(10)]
    accepted = [r for r in after if isinstance(r, RangeSample)]
    assert [r.t_s for r in accepted] == pytest.approx([20 + 0.1 * n for n in range(10 - len(accepted), 10)])
    assert len(accepted) >= 8


def test_the_same_centimetres_for_three_seconds_of_flight_are_a_fault_without_asking():
    ranging = receiver()
    for n in range(50):
        assert isinstance(ranging.on_message(*COMPANION, frame(current_distance=1000 + n), 2.0 + 0.1 * n), RangeSample)
    results = [ranging.on_message(*COMPANION, frame(), 7.0 + 0.1 * n) for n in range(40)]
    assert [isinstance(r, RangeSample) for r in results] == [True] * 31 + [False] * 9
    assert reason(results[-1]) == "stuck"


def test_the_same_centimetres_for_long_are_no_fault_where_stuck_s_is_0():
    ranging = receiver(stuck_s=0.0)
    for n in range(700):
        assert isinstance(ranging.on_message(*COMPANION, frame(), 7.0 + 0.1 * n), RangeSample)


def test_a_stuck_range_is_found_where_it_is_asked_for_and_only_while_moving():
    ranging = receiver(stuck_s=2.0)
    results = [ranging.on_message(*COMPANION, frame(), 7.0 + 0.1 * n) for n in range(30)]
    assert [isinstance(r, RangeSample) for r in results] == [True] * 21 + [False] * 9
    assert reason(results[-1]) == "stuck"
    assert isinstance(ranging.on_message(*COMPANION, frame(current_distance=1235), 10.1), RangeSample)
    ranging.moving = False
    for n in range(60):
        result = ranging.on_message(*COMPANION, frame(current_distance=1235), 10.2 + 0.1 * n)
        assert isinstance(result, RangeSample)


def test_an_unknown_source_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'sonar'.*distance_sensor"):
        open_receiver("sonar", Settings())


def test_what_another_sender_said_first_does_not_colour_our_clock():
    ranging = receiver()
    ranging.on_message(1, 160, frame(time_boot_ms=900_000, signal_quality=1), 7.0)
    for n in range(5):
        sample = ranging.on_message(*COMPANION, frame(time_boot_ms=1000 + 100 * n), 7.1 + 0.1 * n)
        assert isinstance(sample, RangeSample)
        assert sample.t_s == pytest.approx(7.1 + 0.1 * n)


PX4_DOWNWARD = "fd0d0000aa05018400002873000000001027fe010000199d8b"
"""PX4 v1.16.0 (SIH, system 5) about its own range finder, 5.10 m above ground, as recorded on its companion link."""


def test_a_recorded_height_above_ground_is_a_decoy_whoever_forwards_it():
    recorded = mavlink.MAVLink(None).decode(bytearray.fromhex(PX4_DOWNWARD))
    assert recorded.current_distance == 510
    assert reason(receiver().on_message(5, 1, recorded, 30.0)) == "wrong_source"
    assert reason(receiver().on_message(5, 158, recorded, 30.0)) == "decoy_orientation"
    assert reason(receiver(from_=[5, 158]).on_message(5, 158, recorded, 30.0)) == "decoy_orientation"


def test_a_stamp_that_never_changes_is_none():
    """A sender that fills in any number: after a few ranges they are flown on as they come."""
    ranging = receiver()
    results = [
        ranging.on_message(*COMPANION, frame(time_boot_ms=123, current_distance=1000 + n), 7.0 + 0.1 * n)
        for n in range(40)
    ]
    used = [isinstance(result, RangeSample) for result in results]
    assert all(used[5:])
    assert [result.t_s for result in results[5:]] == pytest.approx([7.0 + 0.1 * n for n in range(5, 40)])


def test_one_range_sent_again_and_again_with_its_stamp_stays_one_range():
    ranging = receiver()
    results = [ranging.on_message(*COMPANION, frame(time_boot_ms=123), 7.0 + 0.1 * n) for n in range(10)]
    assert isinstance(results[0], RangeSample)
    assert {reason(result) for result in results[1:]} == {"duplicate"}
