"""The link of a PX4: streams, requests, echo, forwarding, texts, services, versions, signing (PX4.md 1, 7, 11)."""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig, wire
from sitl_stub.rates import FIXED_WING_HZ, ONBOARD_HZ
from sitl_stub.streams import BUILDERS
from tests.stub.rig import FAST_STREAMS, HERE, Rig, flying
from tests.stub.test_override import Station

ALL = tuple(FAST_STREAMS)


def counted(seconds: float, **fields: Any) -> tuple[Counter[int], int]:
    """Return messages by id and bytes sent on the offboard link without any request."""
    stub = Stub(StubConfig(radio=False, **fields))
    splitter, ids, size = wire.Splitter(), Counter[int](), 0
    for k in range(round(seconds * 10)):
        stub.advance(k * 0.1)
        for datagram in stub.take("offboard"):
            size += len(datagram)
            ids.update(wire.msgid_of(raw) for raw in splitter.feed(datagram))
    assert splitter.bad == 0
    return ids, size


# -- section 1: streams ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("airframe", "rate", "kilobytes"), [("multirotor", 408, 24.2), ("fixed_wing", 418, 24.5)])
def test_default_streams(airframe: str, rate: float, kilobytes: float) -> None:
    ids = counted(20.0, airframe=airframe)[0]
    # On the ground PX4 has no setpoint of its own to tell, and no wind.
    expected = ONBOARD_HZ | (FIXED_WING_HZ if airframe == "fixed_wing" else {})
    expected = {k: v for k, v in expected.items() if k not in (87, 231)}
    assert set(ids) == set(expected)
    for msgid, hz in expected.items():
        assert ids[msgid] == pytest.approx(20.0 * hz, abs=1.5 + 0.02 * 20.0 * hz), msgid
    assert sum(ids.values()) / 20.0 == pytest.approx(rate, rel=0.03)
    # In the air, where fields are not zero (zeros at the end of a message are not sent).
    size = counted(20.0, airframe=airframe, start_height_m=50.0, gust_sigma_m_s=1.0)[1]
    assert size / 20.0 / 1000.0 == pytest.approx(kilobytes, rel=0.15)


def test_every_stream_decodes_with_pymavlink() -> None:
    """The stub packs by itself: an independent decoder must read every message it can send."""
    rig = Rig(streams=ALL, start_height_m=12.0, system_id=7)
    for msgid in BUILDERS:
        rig.command(512, msgid, run_s=0.0)
    rig.run(2.0)
    unknown = {8, 380, 411}
    kinds = {m.get_type() for _, m in rig.heard}
    assert {mavlink.mavlink_map[i].msgname for i in BUILDERS if i not in unknown} <= kinds
    assert "BAD_DATA" not in kinds
    assert {m.get_srcSystem() for _, m in rig.heard if "UNKNOWN" not in m.get_type()} == {7}


def test_heartbeat_is_at_1_hz_and_not_sent_on_a_mode_change() -> None:
    rig = flying()
    for _ in range(10):
        rig.command(21, run_s=0.7)
        rig.set_mode(0x03040000, run_s=0.7)
    times = [t for t, m in rig.heard if m.get_type() == "HEARTBEAT"]
    assert {round(b - a, 2) for a, b in pairwise(times)} == {1.0}


def test_the_downward_decoy_reads_the_height() -> None:
    rig = flying(height_m=92.3, streams=(132,))
    decoy = rig.all("DISTANCE_SENSOR")[-1]
    assert (decoy.id, decoy.orientation, decoy.current_distance, decoy.max_distance) == (0, 25, 9230, 10000)


def test_texts_only_where_a_ground_station_was_heard() -> None:
    rig = flying()
    station = Station(rig)
    rig.command(400, 0)
    assert rig.texts() == []
    assert "Disarming denied: not landed\t" in station.texts()


def test_texts_need_a_recent_heartbeat_of_a_gcs() -> None:
    rig = flying()
    rig.gcs_heartbeat()
    rig.run(6.0)
    rig.command(400, 0)
    assert rig.texts() == []


def test_timesync_is_asked_and_answered() -> None:
    rig = Rig(streams=(111,))
    rig.run(2.0)
    asked = rig.all("TIMESYNC")
    assert len(asked) == pytest.approx(20, abs=2)
    assert {m.tc1 for m in asked} == {0}
    assert asked[-1].ts1 == pytest.approx(rig.now_s * 1e9, abs=0.12e9)
    rig.send(mavlink.MAVLink_timesync_message(0, 123456789))
    rig.run(0.02)
    answer = [m for m in rig.all("TIMESYNC") if m.tc1]
    assert [m.ts1 for m in answer] == [123456789]


