"""Arming and take-off without RC and GCS, row by row: PX4.md, section 2."""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

import sitl_stub
from sitl_stub import StubConfig
from sitl_stub.params import Parameters
from tests.stub.rig import HERE, HOLD, OFFBOARD, Rig, first_time, flying

AMSL_M = 489.4
INT32, REAL32 = 6, 9


def ready(**fields: object) -> Rig:
    rig = Rig(**fields)
    rig.gcs_heartbeat()
    rig.run(2.0)
    return rig


def as_float(value: int) -> float:
    return struct.unpack("<f", struct.pack("<i", value))[0]


def keep_gcs(rig: Rig, seconds: float) -> None:
    for _ in range(round(seconds)):
        rig.gcs_heartbeat()
        rig.run(1.0)


def test_boot_is_uninit_then_standby() -> None:
    rig = Rig(ready_after_s=7.0)
    rig.run(10.0)
    statuses = [m.system_status for m in rig.all("HEARTBEAT")]
    assert statuses[:5] == [0] * 5
    assert statuses[-2:] == [3, 3]
    assert rig.all("HEARTBEAT")[-1].base_mode == 29


def test_arming_is_refused_before_ready() -> None:
    rig = Rig(ready_after_s=7.0)
    rig.run(3.0)
    assert rig.command(400, 1) == [1]
    rig.run(5.0)
    assert rig.command(400, 1) == [0]


@pytest.mark.parametrize("mode", [0x00010000, 0x00020000, 0x00030000, 0x00050000, 0x00070000])
def test_arming_in_a_stick_mode_needs_sticks(mode: int) -> None:
    rig = ready()
    assert rig.set_mode(mode) == [0, 0]  # disarmed, nothing is refused
    assert rig.command(400, 1) == [1]
    assert "Arming denied: Resolve system health failures first\t" in "".join(rig.texts())
    rig.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    assert rig.command(400, 1) == [0]
    assert rig.stub.truth().armed


def test_arming_without_a_position_needs_a_mode_that_does_without() -> None:
    rig = ready(gps=False, streams=(1,))
    for mode in (HOLD, 0x02040000, 0x05040000):
        assert rig.set_mode(mode) == [0, 0]
        assert rig.command(400, 1) == [1]
    assert not rig.all("SYS_STATUS")[-1].onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert "Arming denied: Resolve system health failures first\t" in "".join(rig.texts())
    rig.streaming = lambda _: rig.attitude(0.0, 0.0, 0.0, 0.0)
    rig.run(0.1)
    assert rig.set_mode(OFFBOARD) == [0, 0]
    assert rig.command(400, 1) == [0]


def test_arm_is_acked_after_10_to_15_ms_and_seen_within_a_second() -> None:
    rig = ready()
    asked_s = rig.now_s
    assert rig.command(400, 1) == [0]
    acked_s = next(t for t, m in rig.heard if m.get_type() == "COMMAND_ACK")
    assert 0.008 <= acked_s - asked_s <= 0.021
    rig.run(1.0)
    beat = rig.all("HEARTBEAT")[-1]
    assert (beat.base_mode, beat.system_status, beat.custom_mode) == (157, 4, 0x03040000)
    assert "Armed by external command\t" in rig.texts()


def test_take_off_climbs_and_goes_on_to_hold() -> None:
    """18 s to 20 m, and then by itself into Hold, which brings up what NAV_MC_ALT_RAD left."""
    rig = ready(height_drift_m_s=0.0)
    rig.command(400, 1)
    assert rig.command(22, 0, 0, 0, HERE, HERE, HERE, AMSL_M + 20.0) == [0]
    assert rig.mode == "AUTO/TAKEOFF"
    assert first_time(rig, lambda: rig.mode == "AUTO/LOITER", 40.0) == pytest.approx(18.0, rel=0.1)
    assert rig.stub.truth().height_m == pytest.approx(19.2, abs=0.05)
    rig.run(10.0)
    assert rig.stub.truth().height_m == pytest.approx(20.0, abs=0.1)


def test_take_off_without_a_height_goes_to_MIS_TAKEOFF_ALT() -> None:
    """It ends 0.8 m below. Nothing below it was recorded but a height: 2.1 m, 8 s after arming."""
    rig = ready(height_drift_m_s=0.0)
    rig.command(22, 0, 0, 0, HERE, HERE, HERE, HERE)
    rig.command(400, 1)
    rig.run(7.9)
    assert rig.stub.truth().height_m == pytest.approx(2.1, abs=0.15)
    assert rig.mode == "AUTO/LOITER"
    rig.run(8.0)
    assert rig.stub.truth().height_m == pytest.approx(2.5, abs=0.05)


