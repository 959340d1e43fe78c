"""The offboard contract of PX4 v1.16, row by row: PX4.md, section 3."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.stub.rig import HOLD, OFFBOARD, Rig, first_time, flying

NAN = math.nan


# -- 3.1 two acknowledgements ------------------------------------------------------------------------------------


def test_3_1_a_refused_request_is_acked_0_then_1() -> None:
    rig = flying()
    assert rig.set_mode(OFFBOARD) == [0, 1]
    assert rig.mode == "AUTO/LOITER"


def test_3_1_an_accepted_request_is_acked_0_then_0() -> None:
    rig = flying()
    rig.send(rig.local())
    assert rig.set_mode(OFFBOARD) == [0, 0]
    assert rig.mode == "OFFBOARD"


def test_3_1_the_second_ack_comes_8_to_20_ms_later() -> None:
    rig = flying()
    rig.set_mode(OFFBOARD)
    times = [t for t, m in rig.heard if m.get_type() == "COMMAND_ACK"]
    assert 0.008 <= times[1] - times[0] <= 0.021


def test_3_1_command_int_does_the_same() -> None:
    rig = flying()
    rig.send(mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, 6, 0, 0, 0, 0, 0))
    rig.run(0.1)
    assert rig.acks(176) == [0, 1]


@pytest.mark.parametrize(("stream", "acks"), [(False, [1]), (True, [0])])
def test_3_1_set_mode_gives_one_truthful_ack(stream: bool, acks: list[int]) -> None:
    rig = flying()
    if stream:
        rig.send(rig.local())
    rig.send(mavlink.MAVLink_set_mode_message(1, 1, OFFBOARD))
    rig.run(0.1)
    assert rig.acks(176) == acks


def test_3_1_guided_enable_is_unsupported() -> None:
    assert flying().command(92, 1) == [3]


# -- 3.2 freshness -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gap_s", "accepted"), [(0.0, True), (0.02, True), (0.1, True), (0.5, True), (0.9, True), (1.5, False)]
)
def test_3_2_one_setpoint_is_enough_while_it_is_fresh(gap_s: float, accepted: bool) -> None:
    rig = flying()
    rig.send(rig.local())
    rig.run(gap_s)
    assert rig.set_mode(OFFBOARD) == [0, 0 if accepted else 1]


def test_3_2_a_request_before_the_first_setpoint_is_refused_and_not_retried() -> None:
    rig = flying()
    rig.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0))
    rig.streaming = lambda _: rig.local()
    rig.run(3.0)
    assert rig.acks(176) == [0, 1]
    assert rig.mode == "AUTO/LOITER"


def test_3_2_while_disarmed_offboard_needs_no_stream() -> None:
    rig = Rig()
    rig.run(2.0)
    assert rig.set_mode(OFFBOARD) == [0, 0]
    assert rig.mode == "OFFBOARD"


# -- 3.3 rates ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate_hz", "stays"), [(50, True), (10, True), (2, True), (1.2, True), (1.0, True)])
def test_3_3_slow_streams_hold_offboard(rate_hz: float, stays: bool) -> None:
    rig = flying()
    rig.stream_period_s = 1.0 / rate_hz
    rig.enter_offboard(lambda _: rig.local())
    rig.run(10.0)
    assert (first_time(rig, lambda: rig.mode != "OFFBOARD", 8.0) == math.inf) is stays


def test_3_3_a_stream_of_0_9_hz_drops_out_and_comes_back() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.gcs_heartbeat()
    rig.stream_period_s = 1.0 / 0.9
    rig.enter_offboard(lambda _: rig.local())
    modes = []
    for _ in range(400):
        rig.run(0.05)
        if rig.now_s % 1.0 < 0.05:
            rig.gcs_heartbeat()
        modes.append(rig.mode)
    assert {"OFFBOARD", "AUTO/LOITER"} == set(modes)
    assert rig.texts().count("Failsafe activated\t") >= 3
    assert modes.count("OFFBOARD") > 0.8 * len(modes)


# -- 3.4 the stream stops ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("loss_t", "expected_s"), [(1.0, 1.12), (0.25, 0.36)])
def test_3_4_offboard_ends_after_the_last_setpoint(loss_t: float, expected_s: float) -> None:
    rig = flying(params={"COM_OF_LOSS_T": loss_t, "COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.local(velocity=(3, 0, 0)))
    rig.run(2.0)
    rig.streaming = None
    rig.send(rig.local(velocity=(3, 0, 0)))
    assert first_time(rig, lambda: rig.mode != "OFFBOARD", 3.0) == pytest.approx(expected_s, abs=0.08)


def test_3_4_until_then_it_flies_on_with_the_last_setpoint() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.local(velocity=(3, 0, 0)))
    rig.run(5.0)
    rig.streaming = None
    rig.run(1.0)
    assert rig.stub.truth().speed_m_s == pytest.approx(3.0, abs=0.1)


ACTIONS = [  # COM_OBL_RC_ACT, mode, custom_mode, base_mode, system_status
    (0, "POSCTL", 0x00030000, 209, 5),
    (1, "ALTCTL", 0x00020000, 209, 5),
    (2, "STABILIZED", 0x00070000, 209, 5),
    (3, "AUTO/RTL", 0x05040000, 157, 5),
    (4, "AUTO/LAND", 0x06040000, 157, 5),
    (5, "AUTO/LOITER", 0x03040000, 157, 5),
    (6, "TERMINATION", 0x000A0000, 129, 8),
    (7, "OFFBOARD", 0x00060000, 17, 0),
]


@pytest.mark.parametrize(("action", "mode", "custom_mode", "base_mode", "status"), ACTIONS)
def test_3_4_COM_OBL_RC_ACT_leads_to(action: int, mode: str, custom_mode: int, base_mode: int, status: int) -> None:
    rig = flying(height_m=60.0, params={"COM_OBL_RC_ACT": action})
    rig.enter_offboard(lambda _: rig.local(velocity=(5, 0, 0)))
    rig.run(4.0)
    rig.streaming = None
    rig.run(2.4)
    beat = rig.all("HEARTBEAT")[-1]
    assert rig.mode == mode
    assert (beat.custom_mode, beat.base_mode, beat.system_status) == (custom_mode, base_mode, status)


@pytest.mark.parametrize(
    ("action", "sink_m_s"), [(0, (0.55, 1.0)), (1, (0.7, 0.8)), (2, (0.35, 0.45)), (4, (1.4, 1.7)), (5, (-0.05, 0.05))]
)
def test_3_4_how_it_sinks(action: int, sink_m_s: tuple[float, float]) -> None:
    rig = flying(height_m=60.0, params={"COM_OBL_RC_ACT": action})
    rig.enter_offboard(lambda _: rig.local())
    rig.run(2.0)
    rig.streaming = None
    rig.run(4.0)
    high = rig.stub.truth().height_m
    rig.run(10.0)
    assert sink_m_s[0] <= (high - rig.stub.truth().height_m) / 10.0 <= sink_m_s[1]


@pytest.mark.parametrize("action", [6, 7])
def test_3_4_terminated_or_disarmed_it_falls(action: int) -> None:
    rig = flying(params={"COM_OBL_RC_ACT": action})
    rig.enter_offboard(lambda _: rig.local())
    rig.streaming = None
    rig.run(6.0)
    assert rig.stub.truth().height_m == 0.0
    rig.streaming = lambda _: rig.local(velocity=(0, 0, -2))
    rig.set_mode(OFFBOARD)
    rig.run(3.0)
    assert rig.stub.truth().height_m == 0.0


def test_3_4_stickless_posctl_drifts_lands_disarms_and_says_offboard_again() -> None:
    rig = flying(height_m=15.0)
    rig.gcs_heartbeat()
    rig.enter_offboard(lambda _: rig.local(velocity=(5, 0, 0)))
    rig.run(4.0)
    rig.streaming = None
    rig.run(1.2)
    rig.run(4.0)
    assert rig.stub.truth().speed_m_s == pytest.approx(3.9, rel=0.2)
    for _ in range(30):
        rig.gcs_heartbeat()
        rig.run(1.0)
    assert "Disarmed by landing\t" in rig.texts()
    beat = rig.all("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.base_mode) == (OFFBOARD, 17)


@pytest.mark.parametrize(
    ("action", "words"), [(5, {"Failsafe activated\t"}), (7, {"Failsafe activated\t", "Disarmed by failsafe\t"})]
)
def test_3_4_the_loss_is_told_in_words_that_name_no_offboard(action: int, words: set[str]) -> None:
    """Severity 2, and only where a ground station was heard; the mode shows at the next HEARTBEAT."""
    deaf, rig = flying(params={"COM_OBL_RC_ACT": action}), flying(params={"COM_OBL_RC_ACT": action})
    for one in (deaf, rig):
        one.enter_offboard(lambda _, one=one: one.local())
        one.streaming = None
    rig.gcs_heartbeat()
    lost_s = first_time(rig, lambda: rig.mode != "OFFBOARD" or not rig.stub.truth().armed, 3.0)
    deaf.run(3.0)
    assert deaf.texts() == []
    rig.run(0.05)
    assert set(rig.texts()) <= words
    assert "Failsafe activated\t" in rig.texts() or action == 7
    assert all(m.severity in (2, 6) for m in rig.all("STATUSTEXT"))
    if action == 5:
        shown_s = first_time(rig, lambda: rig.all("HEARTBEAT")[-1].custom_mode != OFFBOARD, 2.0)
        assert lost_s + shown_s <= 1.15 + 1.1
    else:
        assert "Disarmed by failsafe\t" in rig.texts()


def test_3_4_return_climbs_first_and_says_so() -> None:
    rig = flying(height_m=15.0, params={"COM_OBL_RC_ACT": 3})
    rig.enter_offboard(lambda _: rig.local(velocity=(5, 0, 0)))
    rig.run(8.0)
    rig.gcs_heartbeat()
    rig.streaming = None
    rig.run(1.5)
    assert rig.mode == "AUTO/RTL"
    assert "".join(rig.texts()).split("\t")[-2].startswith("RTL: start return at 504 m (15 m above destination")
    far_m = rig.stub.truth().north_m
    first_time(rig, lambda: rig.stub.truth().height_m > 29.0, 30.0)
    assert rig.stub.truth().north_m > far_m  # it climbs first, and only then comes home
    rig.run(10.0)
    assert rig.stub.truth().north_m < far_m - 10.0


def test_3_4_the_parameter_acts_at_once_during_the_failsafe() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 3})
    rig.enter_offboard(lambda _: rig.local())
    rig.streaming = None
    rig.run(2.0)
    assert rig.mode == "AUTO/RTL"
    raw = struct.unpack("<f", struct.pack("<i", 6))[0]
    rig.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", raw, 6))
    rig.run(0.1)
    assert rig.mode == "TERMINATION"


# -- 3.5 it comes back by itself ---------------------------------------------------------------------------------


@pytest.mark.parametrize("action", [0, 5])
def test_3_5_a_resumed_stream_takes_the_vehicle_back(action: int) -> None:
    rig = flying(params={"COM_OBL_RC_ACT": action})
    rig.enter_offboard(lambda _: rig.local())
    rig.streaming = None
    rig.run(4.0)
    assert rig.mode != "OFFBOARD"
    rig.streaming = lambda _: rig.local()
    assert first_time(rig, lambda: rig.mode == "OFFBOARD", 1.0) <= 0.05


def test_3_5_an_explicit_mode_in_between_ends_the_intention() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.local())
    rig.streaming = None
    rig.run(4.0)
    rig.set_mode(HOLD)
    rig.streaming = lambda _: rig.local()
    rig.run(3.0)
    assert rig.mode == "AUTO/LOITER"


# -- 3.6 NaN and malformed setpoints -----------------------------------------------------------------------------

X, Y, YAW_RATE = "vx", "vy", "yaw_rate"
INVALID = "SET_POSITION_TARGET_LOCAL_NED invalid\t"
FRAME = "SET_POSITION_TARGET_LOCAL_NED coordinate frame "
ROWS: list[tuple[str, dict[str, Any], str, float, str | None]] = [
    # name, fields, mode after 4 s, ground speed then (NaN: not looked at), words
    ("frame 8, vx = NaN: stops", {"velocity": (NAN, 0, 0)}, "OFFBOARD", 0.0, None),
    ("yaw_rate = NaN: as if ignored", {"velocity": (3, 0, 0), "yaw_rate": NAN}, "OFFBOARD", 3.0, None),
    ("frame 8, all NaN: invalid", {"velocity": (NAN, NAN, NAN)}, "AUTO/LOITER", NAN, INVALID),
    ("frame 1, vz = NaN: stops", {"frame": 1, "velocity": (3, 0, NAN)}, "OFFBOARD", 0.0, None),
    ("frame 1, vz ignored: stops", {"frame": 1, "velocity": (3, 0, 0), "mask": 1479 | 0x20}, "OFFBOARD", 0.0, None),
    ("frame 8, vx ignored: invalid", {"velocity": (3, 0, 0), "mask": 1479 | 0x8}, "AUTO/LOITER", NAN, INVALID),
    ("frame 8, vz ignored: invalid", {"velocity": (3, 0, 0), "mask": 1479 | 0x20}, "AUTO/LOITER", NAN, INVALID),
    ("frame 9", {"frame": 9, "velocity": (3, 0, 0)}, "AUTO/LOITER", NAN, FRAME + "9 u"),
    ("frame 7", {"frame": 7, "velocity": (3, 0, 0)}, "AUTO/LOITER", NAN, FRAME + "7 u"),
    ("frame 12", {"frame": 12, "velocity": (3, 0, 0)}, "AUTO/LOITER", NAN, FRAME + "12 "),
    ("only yaw rate: invalid", {"mask": 1535, "yaw_rate": 0.2}, "AUTO/LOITER", NAN, INVALID),
    ("yaw and yaw_rate ignored: flies", {"velocity": (3, 0, 0), "mask": 1479 | 0x800}, "OFFBOARD", 3.0, None),
    ("the FORCE bit does no harm", {"velocity": (3, 0, 0), "mask": 1991}, "OFFBOARD", 3.0, None),
    ("wrong system: silently ignored", {"velocity": (3, 0, 0), "target": (99, 1)}, "AUTO/LOITER", NAN, None),
    ("the companion's own id: ignored", {"velocity": (3, 0, 0), "target": (1, 191)}, "AUTO/LOITER", NAN, None),
    ("component 0: taken", {"velocity": (3, 0, 0), "target": (1, 0)}, "OFFBOARD", 3.0, None),
]  # fmt: skip


@pytest.mark.parametrize(("fields", "mode", "speed", "words"), [r[1:] for r in ROWS], ids=[r[0] for r in ROWS])
def test_3_6_odd_velocity_setpoints(fields: dict[str, Any], mode: str, speed: float, words: str | None) -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.local(velocity=(3, 0, 0)))
    rig.run(4.0)
    assert rig.stub.truth().speed_m_s == pytest.approx(3.0, abs=0.1)
    rig.gcs_heartbeat()
    changed_s = rig.now_s
    rig.streaming = lambda _: rig.local(**fields)
    rig.run(4.0)
    assert rig.mode == mode
    if not math.isnan(speed):
        assert rig.stub.truth().speed_m_s == pytest.approx(speed, abs=0.35)
    texts = [t for t in rig.texts(changed_s) if "SET_POSITION" in t]
    if words is None:
        assert texts == []
    else:
        assert set(texts) == {words}
        assert len(texts) == pytest.approx(80, abs=3)  # one for every message, 20 a second


def test_3_6_an_unsupported_frame_is_named_in_two_chunks() -> None:
    rig = flying()
    rig.gcs_heartbeat()
    rig.send(rig.local(frame=9))
    rig.run(0.1)
    first, second = rig.all("STATUSTEXT")
    assert (first.text + second.text, first.severity) == (
        "SET_POSITION_TARGET_LOCAL_NED coordinate frame 9 unsupported\t",
        2,
    )
    assert (first.id, first.chunk_seq, second.chunk_seq) == (second.id, 0, 1)
    assert first.id != 0


def test_3_6_attitude_nan_keeps_the_last_rates_and_the_mode() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.attitude(0.15, 0.0, math.pi / 2, 0.489))
    rig.run(3.0)
    began = rig.stub.truth()
    rig.streaming = lambda _: rig.attitude_q((NAN,) * 4, 0.489)
    rig.run(3.0)
    truth = rig.stub.truth()
    assert truth.mode == "OFFBOARD"
    assert truth.speed_m_s > began.speed_m_s + 1.0  # it accelerates on
    assert truth.height_m < began.height_m


def test_3_6_attitude_of_zeros_drifts_on() -> None:
    rig = flying(params={"COM_OBL_RC_ACT": 5})
    rig.enter_offboard(lambda _: rig.local(velocity=(4, 0, 0)))
    rig.run(3.0)
    rig.streaming = lambda _: rig.attitude_q((0.0,) * 4, 0.489)
    rig.run(2.0)
    assert rig.mode == "OFFBOARD"
    assert rig.stub.truth().speed_m_s > 2.5


def test_3_6_thrust_nan_drops_it_to_the_ground() -> None:
    rig = flying(height_m=11.0)
    rig.enter_offboard(lambda _: rig.attitude(0.0, 0.0, 0.0, 0.489))
    rig.streaming = lambda _: rig.attitude(0.0, 0.0, 0.0, NAN)
    rig.run(4.0)
    assert rig.mode == "OFFBOARD"
    assert rig.stub.truth().height_m == 0.0
