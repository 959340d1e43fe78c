"""What each decoder makes of the corners of its device's format."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.ranging import SOURCES, ByteReceiver, ByteSource, Settings, open_receiver, replay
from circumnav_mav.ranging.plug import Reading
from circumnav_mav.types import RangeSample, Rejected
from sitl_stub.devices import LINKTRACK_ANCHOR, LINKTRACK_TAG, Node, UsD1, linktrack_node_frame2, linktrack_node_frame3
from tests.ranging.golden import GOLDENS

SAMPLES = {golden.name: golden.data for golden in GOLDENS}


def decode(source, data, now_s=5.0, **options):
    found = SOURCES[source]
    assert isinstance(found, ByteSource)
    return found.decoder(options).feed(data.encode() if isinstance(data, str) else data, now_s)


def receive(source, data, now_s=5.0, options=None, **settings):
    receiver = open_receiver(source, Settings(options=options or {}, **settings))
    assert isinstance(receiver, ByteReceiver)
    return receiver.feed(data.encode() if isinstance(data, str) else data, now_s)


def outcome(results):
    """Ranges of readings and reasons of rejections, in order."""
    return [r.range_m if isinstance(r, Reading | RangeSample) else str(r.reason) for r in results]


class TestLinkTrack:
    def test_a_wrong_checksum_is_no_reading(self):
        frame = SAMPLES["linktrack_nodeframe3"]
        for wrong in (frame[:-1] + bytes((frame[-1] ^ 1,)), frame[:24] + b"\x23" + frame[25:]):
            results = decode("linktrack", wrong + frame)
            assert outcome(results) == ["bad_frame", 2.85, 6.051, 7.304, 5.35]
            assert results[0].detail == "50 bytes that belong to no frame"

    def test_another_nlink_frame_is_passed_over(self):
        # NodeFrame0, from the vendor's nlink_unpack, example.c.
        other = bytes.fromhex(
            "5502420001 00d12cc3880202000900112233445566778899020225001112232232443454556567766787"
            "7799aaa2134557655656565657784333344444444446760d"
        )
        assert outcome(decode("linktrack", other + SAMPLES["linktrack_nodeframe3"]))[1:] == [2.85, 6.051, 7.304, 5.35]

    def test_a_negative_or_missing_distance_is_not_flown_on(self):
        nodes = [Node(LINKTRACK_ANCHOR, 1, -1500), Node(LINKTRACK_ANCHOR, 2, 0)]
        frame = linktrack_node_frame3(LINKTRACK_TAG, 0, 1000, 1000, 5000, nodes)
        assert outcome(receive("linktrack", frame)) == ["out_of_range", "no_reading"]

    def test_a_weak_first_path_is_no_line_of_sight_where_that_is_asked_for(self):
        nodes = [Node(LINKTRACK_ANCHOR, 1, 1500, 180, 160), Node(LINKTRACK_ANCHOR, 2, 2500, 181, 160)]
        frame = linktrack_node_frame3(LINKTRACK_TAG, 0, 1000, 1000, 5000, nodes)
        assert outcome(decode("linktrack", frame)) == [1.5, 2.5]
        assert outcome(decode("linktrack", frame, max_path_gap_db=10.0)) == [1.5, "invalid_quality"]

    def test_the_time_of_the_range_itself_is_used_and_the_frames_where_there_is_none(self):
        nodes = [Node(LINKTRACK_ANCHOR, 1, 1500, system_time_ms=980), Node(LINKTRACK_ANCHOR, 2, 2500)]
        frame = linktrack_node_frame2(LINKTRACK_TAG, 0, 700, 1000, 5000, nodes)
        assert [r.stamp_s for r in decode("linktrack", frame) if isinstance(r, Reading)] == pytest.approx([0.98, 0.7])

    def test_an_anchor_and_a_tag_of_one_id_are_two(self):
        nodes = [Node(LINKTRACK_ANCHOR, 3, 1500), Node(LINKTRACK_TAG, 3, 9000)]
        frame = linktrack_node_frame3(LINKTRACK_TAG, 0, 1000, 1000, 5000, nodes)
        assert outcome(receive("linktrack", frame, beacon_id=3)) == [1.5, "wrong_sensor"]
        assert outcome(receive("linktrack", frame, beacon_id=3, sensor_id=2)) == ["wrong_sensor", 9.0]

    def test_one_beacon_of_several(self):
        results = receive("linktrack", SAMPLES["linktrack_nodeframe2"], beacon_id=2)
        assert outcome(results) == ["wrong_beacon", "wrong_beacon", 6.728, "wrong_beacon"]


class TestDwm1001:
    def test_the_shell_around_the_lines_is_passed_over(self):
        data = "dwm> les\r\n0CA8[0.00,8.00,2.25]=6.51 le_us=2576\r\n\r\ndwm> \r\n"
        assert outcome(decode("dwm1001_les", data)) == [6.51]

    def test_a_damaged_word_costs_only_itself(self):
        data = "1151[5.00,8.00,2.25]=6.480CA8[0.00,8.00,2.25]=6.51 111C[5.00,0.00,2.25]=3.18 0C\xa8[0,0,0]=6.51\r\n"
        assert outcome(decode("dwm1001_les", data)) == ["bad_frame", 3.18, "bad_frame"]

    def test_a_range_cut_short_is_no_range(self):
        assert (
            outcome(decode("dwm1001_les", "1151[5.00,8.00,2.25]=6.4\r\n1151[5.00,8.00,2.25]=6\r\n"))
            == ["bad_frame"] * 2
        )


class TestLightWare:
    def test_ways_to_say_lost(self):
        assert outcome(decode("lightware", "130.00\r\n-1.00\r\n--.-- m\r\n")) == ["no_reading"] * 3

    def test_the_unit_may_follow_with_a_space_or_without(self):
        lines = ("98.67", "98.68 m", "98.69m", "--.--m", "-1.00m", "98.67mm", "98.67ft")
        wanted = [98.67, 98.68, 98.69, "no_reading", "no_reading", "bad_frame", "bad_frame"]
        assert outcome(decode("lightware", "\r\n".join(lines) + "\r\n")) == wanted

    def test_another_value_may_stand_for_lost(self):
        assert outcome(decode("lightware", "130.00\r\n16000.00\r\n99.00\r\n", lost_m=99.0)) == [
            130.0,
            "bad_frame",
            "no_reading",
        ]

    def test_lines_that_are_no_distance(self):
        assert outcome(decode("lightware", "?OA 1.567\r\n98,67\r\n9e1\r\n")) == ["bad_frame"] * 3

    @pytest.mark.parametrize("value", ["far", True, math.nan])
    def test_a_bad_option_is_said(self, value):
        with pytest.raises(ValueError, match=r"ranging\.lost_m"):
            open_receiver("lightware", Settings(options={"lost_m": value}))


CM = (0, 1, 65534, 65535)


class TestUsD1:
    def test_a_wrong_checksum_or_version_is_no_reading(self):
        good = UsD1().encode(12.34, 0.0, 0.0)
        assert outcome(decode("us_d1", good[:-1] + b"\x00" + good)) == ["bad_frame", 12.34]
        old = b"\xfe\x00\xd2\x04\x1e\xf4"
        assert outcome(decode("us_d1", old + good)) == ["bad_frame", 12.34]

    def test_a_head_inside_a_packet_is_no_trouble(self):
        data = UsD1(snr=0xFE).encode(0xFEFE * 0.01, 0.0, 0.0)
        assert data.count(b"\xfe") == 4
        assert outcome(decode("us_d1", data * 3)) == pytest.approx([0xFEFE * 0.01] * 3)

    @pytest.mark.parametrize("snr", [0, 30, 255])
    def test_a_field_that_is_empty_or_full_is_no_range(self, snr):
        frames = [bytes((0xFE, 2, cm & 0xFF, cm >> 8, snr, (2 + (cm & 0xFF) + (cm >> 8) + snr) & 0xFF)) for cm in CM]
        assert outcome(decode("us_d1", b"".join(frames))) == ["no_reading", 0.01, 655.34, "no_reading"]

    def test_a_weak_echo_is_rejected_where_that_is_asked_for(self):
        data = UsD1(snr=9).encode(12.34, 0.0, 0.0)
        assert outcome(decode("us_d1", data, min_snr=10)) == ["invalid_quality"]
        assert outcome(decode("us_d1", data, min_snr=9)) == [12.34]


class TestOmniPreSense:
    @pytest.mark.parametrize(
        ("speed", "rate_m_s"),
        [
            ('"speed":2.5, "direction":"inbound"', -2.5),
            ('"speed":2.5, "direction":"outbound"', 2.5),
            ('"speed":-2.5, "direction":"outbound"', 2.5),
            ('"speed":2.5', -2.5),
            ('"speed":-2.5', 2.5),
            ('"speed":"2.5"', -2.5),
            ('"speed":[2.5, 1.0]', -2.5),
            ('"unit":"mps", "speed":2.5', -2.5),
            ('"unit":"kmph", "speed":9.0', -2.5),
            ('"unit":"cmps", "speed":250', -2.5),
            ('"unit":"mph", "speed":10', -4.4704),
            ('"unit":"fps", "speed":10', -3.048),
        ],
    )
    def test_the_sign_and_unit_of_speed(self, speed, rate_m_s):
        (reading,) = decode("omnipresense", f'{{{speed}}}\r\n{{"range":6.3}}\r\n')
        assert reading.range_rate_m_s == pytest.approx(rate_m_s)

    @pytest.mark.parametrize(
        ("unit", "range_m"), [("m", 7.5), ("cm", 0.075), ("ft", 2.286), ("in", 0.1905), ("yd", 6.858)]
    )
    def test_the_unit_of_range(self, unit, range_m):
        (reading,) = decode("omnipresense", f'{{"unit":"{unit}", "range":["7.5", "9.9"]}}\r\n')
        assert reading.range_m == pytest.approx(range_m)
        assert math.isnan(reading.range_rate_m_s)

    def test_an_old_speed_is_not_a_ranges_own(self):
        source = SOURCES["omnipresense"]
        assert isinstance(source, ByteSource)
        decoder = source.decoder({})
        assert decoder.feed(b'{"speed":2.5}\r\n', 5.0) == []
        (near,) = decoder.feed(b'{"range":6.3}\r\n', 5.2)
        (late,) = decoder.feed(b'{"range":6.3}\r\n', 5.3)
        assert isinstance(near, Reading) and near.range_rate_m_s == -2.5
        assert isinstance(late, Reading) and math.isnan(late.range_rate_m_s)

    @pytest.mark.parametrize(
        ("time", "stamp_s"),
        [('"time":105', math.nan), ('"time":105, "tick":7', 105.007), ('"time":"105.25"', 105.25), ('"time":1.5', 1.5)],
    )
    def test_whole_seconds_alone_are_no_stamp(self, time, stamp_s):
        (reading,) = decode("omnipresense", f'{{{time}, "range":6.3}}\r\n')
        assert reading.stamp_s == pytest.approx(stamp_s, nan_ok=True)

    def test_answers_to_commands_are_passed_over(self):
        assert decode("omnipresense", '{"Product":"OPS243"}\r\n{"Units":"m-per-sec"}\r\n') == []

    @pytest.mark.parametrize(
        "line",
        [
            '{"range":"far"}',
            '{"range":[]}',
            '{"range":NaN}',
            '{"range":1e999}',
            '{"range":true}',
            '{"range":6.3',
            "6.3",
            "[1]",
            '{"unit":"parsec", "range":6.3}',
            '{"unit":["m"], "range":6.3}',
            '{"speed":null}',
            '{"range":6.3, "tick":{}}',
        ],
    )
    def test_what_is_no_report_is_a_bad_frame(self, line):
        assert outcome(decode("omnipresense", line + "\r\n")) == ["bad_frame"]


class TestLines:
    PATTERN = r"D=(?P<range>[-+0-9.eE]+)(?: v=(?P<rate>\S+))?(?: #(?P<beacon_id>\w+))?"

    def test_units_and_fields_that_may_be_missing(self):
        data = "x D=1250 v=-300 #1F\nD=900\n"
        one, two = decode("lines", data, pattern=self.PATTERN, range_unit="cm", rate_unit="mm/s", id_base=16)
        assert (one.range_m, one.range_rate_m_s, one.beacon_id) == pytest.approx((12.5, -0.3, 31))
        assert two.range_m == pytest.approx(9.0)
        assert math.isnan(two.range_rate_m_s) and two.beacon_id is None

    def test_a_range_without_an_id_is_not_the_beacon_that_is_wanted(self):
        options = {"pattern": self.PATTERN}
        assert outcome(receive("lines", "D=9\nD=12.5 #31\nD=13 #4\n", options=options, beacon_id=31)) == [
            "wrong_beacon",  # flown on, it would lock out the one that comes next
            12.5,
            "wrong_beacon",
        ]
        assert outcome(receive("lines", "D=9\n", options=options)) == [9.0]
        nameless = receive("omnipresense", '{"unit":"m", "range":1.2}\r\n', beacon_id=31)
        assert outcome(nameless) == [1.2]  # the source has no ids, and `check` says that the key does nothing

    def test_lines_to_ignore_and_lines_not_understood(self):
        data = "boot v1.2\nhello\nD=12.0\nD=e\nD=12.0 #zz\n"
        results = decode("lines", data, pattern=self.PATTERN, ignore="^boot")
        assert outcome(results) == ["bad_frame", 12.0, "bad_frame", "bad_frame"]
        assert "'hello'" in results[0].detail

    @pytest.mark.parametrize(
        ("written", "base", "wanted"), [("3", 10, 3), ("3.0", 10, 3), ('"3"', 10, 3), ("11.0", 16, 17)]
    )
    def test_a_whole_number_is_an_id_however_json_writes_it(self, written, base, wanted):
        line = f'{{"r": 5.5, "id": {written}}}\n'
        (reading,) = decode("lines", line, json={"range": "r", "beacon_id": "id"}, id_base=base)
        assert (reading.range_m, reading.beacon_id) == (5.5, wanted)

    @pytest.mark.parametrize("written", ["3.5", '"3.0"', "Infinity", "NaN", "[3]"])
    def test_what_is_no_whole_number_is_no_id(self, written):
        line = f'{{"r": 5.5, "id": {written}}}\n'
        assert outcome(decode("lines", line, json={"range": "r", "beacon_id": "id"})) == ["bad_frame"]

    @pytest.mark.parametrize(
        "line", ["{}", '{"a": []}', '{"a": [{"d": null}]}', "[]", "7", "nonsense", '{"a": [{"d": [1]}]}']
    )
    def test_json_without_the_range_is_a_bad_frame(self, line):
        assert outcome(decode("lines", line + "\n", json={"range": "a.0.d"})) == ["bad_frame"]

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({}, "either a pattern or json"),
            ({"pattern": "(?P<range>.)", "json": {"range": "r"}}, "not both"),
            ({"pattern": "("}, "no regular expression"),
            ({"pattern": "(?P<distance>.)"}, "names distance; the fields are range"),
            ({"pattern": "(?P<rate>.)"}, "where the range is"),
            ({"json": {"rate": "r"}}, "where the range is"),
            ({"json": ["r"]}, "map fields to paths"),
            ({"json": {"range": 0}}, "map fields to paths"),
            ({"json": {"range": "data..d"}}, "the path 'data..d' has an empty step"),
            ({"json": {"range": "d."}}, "the path 'd.' has an empty step"),
            ({"json": {"range": "r", 3: "x"}}, "names 3; the fields are range"),
            ({"pattern": "(?P<range>.)", "range_unit": "feet"}, "must be one of m, dm"),
            ({"pattern": "(?P<range>.)", "rate_unit": 3}, "must be one of m/s"),
            ({"pattern": "(?P<range>.)", "time_unit": "min"}, "must be one of s, ms, us"),
            ({"pattern": "(?P<range>.)", "id_base": 37}, "at most 36"),
            ({"pattern": "(?P<range>.)", "id_base": 2.5}, "id_base is 2.5, but must be a whole number"),
            ({"pattern": "(?P<range>.)", "ignore": "*"}, "no regular expression"),
            ({"pattern": "(?P<range>.)", "range_units": "m"}, "did you mean range_unit"),
        ],
    )
    def test_bad_options_are_said_in_words(self, options, words):
        with pytest.raises(ValueError, match=words):
            open_receiver("lines", Settings(options=options))


class TestReplay:
    SAMPLES = (
        RangeSample(10.000000000000002, 123.4567890123, -2.5, 0.3, 4),
        RangeSample(10.1, 120.0),
        RangeSample(10.2, 119.0, sigma_m=0.5),
        RangeSample(12.0, 118.0, -1e-9, beacon_id=0),
    )

    def test_what_row_writes_is_read_to_the_last_bit(self):
        text = "\n".join([replay.HEADER, *map(replay.row, self.SAMPLES)]) + "\n"
        for reading, sample in zip(decode("replay", text), self.SAMPLES, strict=True):
            assert (reading.stamp_s, reading.range_m, reading.beacon_id) == (
                sample.t_s,
                sample.range_m,
                sample.beacon_id,
            )
            assert repr((reading.range_rate_m_s, reading.sigma_m)) == repr((sample.range_rate_m_s, sample.sigma_m))

    def test_each_line_is_due_at_its_own_time_and_none_before_the_one_above_it(self):
        text = "# recorded\n100.0,50\nnonsense\n100.5,49\n100.2,48\n101.0,47\n"
        due = replay.read(text).due
        assert [at_s for at_s, _ in due] == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.5, 1.0])
        assert b"".join(line for _, line in due) == text.encode()

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "it holds no ranges; a line is t_s,range_m,"),
            ("\ufeff# recorded\nt_s,range_m\n\n  \n", "it holds no ranges; a line is"),
            ("time;range\n1;2\n", "it holds no ranges; line 1 is no range (nor is 1 more): 'time;range'; a line is"),
            ("t_s,range_m\n1,80\n\nabc\n2,81\n3\n4,\n", "line 4 is no range (nor are 2 more): 'abc'; a line is"),
            ("1,80\n2,81,,,7\n", ""),
        ],
    )
    def test_a_file_that_is_no_recording_is_said(self, text, words):
        complaint = replay.read(text).complaint()
        assert complaint.startswith(words) and bool(complaint) is bool(words)
        assert "\n" not in complaint

    def test_the_form_that_people_are_told_is_one_that_is_read(self):
        assert replay.read(replay.FORM.rsplit(" ", 1)[1]).ranges == 1

    def test_a_replay_at_its_pace_is_dated_as_recorded(self):
        receiver = open_receiver("replay", Settings())
        assert isinstance(receiver, ByteReceiver)
        text = "".join(f"{500 + 0.1 * n:.1f},{100 - n}\n" for n in range(50))
        samples = [r for at_s, line in replay.read(text).due for r in receiver.feed(line, 7.0 + at_s)]
        assert [s.t_s for s in samples] == pytest.approx([7.0 + 0.1 * n for n in range(50)], abs=1e-6)
        assert receiver.counts.rejected == {}

    @pytest.mark.parametrize("line", ["10.0", "10.0,", ",5", "10.0,far", "1,2,3,4,5,6", "1,2,,,x", "nan,5", "1,inf"])
    def test_what_is_no_row_is_a_bad_frame(self, line):
        assert outcome(decode("replay", line + "\n")) == ["bad_frame"]


def test_a_fixed_latency_is_taken_off_stamped_ranges_too():
    receiver = open_receiver("replay", Settings(latency_s=0.2))
    assert isinstance(receiver, ByteReceiver)
    (sample,) = receiver.feed(b"100.0,50\n", 7.0)
    assert isinstance(sample, RangeSample) and sample.t_s == pytest.approx(6.8)
    (late,) = receiver.feed(b"100.1,50\n", 7.4)
    assert isinstance(late, RangeSample) and late.t_s == pytest.approx(6.9)


def test_stamps_can_be_left_aside():
    receiver = open_receiver("replay", Settings(use_stamps=False))
    assert isinstance(receiver, ByteReceiver)
    receiver.feed(b"100.0,50\n", 7.0)
    (late,) = receiver.feed(b"100.1,50\n", 7.4)
    assert isinstance(late, RangeSample) and late.t_s == 7.4


def test_an_endless_line_is_one_bad_frame():
    source = SOURCES["lightware"]
    assert isinstance(source, ByteSource)
    decoder = source.decoder({})
    assert [r for _ in range(100) for r in decoder.feed(b"9" * 100, 5.0)] == []
    results = decoder.feed(b"\r\n98.67\r\n", 5.0)
    assert isinstance(results[0], Rejected)
    assert outcome(results) == ["bad_frame", 98.67]


@pytest.mark.parametrize("rate", [0.95, 0.98, 1.05])
def test_a_device_with_a_slow_or_fast_clock_is_never_stale(rate):
    receiver = open_receiver("replay", Settings())
    assert isinstance(receiver, ByteReceiver)
    for n in range(1200):
        receiver.feed(f"{500 + rate * 0.1 * n:.4f},{100 - 0.05 * n:.3f}\n".encode(), 7.0 + 0.1 * n)
    assert receiver.counts.rejected == {}
    assert bool(receiver.clock_words) == (rate < 1.0)


def test_a_clock_that_lost_time_costs_ranges_for_two_seconds_and_is_said():
    receiver = open_receiver("replay", Settings())
    assert isinstance(receiver, ByteReceiver)
    for n in range(600):
        paused_s = 1.5 if n >= 300 else 0.0
        receiver.feed(f"{500 + 0.1 * n:.1f},{100 - 0.05 * n:.3f}\n".encode(), 7.0 + 0.1 * n + paused_s)
    assert set(receiver.counts.rejected) == {"stale"} and receiver.counts.rejected["stale"] <= 20
    assert "lost 1.50 s" in receiver.clock_words


@pytest.mark.parametrize(
    ("source", "line", "options"),
    [
        ("lines", "D=1e30", {"pattern": "D=(?P<range>[0-9.e+]+)"}),
        ("lines", "D=100001", {"pattern": "D=(?P<range>[0-9.e+]+)"}),
        ("lines", '{"d": 12.0, "v": 1e30}', {"json": {"range": "d", "rate": "v"}}),
        ("lines", '{"d": 12.0, "s": 1e200}', {"json": {"range": "d", "sigma": "s"}}),  # squared it is no number
        ("replay", "0.0,1e30,,,", {}),
    ],
)
def test_a_finite_number_that_is_no_measurement_is_turned_away(source, line, options):
    assert outcome(receive(source, line + "\r\n", options=options)) == ["out_of_range"]