def test_take_off_speed() -> None:
    rig = ready(height_drift_m_s=0.0)
    rig.command(400, 1)
    rig.command(22, 0, 0, 0, HERE, HERE, HERE, AMSL_M + 30.0)
    rig.run(8.0)
    assert 1.2 <= rig.stub.truth().climb_m_s <= 1.5


def test_take_off_works_in_flight() -> None:
    """From 2 to 20 m in 9 s."""
    rig = flying(height_m=2.0)
    rig.command(22, 0, 0, 0, HERE, HERE, HERE, AMSL_M + 20.0)
    assert first_time(rig, lambda: rig.mode == "AUTO/LOITER", 30.0) == pytest.approx(9.0, rel=0.25)


def test_take_off_while_disarmed_waits_for_arming() -> None:
    rig = ready(height_drift_m_s=0.0)
    assert rig.command(22, 0, 0, 0, HERE, HERE, HERE, HERE) == [0]
    assert rig.mode == "AUTO/TAKEOFF"
    rig.run(3.0)
    assert rig.stub.truth().height_m == 0.0
    rig.gcs_heartbeat()
    rig.command(400, 1)
    detected_s = first_time(rig, lambda: "Takeoff detected\t" in rig.texts(), 5.0)
    assert detected_s == pytest.approx(1.9, abs=0.2)
    assert "Using default takeoff altitude: 2.5 m\t" in rig.texts()
    rig.run(6.2)
    assert rig.stub.truth().height_m > 2.0


def test_an_armed_vehicle_that_stays_is_disarmed() -> None:
    rig = ready()
    rig.command(400, 1)
    waited_s = 0.1 + first_time(rig, lambda: not rig.stub.truth().armed, 20.0)
    assert waited_s == pytest.approx(11.2, abs=0.4)


def test_preflight_disarming_is_told() -> None:
    rig = ready()
    rig.command(400, 1)
    keep_gcs(rig, 13.0)
    assert "Disarmed by auto preflight disarming\t" in rig.texts()


def test_landing_disarms() -> None:
    rig = flying(height_m=5.0)
    assert rig.command(21) == [0]
    assert rig.mode == "AUTO/LAND"
    keep_gcs(rig, 15.0)
    assert not rig.stub.truth().armed
    assert {"Landing detected\t", "Disarmed by landing\t"} <= set(rig.texts())
    assert rig.mode == "AUTO/LOITER"


def test_return_climbs_comes_home_and_lands() -> None:
    rig = flying(height_m=15.0)
    rig.enter_offboard(lambda _: rig.local(velocity=(6.0, 0.0, 0.0)))
    rig.run(10.0)
    rig.streaming = None
    assert rig.command(20) == [0]
    assert rig.mode == "AUTO/RTL"
    highest = 0.0
    for _ in range(150):
        rig.run(1.0)
        highest = max(highest, rig.stub.truth().height_m)
    truth = rig.stub.truth()
    assert highest == pytest.approx(30.0, abs=1.0)
    assert math.hypot(truth.north_m, truth.east_m) < 1.0
    assert not truth.armed


def test_disarming_in_the_air_needs_force() -> None:
    rig = flying()
    assert rig.command(400, 0) == [1]
    assert rig.command(400, 0, 21196) == [0]
    rig.run(4.0)
    assert rig.stub.truth().height_m == 0.0


def test_manual_control_that_never_existed_is_not_missed() -> None:
    rig = flying()
    assert rig.stub.autopilot.params["NAV_RCL_ACT"] == 2
    rig.run(10.0)
    assert rig.mode == "AUTO/LOITER"
    assert not rig.stub.truth().failsafe


@pytest.mark.parametrize("rc_in_mode", [0, 1, 3, 4])
def test_arming_without_rc_in_every_COM_RC_IN_MODE(rc_in_mode: int) -> None:
    assert ready(params={"COM_RC_IN_MODE": rc_in_mode}).command(400, 1) == [0]


def test_an_int_parameter_wants_its_bytes() -> None:
    rig = ready()
    rig.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", as_float(5), INT32))
    rig.run(0.1)
    assert rig.stub.autopilot.params["COM_OBL_RC_ACT"] == 5
    answer = rig.all("PARAM_VALUE")[-1]
    assert (answer.param_id, answer.param_value, answer.param_type) == ("COM_OBL_RC_ACT", as_float(5), INT32)