# -- section 7: the echo -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("orientation", [0, 100, 25])
def test_a_companions_distance_sensor_is_echoed_with_changed_fields(orientation: int) -> None:
    rig = Rig(streams=(132,))
    rig.streaming = lambda _: mavlink.MAVLink_distance_sensor_message(
        5, 20, 4000, 1234, 0, 5, orientation, 10, 0.1, 0.2, [1, 0, 0, 0], 77
    )
    rig.run(3.0)
    echoes = [m for m in rig.all("DISTANCE_SENSOR", 1.0) if m.id]
    assert len(echoes) == pytest.approx(20, abs=2)
    m = echoes[-1]
    assert (m.id, m.orientation, m.current_distance, m.min_distance, m.max_distance) == (1, orientation, 1234, 19, 4000)
    assert (m.covariance, m.signal_quality) == (9, 76)
    assert m.horizontal_fov == pytest.approx(0.1)
    assert m.quaternion[0] == 1.0


def test_the_gcs_gets_the_echo_and_not_the_raw_message() -> None:
    rig = Rig()
    station = Station(rig)
    rig.streaming = lambda _: mavlink.MAVLink_distance_sensor_message(5, 20, 4000, 1234, 0, 5, 0, 10)
    rig.run(6.0)
    station.listen()
    sources = {m.get_srcComponent() for m in station.heard if m.get_type() == "DISTANCE_SENSOR"}
    assert sources == {1}


def test_the_radio_speaks_for_itself_and_is_echoed() -> None:
    rig = Rig(radio=True, beacon_east_m=80.0, range_sigma_m=0.0, streams=(132,))
    rig.run(3.0)
    own = rig.all("DISTANCE_SENSOR", 1.0, source=(1, 158))
    echo = [m for m in rig.all("DISTANCE_SENSOR", 1.0) if m.id == 1]
    assert {(m.id, m.orientation, m.current_distance) for m in own} == {(7, 0, 8000)}
    assert {m.current_distance for m in echo} == {8000}
    assert len(own) == pytest.approx(20, abs=1)
    assert rig.all("HEARTBEAT", source=(1, 158))


# -- forwarding --------------------------------------------------------------------------------------------------


def test_heartbeats_cross() -> None:
    rig = Rig()
    station = Station(rig)
    rig.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    rig.run(0.1)
    station.listen()
    assert [m.type for m in station.heard if m.get_srcComponent() == 191] == [18]
    assert [m.type for m in rig.all("HEARTBEAT", source=(255, 190))] == [6]


def test_messages_for_somebody_else_go_only_where_he_was_heard() -> None:
    rig = Rig()
    station = Station(rig)
    rig.run(0.1)
    rig.send(mavlink.MAVLink_command_long_message(255, 190, 31010, 0, *([0.0] * 7)))
    rig.send(mavlink.MAVLink_command_long_message(99, 1, 31011, 0, *([0.0] * 7)))
    rig.send(mavlink.MAVLink_statustext_message(6, b"hello"))
    rig.run(0.1)
    station.listen()
    from_companion = [m for m in station.heard if m.get_srcComponent() == 191]
    assert [m.command for m in from_companion if m.get_type() == "COMMAND_LONG"] == [31010]
    assert [m.text for m in from_companion if m.get_type() == "STATUSTEXT"] == ["hello"]


def test_the_gcs_link_is_quiet_until_somebody_speaks() -> None:
    stub = Stub(StubConfig())
    stub.advance(3.0)
    ids = {wire.msgid_of(raw) for d in stub.take("gcs") for raw in wire.Splitter().feed(d)}
    assert ids == {0}


# -- section 11: intervals, requests, versions ---------------------------------------------------------------------


@pytest.mark.parametrize(("msgid", "hz"), [(30, 50), (32, 50), (83, 20), (132, 50)])
def test_set_message_interval(msgid: int, hz: float) -> None:
    rig = Rig(streams=ALL)
    assert rig.command(511, msgid, 1e6 / hz) == [0]
    rig.heard.clear()
    rig.run(4.0)
    kind = mavlink.mavlink_map[msgid].msgname
    assert len(rig.all(kind)) / 4.0 == pytest.approx(hz, rel=0.05)


