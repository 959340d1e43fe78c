"""Faults on a timeline: what each does, that seeds repeat, and that a wrong line says what is wrong with it."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig
from sitl_stub.devices import DEVICES, WITH_ID
from sitl_stub.faults import FAULTS, parse
from tests.stub.rig import OFFBOARD, Rig, flying

RADIO = (1, 158)


def with_faults(*lines: str, **fields: Any) -> Rig:
    """Return a hovering rig with streaming OFFBOARD from 1 s on."""
    rig = Rig(start_height_m=30.0, faults=lines, params={"COM_OBL_RC_ACT": 5}, **fields)
    rig.run(0.5)
    rig.enter_offboard(lambda _: rig.local(velocity=(3, 0, 0)))
    return rig


def modes_of(rig: Rig, seconds: float) -> list[str]:
    seen = [rig.mode]
    for _ in range(round(seconds / 0.05)):
        rig.run(0.05)
        if rig.mode != seen[-1]:
            seen.append(rig.mode)
    return seen


def ranges(rig: Rig) -> list[tuple[float, Any]]:
    return [
        (t, m)
        for t, m in rig.heard
        if m.get_type() == "DISTANCE_SENSOR" and (m.get_srcSystem(), m.get_srcComponent()) == RADIO
    ]


# -- frames ------------------------------------------------------------------------------------------------------


def test_silence_loses_offboard_and_gives_it_back() -> None:
    rig = with_faults("5-8 silence")
    assert modes_of(rig, 12.0) == ["OFFBOARD", "AUTO/LOITER", "OFFBOARD"]
    heard = [t for t, _ in rig.heard]
    assert not [t for t in heard if 5.02 < t < 8.0]


def test_drop_in_loses_a_share_of_setpoints() -> None:
    rig = Rig(start_height_m=30.0, faults=("2-100 drop in 0.5",), streams=())
    rig.stream_period_s = 0.02
    rig.streaming = lambda _: rig.local()
    taken = 0
    last = None
    for _ in range(1500):
        rig.run(0.02)
        if rig.stub.autopilot.commander.last_setpoint_s != last:
            last = rig.stub.autopilot.commander.last_setpoint_s
            taken += rig.now_s > 2.1
    assert taken / 1400 == pytest.approx(0.5, abs=0.06)


def test_drop_out_loses_a_share_of_the_streams() -> None:
    rig = Rig(faults=("10-20 drop out 0.7",), streams=(32,))
    rig.run(20.0)
    before = sum(1 for t, m in rig.heard if m.get_type() == "LOCAL_POSITION_NED" and t < 10.0)
    after = sum(1 for t, m in rig.heard if m.get_type() == "LOCAL_POSITION_NED" and t >= 10.0)
    assert after / before == pytest.approx(0.3, abs=0.08)


def test_delay_in_delays_the_answer() -> None:
    rig = flying(faults=("0-100 delay in 0.4",))
    asked_s = rig.now_s
    rig.command(400, 1, run_s=1.0)
    answered_s = next(t for t, m in rig.heard if m.get_type() == "COMMAND_ACK")
    assert answered_s - asked_s == pytest.approx(0.41, abs=0.03)


def test_delay_out_delays_what_is_seen() -> None:
    rig = flying(faults=("0-100 delay out 0.3",))
    asked_s = rig.now_s
    rig.command(400, 1, run_s=1.0)
    assert next(t for t, m in rig.heard if m.get_type() == "COMMAND_ACK") - asked_s == pytest.approx(0.31, abs=0.03)


def test_duplicate_in_answers_twice() -> None:
    rig = flying(faults=("0-100 duplicate in 1",))
    assert rig.command(400, 1) == [0, 0]


def test_reorder_out_lets_frames_overtake() -> None:
    rig = Rig(faults=("0-100 reorder out 0.3",), streams=(30,))
    rig.run(5.0)
    stamps = [m.time_boot_ms for m in rig.all("ATTITUDE")]
    assert len(stamps) == pytest.approx(490, abs=15)
    assert stamps != sorted(stamps)


def test_corrupt_out_spoils_checksums_and_nothing_wrong_is_decoded() -> None:
    rig = Rig(faults=("0-100 corrupt out 0.5",), streams=(30,))
    rig.run(10.0)
    good = rig.all("ATTITUDE")
    assert 300 < len(good) < 700
    assert all(m.roll == 0.0 for m in good)


def test_corrupt_in_is_refused_by_the_checksum() -> None:
    rig = with_faults("2-30 corrupt in 0.6")
    rig.stream_period_s = 0.02
    rig.run(10.0)
    assert rig.mode == "OFFBOARD"
    assert rig.stub.truth().speed_m_s == pytest.approx(3.0, abs=0.1)


# -- ranges ------------------------------------------------------------------------------------------------------


def measured(*lines: str, seconds: float = 6.0, **fields: Any) -> list[tuple[float, Any]]:
    fields = {"radio": True, "beacon_east_m": 100.0, "range_sigma_m": 0.0, **fields}
    rig = Rig(faults=lines, streams=(132,), **fields)
    rig.run(seconds)
    return ranges(rig)


def test_range_stop() -> None:
    times = [t for t, _ in measured("2-4 range-stop")]
    assert not [t for t in times if 2.0 < t < 3.99]
    assert [t for t in times if t > 4.0]


def test_range_stick() -> None:
    values = [m.current_distance for t, m in measured("2-4 range-stick", range_sigma_m=0.5) if 2.0 <= t < 3.99]
    assert len(set(values)) == 1
    assert len(values) >= 19


@pytest.mark.parametrize(
    ("fault", "cm"),
    [("range-add 30", 13000), ("range-add -20", 8000), ("range-value 0", 0), ("range-value 1e6", 65535)],
)
def test_wrong_ranges(fault: str, cm: int) -> None:
    values = {m.current_distance for t, m in measured(f"2-4 {fault}") if 2.05 < t < 3.99}
    assert values == {cm}


def test_range_invalid() -> None:
    found = [m for t, m in measured("2-4 range-invalid") if 2.05 < t < 3.99]
    assert {(m.signal_quality, m.current_distance) for m in found} == {(1, 0)}


def test_wrong_id_and_orientation() -> None:
    found = [m for t, m in measured("2-4 range-id 9", "2-4 range-orientation 25") if 2.05 < t < 3.99]
    assert {(m.id, m.orientation) for m in found} == {(9, 25)}


def test_a_range_of_nan_where_the_message_has_a_place_for_it() -> None:
    rig = Rig(radio=True, faults=("2-4 range-value nan", "2-4 range-add 3"), range_message="landing_target")
    rig.run(6.0)
    seen = [(t, m.distance) for t, m in rig.heard if m.get_type() == "LANDING_TARGET"]
    assert {math.isnan(d) for t, d in seen if 2.05 < t < 3.99} == {True}
    assert not [d for t, d in seen if t > 4.05 and math.isnan(d)]


def reports(device: str, *lines: str) -> tuple[list[bytes], list[bytes]]:
    """Return what a device 100 m from the beacon reports before the faults of 2 to 4 s, and meanwhile."""
    stub = Stub(StubConfig(device=device, beacon_east_m=100.0, range_sigma_m=0.0, faults=lines))
    stub.advance(1.95)
    before = stub.take("device")
    stub.advance(2.05)
    stub.take("device")
    stub.advance(3.95)
    return before, stub.take("device")


def linktrack_mm(frame: bytes) -> int:
    return int.from_bytes(frame[23:26], "little", signed=True)  # NodeFrame3: a header of 21 bytes, role, id, range


@pytest.mark.parametrize("fault", ["range-invalid", "range-value nan"])
def test_a_device_without_a_range_says_so_in_its_own_way(fault: str) -> None:
    """The manuals: LinkTrack and US-D1 read 0, LightWare 130.00, the others leave the range out."""
    before, meanwhile = reports("linktrack", f"2-4 {fault}")
    assert ({*map(linktrack_mm, before)}, {*map(linktrack_mm, meanwhile)}) == ({100_000}, {0})
    assert {*reports("lightware", f"2-4 {fault}")[1]} == {b"130.00\r\n"}
    assert {report[2:4] for report in reports("us_d1", f"2-4 {fault}")[1]} == {bytes(2)}
    for device in ("dwm1001_les", "omnipresense", "lines", "replay"):
        before, meanwhile = reports(device, f"2-4 {fault}")
        assert (len(before), meanwhile) == (20, []), device


def test_a_devices_ranges_come_with_another_id() -> None:
    before, meanwhile = reports("dwm1001_les", "2-4 range-id 9", "2-4 range-add 5")
    assert ({b[:20] for b in before}, {m[:4] for m in meanwhile}) == ({b"0001[0.00,0.00,0.00]"}, {b"0009"})
    assert {m.split(b"=")[1].split()[0] for m in meanwhile} == {b"105.00"}
    before, meanwhile = reports("linktrack", "2-4 range-id 9")
    assert ({b[22] for b in before}, {m[22] for m in meanwhile}) == ({1}, {9})


@pytest.mark.parametrize("device", DEVICES)
def test_only_devices_with_an_id_take_another(device: str) -> None:
    """The table that configurations are checked by is what the bytes say."""
    make = DEVICES[device]
    assert (make(1).encode(10.0, 0.0, 1.0) != make(2).encode(10.0, 0.0, 1.0)) == (device in WITH_ID)


@pytest.mark.parametrize(
    ("fields", "line", "words"),
    [
        ({"radio": False}, "1-2 range-stop", "there is no radio on board"),
        ({"device": "linktrack"}, "1-2 range-orientation 25", "linktrack carries no orientation"),
        ({"range_message": "landing_target"}, "1-2 range-orientation 25", "landing_target carries no orientation"),
        ({"device": "us_d1"}, "1-2 range-id 9", "us_d1 carries no id"),
        ({}, "1-2 range-value nan", "distance_sensor carries a whole number"),
        ({"range_message": "ranging_beacon"}, "1-2 range-value nan", "ranging_beacon carries a whole number"),
    ],
)
def test_a_fault_that_cannot_act_is_refused(fields: dict[str, Any], line: str, words: str) -> None:
    with pytest.raises(ValueError, match="cannot act") as caught:
        StubConfig(faults=(line,), **fields)
    assert repr(line) in str(caught.value)
    assert words in str(caught.value)


# -- the vehicle -------------------------------------------------------------------------------------------------


def test_refused_arming() -> None:
    rig = Rig(faults=("0-5 refuse-arm",))
    rig.run(3.0)
    assert rig.command(400, 1) == [1]
    rig.run(3.0)
    assert rig.command(400, 1) == [0]


def test_refused_offboard() -> None:
    rig = flying(faults=("0-5 refuse-offboard",))
    rig.streaming = lambda _: rig.local()
    rig.run(0.5)
    assert rig.set_mode(OFFBOARD) == [0, 1]
    rig.run(5.0)
    assert rig.set_mode(OFFBOARD) == [0, 0]


def test_deaf_ears_lose_offboard() -> None:
    assert modes_of(with_faults("5-8 deaf"), 12.0) == ["OFFBOARD", "AUTO/LOITER", "OFFBOARD"]


def test_gps_lost_in_flight_ends_a_velocity_flight() -> None:
    rig = with_faults("5-60 no-gps")
    rig.run(8.0)
    assert rig.mode == "AUTO/LAND"


def test_gcs_takes_over() -> None:
    rig = with_faults("5 gcs hold")
    rig.run(8.0)
    assert rig.mode == "AUTO/LOITER"
    assert not rig.stub.truth().failsafe


def test_foreign_vehicle_with_another_id() -> None:
    rig = with_faults("3-6 foreign 42")
    rig.run(10.0)
    beats = [t for t, m in rig.heard if m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 42]
    assert beats
    assert min(beats) >= 3.0
    assert max(beats) <= 6.1


def test_foreign_vehicle_with_our_id_makes_the_mode_flicker() -> None:
    rig = with_faults("3-8 foreign 1")
    rig.run(10.0)
    assert {m.custom_mode for m in rig.all("HEARTBEAT", 3.5)} == {OFFBOARD, 0x03040000}


def test_reboot() -> None:
    rig = Rig(faults=("5 reboot",), streams=(30,))
    rig.run(1.5)
    rig.command(400, 1)
    rig.command(511, 32, 20000)
    rig.run(3.0)
    rig.run(4.0)
    times = [t for t, m in rig.heard if m.get_type() == "ATTITUDE" and t > 4.5]
    gaps = [b - a for a, b in pairwise(times)]
    assert max(gaps) == pytest.approx(2.0, abs=0.1)
    assert rig.all("ATTITUDE")[-1].time_boot_ms < 2000
    assert not rig.stub.truth().armed
    assert rig.stub.links["offboard"].intervals_s[32] == pytest.approx(1 / 29.9)


def test_clock_jump() -> None:
    rig = Rig(faults=("5 clock 3600",), streams=(30,))
    rig.run(6.0)
    stamps = [m.time_boot_ms for m in rig.all("ATTITUDE")]
    assert max(b - a for a, b in pairwise(stamps)) == pytest.approx(3_600_000, abs=30)


def test_param_wind_and_beacon_change() -> None:
    rig = flying(faults=("2 param COM_OBL_RC_ACT=4", "2 wind 5,-3", "2 beacon 50,60"))
    rig.run(3.0)
    truth = rig.stub.truth()
    assert rig.stub.autopilot.params["COM_OBL_RC_ACT"] == 4
    assert (truth.wind_east_m_s, truth.wind_north_m_s) == (5.0, -3.0)
    assert (truth.beacon_east_m, truth.beacon_north_m) == (50.0, 60.0)
    assert truth.horizontal_range_m == pytest.approx(math.hypot(50 - truth.east_m, 60 - truth.north_m))


# -- the timeline ------------------------------------------------------------------------------------------------


def flight(seed: int, step: float) -> tuple[bytes, Any]:
    """Fly a minute of trouble and return every byte sent and the end."""
    lines = ("5-40 drop in 0.2", "10-30 corrupt out 0.1", "12-20 reorder out 0.3", "15-18 range-stick", "20-25 silence")
    stub = Stub(StubConfig(seed=seed, faults=lines, start_height_m=20.0, gust_sigma_m_s=1.0, outlier_share=0.1))
    sent = bytearray()
    for k in range(1, round(45.0 / step) + 1):
        stub.advance(k * step)
        for datagram in stub.take("offboard"):
            sent += datagram
    return bytes(sent), stub.truth()


def test_equal_seeds_give_equal_flights_however_time_is_cut() -> None:
    assert flight(3, 0.02) == flight(3, 0.5)


def test_other_seeds_give_other_flights() -> None:
    assert flight(3, 0.5)[0] != flight(4, 0.5)[0]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("range-stop", "FROM-TO KIND"),
        ("40 range-stop", "needs FROM-TO"),
        ("50-40 range-stop", "FROM before TO"),
        ("40-50 reboot", "takes no FROM-TO"),
        ("40-50 range-stpo", "no kind 'range-stpo'"),
        ("x-50 range-stop", "neither FROM-TO nor AT"),
        ("1-2 drop in", "is written 'FROM-TO drop in|out SHARE'"),
        ("1-2 drop sideways 0.5", "'sideways' does not fit"),
        ("1-2 drop in 1.5", "'1.5' does not fit"),
        ("5 gcs fly", "'fly' does not fit"),
        ("5 param X", "'X' does not fit"),
        ("1-2 range-id 300", "'300' does not fit"),
    ],
)
def test_a_wrong_line_says_what_is_wrong(line: str, words: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        parse(line)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_parameter_in_a_timeline_is_refused_at_the_start() -> None:
    with pytest.raises(ValueError, match="no parameter"):
        Stub(StubConfig(faults=("5 param NO_SUCH=1",)))


def test_every_kind_is_tested_here() -> None:
    source = Path(__file__).read_text(encoding="utf-8")
    assert [kind for kind in FAULTS if f" {kind}" not in source and f'"{kind} ' not in source] == []


@pytest.mark.parametrize("line", ["2 wind nan,nan", "2 wind inf,1", "2 beacon nan,1", "2 param COM_OF_LOSS_T=nan"])
def test_a_line_that_is_no_number_is_refused_before_the_flight(line: str) -> None:
    with pytest.raises(ValueError, match=line.split()[1]):
        parse(line)


def test_a_huge_message_interval_is_told_and_does_not_end_the_vehicle() -> None:
    stub = Stub(StubConfig())
    mav = mavlink.MAVLink(None, 1, 191)
    for command, interval_us in ((511, 1e30), (510, 0.0)):
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, 30, interval_us, 0, 0, 0, 0, 0)
        stub.receive("offboard", message.pack(mav))
        stub.advance(stub.now_s + 0.1)
    assert stub.take("offboard")