def test_an_int_parameter_sent_as_a_float_is_silently_ignored() -> None:
    rig = ready()
    rig.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", 5.0, REAL32))
    rig.run(0.1)
    assert rig.stub.autopilot.params["COM_OBL_RC_ACT"] == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("COM_RC_IN_MODE", 1), ("NAV_RCL_ACT", 2), ("NAV_DLL_ACT", 0), ("COM_RCL_EXCEPT", 0), ("COM_ARM_WO_GPS", 1),
        ("COM_OF_LOSS_T", 1.0), ("COM_OBL_RC_ACT", 0), ("COM_FAIL_ACT_T", 5), ("COM_DL_LOSS_T", 10),
        ("COM_RC_LOSS_T", 0.5), ("COM_RC_OVERRIDE", 1), ("CBRK_SUPPLY_CHK", 0), ("CBRK_USB_CHK", 197848),
        ("CBRK_IO_SAFETY", 22027), ("COM_DISARM_PRFLT", 10), ("COM_DISARM_LAND", 2), ("MIS_TAKEOFF_ALT", 2.5),
        ("COM_PREARM_MODE", 0), ("MAV_FWDEXTSP", 1),
    ],
)  # fmt: skip
def test_boot_values(name: str, value: float) -> None:
    rig = ready()
    rig.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    rig.run(0.1)
    answer = rig.all("PARAM_VALUE")[-1]
    got = answer.param_value
    if answer.param_type == INT32:
        got = struct.unpack("<i", struct.pack("<f", got))[0]
    assert (answer.param_id, got) == (name, value)


@pytest.mark.parametrize(("name", "value"), [("COM_DISARM_PRFLT", -1), ("MIS_TAKEOFF_ALT", 25), ("NAV_LOITER_RAD", 80)])
def test_boot_values_of_the_airplane(name: str, value: float) -> None:
    assert Rig(airframe="fixed_wing").stub.autopilot.params[name] == value


def test_z_is_not_zero_on_the_ground() -> None:
    """Take heights from GLOBAL_POSITION_INT, or note z at arming: -0.73 to 0.01 m were seen."""
    rig = ready(streams=(32, 33))
    assert rig.all("LOCAL_POSITION_NED")[-1].z == pytest.approx(-0.46, abs=0.01)
    assert rig.all("GLOBAL_POSITION_INT")[-1].relative_alt == 0


@pytest.mark.parametrize(("airframe", "within_m"), [("multirotor", 0.5), ("fixed_wing", 90.0)])
def test_reposition_holds_somewhere_else(airframe: str, within_m: float) -> None:
    """DO_REPOSITION with a place and a height; the airplane circles around it with NAV_LOITER_RAD."""
    rig = Rig(airframe=airframe, start_height_m=40.0, height_drift_m_s=0.0, streams=(33,))
    rig.run(1.0)
    here = rig.all("GLOBAL_POSITION_INT")[-1]
    rig.send(
        mavlink.MAVLink_command_int_message(
            1, 1, 0, 192, 0, 0, -1, 1, 0, math.nan, here.lat + 9000, here.lon, AMSL_M + 55.0
        )
    )
    rig.run(0.1)
    assert rig.acks(192) == [0]
    rig.run(90.0)
    truth = rig.stub.truth()
    assert rig.mode == "AUTO/LOITER"
    north_m = 9000e-7 * math.radians(6371000.0) + (0.0 if airframe == "multirotor" else 12.0)
    assert math.hypot(truth.north_m - north_m, truth.east_m) < within_m
    assert truth.height_m == pytest.approx(55.0, abs=2.0)


def test_reposition_without_the_flag_to_change_mode_does_nothing() -> None:
    rig = flying()
    rig.enter_offboard(lambda _: rig.local(velocity=(3.0, 0.0, 0.0)))
    for flags in (0, 2, HERE):
        assert rig.command(192, -1, flags, 0, HERE, 47.4, 8.55, AMSL_M + 55.0) == [3]
    rig.run(1.0)
    assert rig.mode == "OFFBOARD"
    assert rig.command(17) == [0]
    rig.run(10.0)
    assert rig.stub.truth().height_m == pytest.approx(30.0, abs=0.5)