def test_a_stream_is_switched_off_and_back_to_its_default() -> None:
    rig = Rig(streams=(331,))
    assert rig.command(511, 331, -1) == [0]
    rig.heard.clear()
    rig.run(1.0)
    assert rig.all("ODOMETRY") == []
    assert rig.command(511, 331, 0) == [0]
    rig.run(2.0)
    assert len(rig.all("ODOMETRY")) == pytest.approx(60, abs=4)


@pytest.mark.parametrize("msgid", [0, 9999])
def test_intervals_that_cannot_be_set(msgid: int) -> None:
    assert Rig().command(511, msgid, 100000) == [4]


def test_get_message_interval() -> None:
    rig = Rig()
    rig.command(511, 74, 200000)
    rig.command(510, 74)
    assert rig.all("MESSAGE_INTERVAL")[-1].interval_us == 200000


@pytest.mark.parametrize(("command", "params"), [(512, (148,)), (520, (1,))])
def test_autopilot_version(command: int, params: tuple[float, ...]) -> None:
    rig = Rig()
    assert rig.command(command, *params) == [0]
    version = rig.all("AUTOPILOT_VERSION")[-1]
    assert (version.capabilities, version.flight_sw_version) == (59647, 0x011000FF)


def test_home_modes_and_unknown_requests() -> None:
    rig = Rig()
    assert rig.command(410) == [0]
    assert rig.all("HOME_POSITION")
    assert rig.command(512, 435, 0) == [0]
    modes = rig.all("AVAILABLE_MODES")
    assert [m.mode_index for m in modes] == list(range(1, modes[0].number_modes + 1))
    assert {(m.mode_name, m.custom_mode) for m in modes} >= {("Offboard", 0x00060000), ("Hold", 0x03040000)}
    assert rig.command(512, 397) == [3]
    assert rig.command(31999) == [3]


def test_ping_is_answered_to_its_sender() -> None:
    rig = Rig()
    rig.send(mavlink.MAVLink_ping_message(99, 12, 0, 0))
    rig.run(0.02)
    answer = [m for m in rig.all("PING") if m.target_system]
    assert [(m.time_usec, m.seq, m.target_system, m.target_component) for m in answer] == [(99, 12, 1, 191)]


def test_file_transfer_is_refused_at_once() -> None:
    rig = Rig()
    payload = bytearray(251)
    payload[0:2] = struct.pack("<H", 41)
    payload[3] = 4
    rig.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload)))
    rig.run(0.02)
    answer = rig.all("FILE_TRANSFER_PROTOCOL")[-1].payload
    assert (answer[0], answer[3], answer[5]) == (42, 129, 4)


# -- parameters and missions ---------------------------------------------------------------------------------------


def test_the_whole_parameter_list() -> None:
    rig = Rig()
    rig.send(mavlink.MAVLink_param_request_list_message(1, 1))
    rig.run(0.1)
    values = rig.all("PARAM_VALUE")
    assert [m.param_index for m in values] == list(range(values[0].param_count))
    assert [m.param_id for m in values] == sorted(m.param_id for m in values)
    rig.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 3))
    rig.run(0.1)
    assert rig.all("PARAM_VALUE")[-1].param_id == values[3].param_id


def test_missions_are_kept_and_returned() -> None:
    rig = Rig()
    items = [
        mavlink.MAVLink_mission_item_int_message(1, 1, i, 6, 16, 0, 1, 0, 0, 0, HERE, 473977 + i, 85455 - i, 20.0 + i)
        for i in range(3)
    ]
    rig.send(mavlink.MAVLink_mission_count_message(1, 1, 3))
    for item in items:
        rig.run(0.02)
        assert rig.all("MISSION_REQUEST_INT")[-1].seq == item.seq
        rig.send(item)
    rig.run(0.02)
    assert rig.all("MISSION_ACK")[-1].type == 0
    rig.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    rig.run(0.02)
    assert rig.all("MISSION_COUNT")[-1].count == 3
    rig.send(mavlink.MAVLink_mission_request_int_message(1, 1, 2))
    rig.run(0.02)
    back = rig.all("MISSION_ITEM_INT")[-1]
    assert (back.seq, back.command, back.x, back.y, back.z) == (2, 16, 473979, 85453, 22.0)
    rig.send(mavlink.MAVLink_mission_clear_all_message(1, 1))
    rig.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    rig.run(0.02)
    assert rig.all("MISSION_COUNT")[-1].count == 0