@pytest.mark.parametrize(
    ("refused", "mode", "again"),
    [
        ((192, -1, 1, 0, HERE, HERE, HERE, AMSL_M + 55.0), "AUTO/LOITER", (17,)),
        ((22, 0, 0, 0, HERE, HERE, HERE, AMSL_M + 55.0), "AUTO/TAKEOFF", (176, 1, 4, 2)),
    ],
    ids=["reposition", "takeoff"],
)
def test_the_target_of_a_refused_command_is_forgotten(refused: tuple[float, ...], mode: str, again: tuple[int, ...]):
    """Refused for want of a position; with the position back, the mode alone must not go there."""
    rig = flying(faults=("1-3 no-gps",))
    rig.streaming = lambda _: rig.attitude(0.0, 0.0, 0.0, 0.489)
    rig.run(0.3)
    rig.set_mode(OFFBOARD)
    rig.run(1.0)
    assert rig.command(*refused) == [1]
    assert rig.mode == "OFFBOARD"
    rig.run(2.0)
    height_m = rig.stub.truth().height_m
    assert rig.command(*again)[-1] == 0
    assert rig.mode == mode
    rig.run(20.0)
    assert rig.stub.truth().height_m == pytest.approx(height_m, abs=3.0)  # MIS_TAKEOFF_ALT is 2.5 m


PACKAGE = Path(sitl_stub.__file__).parent
DOCUMENT = Path(__file__).parents[2] / "docs" / "stub.md"


def test_the_document_names_exactly_the_parameters_that_nothing_reads() -> None:
    modules = [path.read_text(encoding="utf-8") for path in PACKAGE.glob("*.py") if path.name != "params.py"]
    names = {*Parameters(fixed_wing=False), *Parameters(fixed_wing=True)}
    unread = {name for name in names if not any(f'"{name}"' in text for text in modules)}
    rows = DOCUMENT.read_text(encoding="utf-8").splitlines()
    row = next(line for line in rows if line.startswith("| what these parameters do: "))
    assert {*re.findall("`([A-Z][A-Z0-9_]+)`", row.split("|")[1])} == unread


def test_the_system_id_is_a_parameter_too() -> None:
    rig = Rig(system_id=42)
    rig.send(mavlink.MAVLink_param_request_read_message(42, 1, b"MAV_SYS_ID", -1))
    rig.run(0.2)
    (answer,) = rig.all("PARAM_VALUE")
    assert struct.unpack("<i", struct.pack("<f", answer.param_value)) == (42,)
    assert StubConfig(system_id=42, params={"MAV_SYS_ID": 42}).params["MAV_SYS_ID"] == 42
    for wrong in ({"params": {"MAV_SYS_ID": 5}}, {"faults": ("5 param MAV_SYS_ID=5",)}):
        with pytest.raises(ValueError, match=r"MAV_SYS_ID .* system_id"):
            StubConfig(**wrong)


def test_home_is_where_it_arms_and_a_reboot_begins_a_frame_and_keeps_parameters() -> None:
    rig = flying(height_m=5.0, params={"COM_OBL_RC_ACT": 5}, streams=(32,))
    rig.run(2.0)
    assert rig.all("HOME_POSITION")[-1].x == pytest.approx(0.0, abs=0.01)
    rig.enter_offboard(lambda _: rig.local(velocity=(5.0, 2.0, 0.0)))
    rig.run(6.0)
    rig.streaming = None
    rig.command(21)
    rig.run(15.0)
    there = rig.stub.truth()
    assert not there.armed
    assert there.north_m > 20.0
    assert rig.command(400, 1) == [0]
    rig.run(2.1)
    home = rig.all("HOME_POSITION")[-1]
    assert (home.x, home.y) == pytest.approx((there.north_m, there.east_m), abs=0.01)
    rig.command(22, 0, 0, 0, HERE, HERE, HERE, AMSL_M + 5.0)
    rig.run(12.0)
    rig.command(20)
    rig.run(80.0)
    assert not rig.stub.truth().armed
    back = rig.stub.truth()
    assert math.hypot(back.north_m - there.north_m, back.east_m - there.east_m) < 1.0
    rig.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", as_float(4), INT32))
    assert rig.command(246, 1) == []
    rig.run(5.0)
    place, home = rig.all("LOCAL_POSITION_NED")[-1], rig.all("HOME_POSITION")[-1]
    assert (place.x, place.y, home.x, home.y) == pytest.approx((0.0,) * 4, abs=0.01)
    assert rig.stub.autopilot.params["COM_OBL_RC_ACT"] == 4