# -- MAVLink 1, signing, rubbish -----------------------------------------------------------------------------------


def test_mavlink_1_until_the_peer_speaks_2() -> None:
    from pymavlink.dialects.v10 import all as v1

    stub = Stub(StubConfig(mavlink_version=1, radio=False))
    stub.advance(2.0)
    parser = v1.MAVLink(None)
    first = b"".join(stub.take("offboard"))
    kinds = {m.get_type() for m in parser.parse_buffer(first)}
    assert set(first[:1]) == {0xFE}
    assert {"HEARTBEAT", "ATTITUDE", "DISTANCE_SENSOR", "LOCAL_POSITION_NED"} <= kinds
    stub.receive("offboard", v1.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(v1.MAVLink(None, 1, 191)))
    stub.advance(2.5)
    assert stub.take("offboard")[0][0] == 0xFE
    modern = mavlink.MAVLink(None, 1, 191)
    stub.receive("offboard", mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(modern))
    stub.advance(3.0)
    assert stub.take("offboard")[0][0] == 0xFD


KEY = hashlib.sha256(b"a secret").digest()


def signed_rig(key: bytes, unix_s: float = 1_767_225_600, **fields: Any) -> Rig:
    rig = flying(signing_key=KEY, **fields)
    if key:
        rig.mav.signing.secret_key = key
        rig.mav.signing.sign_outgoing = True
        rig.mav.signing.timestamp = int((unix_s - 1_420_070_400) * 100_000)
    rig.mav.signing.allow_unsigned_callback = None
    return rig


@pytest.mark.parametrize(
    ("key", "acks"),
    [(KEY, [0, 0]), (b"", []), (hashlib.sha256(b"another").digest(), [])],
    ids=["right", "none", "wrong"],
)
def test_only_frames_signed_with_the_key_are_taken(key: bytes, acks: list[int]) -> None:
    rig = signed_rig(key)
    rig.send(rig.local())
    rig.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0))
    rig.mav.signing.secret_key = None  # to read the answers whatever the key
    rig.run(0.1)
    assert rig.acks(176) == acks


def test_pymavlink_accepts_our_signatures() -> None:
    rig = signed_rig(KEY)
    rig.heard.clear()
    rig.run(2.0)
    assert rig.all("HEARTBEAT")
    assert not [m for _, m in rig.heard if m.get_type() == "BAD_DATA"]


@pytest.mark.parametrize(("starts_s", "taken"), [(1_900_000_000.0, True), (None, False)])
def test_a_peer_on_another_day_takes_only_a_vehicle_of_that_day(starts_s: float | None, taken: bool) -> None:
    """pymavlink refuses new streams that are more than a minute behind its own clock."""
    rig = signed_rig(KEY, 1_900_000_000.0, unix_start_s=starts_s)
    rig.run(2.0)
    assert bool(rig.all("HEARTBEAT")) is taken


def test_the_time_of_day_goes_on_across_a_reboot() -> None:
    rig = Rig(unix_start_s=1_900_000_000.0, faults=("5 reboot",))
    rig.run(12.0)
    stamps = [(t, m) for t, m in rig.heard if m.get_type() == "SYSTEM_TIME"]
    assert min(m.time_boot_ms for t, m in stamps if t > 5.0) < 1100
    assert {round(m.time_unix_usec * 1e-6 - t - 1_900_000_000.0, 3) for t, m in stamps} == {0.0}


def test_a_signed_frame_played_again_is_refused() -> None:
    rig = signed_rig(KEY)
    frame = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, *([0.0] * 6)).pack(rig.mav)
    for _ in range(2):
        rig.stub.receive("offboard", frame)
    rig.run(0.1)
    assert rig.acks(400) == [0]


@pytest.mark.parametrize("cut", [1, 3, 7])
def test_bytes_come_in_any_pieces_with_rubbish_between(cut: int) -> None:
    rig = Rig()
    rig.run(1.5)
    frame = b"\x00\xfd\x05noise" + mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, *([0.0] * 6)).pack(rig.mav)
    for at in range(0, len(frame), cut):
        rig.stub.receive("offboard", frame[at : at + cut])
    rig.stub.receive("offboard", bytes(300))
    rig.run(0.1)
    assert rig.acks(400) == [0]


# -- other carriers of ranges --------------------------------------------------------------------------------------


def test_ranging_beacon() -> None:
    rig = Rig(radio=True, range_message="ranging_beacon", range_beacon_id=12, beacon_east_m=40.0, range_sigma_m=0.0)
    rig.run(1.0)
    found = rig.all("RANGING_BEACON", source=(1, 158))
    assert {(m.beacon_id, m.range) for m in found} == {(12, 40000)}
    assert [m.sequence for m in found] == list(range(1, len(found) + 1))


def test_landing_target() -> None:
    rig = Rig(radio=True, range_message="landing_target", range_beacon_id=3, beacon_north_m=25.5, range_sigma_m=0.0)
    rig.run(1.0)
    found = rig.all("LANDING_TARGET", source=(1, 158))
    assert {(m.target_num, round(m.distance, 3)) for m in found} == {(3, 25.5)}


def test_an_endpoint_of_its_own() -> None:
    rig = Rig(radio=True, range_link="ranging", beacon_east_m=40.0)
    rig.run(1.0)
    assert rig.all("DISTANCE_SENSOR", source=(1, 158)) == []
    own = [m for d in rig.stub.take("ranging") for m in mavlink.MAVLink(None).parse_buffer(d)]
    assert {m.get_type() for m in own} == {"DISTANCE_SENSOR", "HEARTBEAT"}


def test_a_devices_own_bytes() -> None:
    rig = Rig(radio=True, device="lightware", beacon_east_m=40.0, range_sigma_m=0.0)
    rig.run(1.0)
    assert rig.all("DISTANCE_SENSOR", source=(1, 158)) == []
    assert set(rig.stub.take("device")) == {b"40.00\r\n"}


# -- the radio's errors --------------------------------------------------------------------------------------------


def test_noise_bias_and_outliers_are_what_was_asked_for() -> None:
    rig = Rig(
        radio=True, beacon_east_m=100.0, range_sigma_m=0.3, range_bias_m=1.0, outlier_share=0.2, outlier_mean_m=8.0,
        range_rate_hz=50.0, step_s=0.02, streams=(),
    )  # fmt: skip
    rig.stub.links["offboard"].set_interval(30, 0, 0)
    rig.run(60.0, dt_s=1.0)
    errors = [m.current_distance / 100.0 - 100.0 for m in rig.all("DISTANCE_SENSOR", source=(1, 158))]
    usual = [e for e in errors if abs(e - 1.0) < 1.0]
    mean = sum(usual) / len(usual)
    assert mean == pytest.approx(1.0, abs=0.05)
    assert (sum((e - mean) ** 2 for e in usual) / len(usual)) ** 0.5 == pytest.approx(0.3, rel=0.1)
    far = [e for e in errors if e > 2.2]
    assert len(far) / len(errors) == pytest.approx(0.2 * 2.718 ** (-1.2 / 8.0), abs=0.03)


def test_dropouts_latency_and_reach() -> None:
    dropped = Rig(radio=True, beacon_east_m=50.0, range_dropouts_s=((1.0, 2.0),), range_latency_s=0.25)
    dropped.run(4.0)
    found = [(t, m) for t, m in dropped.heard if m.get_type() == "DISTANCE_SENSOR" and m.get_srcComponent() == 158]
    assert not [m for _, m in found if 1000 <= m.time_boot_ms < 2000]
    assert {round(t - m.time_boot_ms / 1000.0, 2) for t, m in found} == {0.25}
    far = Rig(radio=True, beacon_east_m=700.0)
    far.run(2.0)
    assert far.all("DISTANCE_SENSOR", source=(1, 158)) == []


def test_the_beacon_moves() -> None:
    rig = Rig(radio=True, beacon_east_m=50.0, beacon_east_m_s=2.0, range_sigma_m=0.0)
    rig.run(10.0)
    last = rig.all("DISTANCE_SENSOR", source=(1, 158))[-1]
    assert last.current_distance == pytest.approx(100 * (50.0 + 2.0 * last.time_boot_ms / 1000.0), abs=2)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"airframe": "rover"}, "airframe 'rover'"),
        ({"params": {"NOPE": 1.0}}, "no parameter 'NOPE'"),
        ({"system_id": 0}, "system_id 0"),
        ({"outlier_share": 2.0}, "outlier_share"),
        ({"device": "sonar"}, "device 'sonar'"),
        ({"faults": ("5 nonsense",)}, "no kind 'nonsense'"),
    ],
)
def test_a_wrong_config_says_what_is_wrong(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        Stub(StubConfig(**fields))
    assert words in str(caught.value)
