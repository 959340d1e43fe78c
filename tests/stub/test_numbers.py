"""Bad numbers end before the flight in one clear line; whatever is let in flies. Faults that overlap end one by one."""

from __future__ import annotations

import math
import os
import random
import shlex
import struct
import subprocess
import sys
from dataclasses import fields
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig
from sitl_stub.__main__ import main
from sitl_stub.combinations import given, idle
from sitl_stub.config import BOUNDS
from sitl_stub.faults import FAULTS, parse
from sitl_stub.modes import Mode
from sitl_stub.options import parser
from sitl_stub.params import INT32, REAL32, Parameters
from tests.stub.rig import OFFBOARD, Rig, flying

SEED, SHARE = int(os.environ.get("SOAK_SEED", "1")), float(os.environ.get("SOAK_SHARE", "1"))
NAN, INF = math.nan, math.inf


# -- StubConfig ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BOUNDS)
def test_every_number_has_bounds_that_hold(name: str) -> None:
    least, most = BOUNDS[name]
    for wrong in (NAN, INF, -INF, least - 1.0, most * 2.0 + 1.0, "3", None, True):
        if wrong is None and name in ("range_sysid", "unix_start_s"):
            continue
        with pytest.raises(ValueError, match=name) as caught:
            StubConfig(**{name: wrong})
        assert "\n" not in str(caught.value)


def test_every_number_is_in_the_table() -> None:
    numbers = {f.name for f in fields(StubConfig) if f.type in ("int", "float", "int | None", "float | None")}
    assert numbers - {"mavlink_version"} == set(BOUNDS)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"wind_east_m_s": NAN}, "wind_east_m_s nan"),
        ({"beacon_north_m": INF}, "beacon_north_m inf"),
        ({"start_speed_m_s": NAN}, "start_speed_m_s nan"),
        ({"start_speed_m_s": -3.0}, "start_speed_m_s -3.0 is not within 0..100"),
        ({"range_max_m": -1.0}, "range_max_m -1.0 is not within 0..1e+09"),
        ({"seed": 1.5}, "seed 1.5 is not a whole number"),
        ({"gps": 1}, "gps 1 is neither True nor False"),
        ({"range_dropouts_s": ((5.0, 4.0),)}, "dropout (5.0, 4.0)"),
        ({"range_dropouts_s": ((NAN, 4.0),)}, "dropout (nan, 4.0)"),
        ({"range_message": "landing_target", "range_beacon_id": 256}, "range_beacon_id 256"),
        ({"device": "linktrack", "range_beacon_id": 256}, "beacon has an id from 0 to 255"),
        ({"signing_key": b"short"}, "signing_key is not 32 bytes"),
        ({"signing_key": bytes(32), "mavlink_version": 1}, "only MAVLink 2 can be signed"),
        ({"range_dropouts_s": 5}, "range_dropouts_s 5 is not a tuple of (from, to)"),
        ({"range_dropouts_s": None}, "range_dropouts_s None is not a tuple of (from, to)"),
        ({"range_dropouts_s": (5,)}, "dropout 5 is not (from, to)"),
        ({"range_dropouts_s": (("a", "b"),)}, "dropout ('a', 'b') is not (from, to)"),
        ({"range_dropouts_s": ("ab",)}, "dropout ab is not (from, to)"),
        ({"faults": "5 reboot"}, "faults is one line"),
        ({"start_speed_m_s": 5.0}, "start_speed_m_s 5.0 is that of an airborne start"),
        ({"device": "linktrack", "radio": False}, "radio=False leaves none on board"),
        ({"device": "linktrack", "range_link": "ranging"}, "range_link 'ranging' is for messages"),
        ({"faults": None}, "faults None is not a tuple of lines"),
        ({"faults": 5}, "faults 5 is not a tuple of lines"),
        ({"faults": (5,)}, "fault 5 is not a line of text"),
        ({"params": 5}, "params 5 is not a mapping"),
        ({"params": None}, "params None is not a mapping"),
        ({"params": {"COM_OF_LOSS_T": -1}}, "parameter COM_OF_LOSS_T cannot be -1: it goes from 0 to 60"),
        ({"params": {"COM_OF_LOSS_T": NAN}}, "parameter COM_OF_LOSS_T cannot be nan"),
        ({"params": {"COM_OBL_RC_ACT": 8}}, "from 0 to 7"),
        ({"params": {"COM_OBL_RC_ACT": 1.5}}, "it is a whole number"),
        ({"params": {"SYS_AUTOSTART": 1e12}}, "SYS_AUTOSTART"),
        ({"params": {"MPC_Z_P": "1"}}, "MPC_Z_P"),
        ({"params": {"FW_R_LIM": 50.0}}, "no parameter 'FW_R_LIM'"),
        ({"faults": ("5 param COM_OF_LOSS_T=-1",)}, "fault '5 param COM_OF_LOSS_T=-1': parameter COM_OF_LOSS_T"),
        ({"faults": ("5 param NO_SUCH=1",)}, "no parameter 'NO_SUCH'"),
    ],
)
def test_a_wrong_config_is_one_line(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        StubConfig(**given)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_all_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(ValueError, match=r"wind_east_m_s nan.*range_max_m -1.*airframe 'rover'"):
        StubConfig(wind_east_m_s=NAN, range_max_m=-1.0, airframe="rover")


@pytest.mark.parametrize("fixed_wing", [False, True])
def test_every_default_parameter_is_within_its_limits(fixed_wing: bool) -> None:
    parameters = Parameters(fixed_wing)
    for name in parameters:
        parameters.check(name, parameters[name])


# -- fault lines ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1-2 delay in -1", "'-1' does not fit 'delay in|out SECONDS': it goes from 0 to 3600"),
        ("1-2 delay out nan", "'nan' does not fit"),
        ("1-2 drop in -0.1", "it goes from 0 to 1"),
        ("5 clock 1e12", "it goes from -1e+06 to 1e+06"),
        ("5 clock inf", "'inf' does not fit"),
        ("5 wind 1e30,0", "of 100 at most"),
        ("5 wind 1", "two numbers with a comma"),
        ("5 beacon nan,0", "two numbers with a comma"),
        ("1-2 range-add 1e300", "it goes from -1e+09"),
        ("1-2 range-value inf", "'inf' does not fit"),
        ("1-2 range-add nan", "'nan' does not fit"),
        ("1-2 range-id -1", "it goes from 0 to 255"),
        ("1-2 foreign 1e2", "'1e2' does not fit"),
        ("nan reboot", "cannot happen at nan"),
        ("inf reboot", "cannot happen at inf"),
        ("nan-5 deaf", "FROM before TO"),
        ("5-nan deaf", "FROM before TO"),
        ("5 param COM_OF_LOSS_T=inf", "a finite number"),
    ],
)
def test_a_wrong_number_in_a_line_is_told(line: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"^fault ") as caught:
        parse(line)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_clock_wraps_as_32_bits_do() -> None:
    rig = Rig(faults=tuple(f"{2 + 0.1 * i:.1f} clock 1e6" for i in range(6)), streams=(30,))
    rig.run(4.0)
    assert rig.all("ATTITUDE")[-1].time_boot_ms == pytest.approx((6_000_000_000 + 4000) % 2**32, abs=50)


# -- fuzz ----------------------------------------------------------------------------------------------------------

ODD = (
    "nan", "inf", "-inf", "0", "-0", "-1", "1", "0.5", "2", "255", "256", "1e-9", "1e6", "-1e6", "1e12", "1e300", "x",
    "", "1,2", "nan,1", "1e9,1", "1,2,3", "in", "out", "hold", "COM_OF_LOSS_T=0.3", "MPC_Z_P=1e9", "X=1", "1_0",
)  # fmt: skip


def a_line(draw: random.Random) -> str:
    """Return a line of the timeline as somebody might write it: mostly right in its form, odd in its numbers."""
    kind = draw.choice([*FAULTS])
    lasts, checks, usage, _ = FAULTS[kind]
    when = draw.choice(["1-3", "2-2.5", "0-9"]) if lasts else draw.choice(["1", "2.5"])
    if draw.random() < 0.1:
        when = draw.choice(ODD) + draw.choice(["-", ""]) + draw.choice(ODD)
    words = [draw.choice(("in", "out")) if usage.startswith("in|out") and i == 0 else draw.choice(ODD)
             for i in range(len(checks))]  # fmt: skip
    return " ".join([when, kind, *words])


def is_right(line: str) -> bool:
    try:
        parse(line)
    except ValueError:
        return False
    return True


def a_config(draw: random.Random) -> dict[str, Any]:
    """Return some fields with odd values, a good part of them just within their bounds."""
    given: dict[str, Any] = {"airframe": draw.choice(["multirotor", "fixed_wing"]), "start_height_m": 20.0}
    for name in draw.sample([*BOUNDS], draw.randint(1, 4)):
        least, most = BOUNDS[name]
        inside = [least, most, 0.5 * (least + most), draw.uniform(least, most)]
        value = draw.choice(inside if draw.random() < 0.9 else [NAN, INF, -1e30, 1e30])
        given[name] = int(value) if math.isfinite(value) and "id" in name.split("_")[-1] else value
    lines = [a_line(draw) for _ in range(draw.randint(0, 20))]
    given["faults"] = tuple(line for line in lines if is_right(line) or draw.random() < 0.02)
    given["range_message"] = draw.choice(["distance_sensor", "ranging_beacon", "landing_target"])
    return given


def fly(given: dict[str, Any], seconds: float = 4.0) -> bool:
    """Fly what is accepted with every stream on, in OFFBOARD. Return whether it was."""
    try:
        stub = Stub(StubConfig(**given))
    except ValueError as error:
        assert "\n" not in str(error)
        return False
    mav = mavlink.MAVLink(None, 1, 191)
    target = stub.config.system_id
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, target, 1, 8, 1479, *[0] * 3, 4, *[0] * 6, 0.2)
    request = mavlink.MAVLink_command_long_message(target, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0)
    for k in range(1, round(seconds * 20)):
        stub.receive("offboard", setpoint.pack(mav))
        if k == 2:
            stub.receive("offboard", request.pack(mav))
        stub.advance(k / 20)
        stub.take("offboard")
    return True


def test_what_is_let_in_flies_and_the_rest_is_told_in_one_line() -> None:
    draw = random.Random(f"{SEED}:numbers")
    flown = sum(fly(a_config(draw), seconds=2.5) for _ in range(80))
    assert 15 < flown < 70, "the fuzz is not worth much"


@pytest.mark.soak
def test_what_is_let_in_flies_at_length() -> None:
    draw = random.Random(f"{SEED}:numbers at length")
    for _ in range(max(20, round(4000 * SHARE))):
        given = a_config(draw)
        try:
            fly(given)
        except Exception as error:
            raise AssertionError(f"seed {SEED}: {given}") from error


def test_every_bound_flies() -> None:
    for name, bounds in BOUNDS.items():
        for value in bounds:
            assert fly({"start_height_m": 20.0, name: value}, seconds=1.0), (name, value)


def test_lines_are_told_or_taken() -> None:
    draw = random.Random(f"{SEED}:lines")
    taken = 0
    for _ in range(5000):
        line = a_line(draw)
        try:
            parse(line)
            taken += 1
        except ValueError as error:
            assert str(error).startswith("fault "), line
            assert "\n" not in str(error)
    assert 500 < taken < 4500


def test_parameters_set_on_the_wire_may_be_anything() -> None:
    """PX4 takes what PARAM_SET says, beyond its limits too; the vehicle may fall, not die."""
    draw = random.Random(f"{SEED}:wire")
    for airframe in ("multirotor", "fixed_wing"):
        stub = Stub(StubConfig(airframe=airframe, start_height_m=30.0))
        mav = mavlink.MAVLink(None, 255, 190)
        modes = [m for m in Mode if m is not Mode.TERMINATION]
        for k in range(250):
            name = draw.choice(stub.autopilot.params.names)
            if isinstance(stub.autopilot.params[name], int):
                raw = struct.unpack("<f", struct.pack("<i", draw.choice([-(2**31), -1, 0, 1, 5, 2**31 - 1])))[0]
                message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), raw, INT32)
            else:
                value = draw.choice([NAN, -3e38, -1.0, 0.0, 1e-30, 1.0, 3e38])
                message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, REAL32)
            stub.receive("gcs", message.pack(mav))
            if k % 5 == 0:
                word = int(draw.choice(modes))
                mode = mavlink.MAVLink_command_long_message(
                    1, 1, 176, 0, 1, (word >> 16) & 0xFF, word >> 24, 0, 0, 0, 0
                )
                stub.receive("gcs", mode.pack(mav))
                if not stub.truth().armed:
                    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                    stub.receive("gcs", arm.pack(mav))
            stub.advance(0.1 * (k + 1))
            stub.take("offboard")
            stub.take("gcs")
            truth = stub.truth()
            assert math.isfinite(truth.east_m + truth.north_m + truth.height_m + truth.roll_rad), (k, name)


COMMANDS = (16, 17, 20, 21, 22, 92, 176, 178, 179, 185, 192, 300, 400, 410, 510, 511, 512, 519, 520, 9999)
EXTREMES = (
    NAN,
    INF,
    -INF,
    -3.4e38,
    3.4e38,
    -1e10,
    -1.0,
    -1e-30,
    0.0,
    1e-30,
    0.5,
    1.0,
    2.0,
    3.0,
    4.0,
    6.0,
    436.0,
    1e6,
    1e10,
)


@pytest.mark.parametrize("airframe", ["multirotor", "fixed_wing"])
def test_commands_and_setpoints_may_be_anything(airframe: str) -> None:
    """Any finite or other number in any field: answered, refused or flown, and the vehicle stays somewhere."""
    trouble(airframe, flights=2)


@pytest.mark.soak
@pytest.mark.parametrize("airframe", ["multirotor", "fixed_wing"])
def test_commands_and_setpoints_may_be_anything_at_length(airframe: str) -> None:
    trouble(airframe, flights=max(4, round(120 * SHARE)))


def trouble(airframe: str, flights: int) -> None:
    """Fly with odd commands and setpoints between requests for OFFBOARD."""
    draw = random.Random(f"{SEED}:commands")
    mav = mavlink.MAVLink(None, 1, 191)

    def some(count: int) -> list[float]:
        return [draw.choice(EXTREMES) for _ in range(count)]

    def message() -> Any:
        kind = draw.randrange(5)
        if kind == 0:
            return mavlink.MAVLink_command_long_message(1, 1, draw.choice(COMMANDS), 0, *some(7))
        if kind == 1:
            whole = [draw.choice([-(2**31), -1, 0, 474000000, 2**31 - 1]) for _ in range(2)]
            return mavlink.MAVLink_command_int_message(1, 1, 0, draw.choice(COMMANDS), 0, 0, *some(4), *whole, *some(1))
        mask, frame = draw.randrange(4096), draw.choice([0, 1, 5, 6, 7, 8])
        if kind == 2:
            return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *some(11))
        if kind == 3:
            whole = [draw.randrange(-(2**31), 2**31) for _ in range(2)]
            return mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, mask, *whole, *some(9))
        return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask & 0xFF, some(4), *some(4))

    offboard = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0)
    for flight in range(flights):
        stub = Stub(StubConfig(airframe=airframe, start_height_m=30.0, seed=flight))
        for k in range(300):
            what = offboard if k % 3 == 0 else message()
            stub.receive("offboard", what.pack(mav))
            stub.advance(0.05 * (k + 1))
            stub.take("offboard")
            truth = stub.truth()
            place = truth.east_m + truth.north_m + truth.height_m
            assert math.isfinite(place + truth.speed_m_s + truth.roll_rad + truth.heading_rad), (flight, k, str(what))


# -- the command line ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--heading", "nan"], "start_heading_rad nan"),
        (["--system-id", "0"], "system_id 0 is not within 1..255"),
        (["--offboard-port", "99999"], "'99999' is not a UDP port"),
        (["--speed", "inf"], "positive"),
        (["--dropout", "5:4"], "dropout (5.0, 4.0)"),
        (["--fault", "1-2 delay in -1"], "it goes from 0 to 3600"),
        (["--param", "COM_OF_LOSS_T=-1"], "it goes from 0 to 60"),
        (["--range-step", "-1"], "range_step_m -1.0"),
        (["--ready-after", "nan"], "ready_after_s nan"),
        (["--nonsense"], "--nonsense"),
    ],
)
def test_a_wrong_number_on_the_command_line_is_one_line(arguments: list[str], words: str) -> None:
    done = subprocess.run([sys.executable, "-m", "sitl_stub", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1, done.stderr
    assert words in done.stderr


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--no-radio --device linktrack", "--no-radio leaves no radio on board: leave out --device"),
        ("--no-radio --rate 5 --dropout 1:2", "--no-radio leaves no radio on board: leave out --rate, --dropout"),
        ("--device linktrack --ranging-port 5000", "--device linktrack sends bytes and no messages: leave out --rang"),
        ("--device us_d1 --sensor-id 7", "leave out --sensor-id"),
        ("--device us_d1 --beacon-id 1", "--beacon-id does nothing: us_d1 carries none"),
        ("--beacon-id 2", "--beacon-id does nothing: distance_sensor carries none"),
        ("--airspeed-scale 1.1", "--airspeed-scale is of the airspeed sensor of a fixed wing"),
        ("--device-port 5000", "add --device NAME"),
        ("--start-speed 5", "add --airborne HEIGHT"),
        ("--range-message landing_target --sensor-id 7", "carries neither: leave out --sensor-id"),
        ("--range-message ranging_beacon --orientation 0", "carries neither: leave out --orientation"),
        ("--outlier-mean 20", "add --outliers SHARE"),
        ("--sign ''", "--sign needs a passphrase"),
    ],
)
def test_an_option_that_would_do_nothing_is_one_line(line: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(line))
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert error.count("\n") == 1, error
    assert words in error


@pytest.mark.parametrize(
    "line",
    [
        "",
        "--no-radio --airborne 30 --start-speed 0 --sign secret",
        "--device linktrack --device-port 5000 --beacon-id 3 --rate 20 --outliers 0.1 --outlier-mean 20",
        "--range-message landing_target --beacon-id 3 --ranging-port 5000 --range-from 1,25",
        "--sensor-id 9 --orientation 12 --dropout 1:2 --dropout 4:5",
    ],
)
def test_options_that_act_together_are_taken(line: str) -> None:
    words = shlex.split(line)
    assert [*idle(parser().parse_args(words), given(parser(), words))] == []


# -- faults that overlap -------------------------------------------------------------------------------------------


def test_one_refusal_of_arming_ends_and_the_other_goes_on() -> None:
    rig = Rig(faults=("0-3 refuse-arm", "1-6 refuse-arm"))
    rig.run(4.0)
    assert rig.command(400, 1) == [1]
    rig.run(3.0)
    assert rig.command(400, 1) == [0]


def test_one_refusal_of_offboard_ends_and_the_other_goes_on() -> None:
    rig = flying(faults=("0-2 refuse-offboard", "0-4 refuse-offboard"))
    rig.streaming = lambda _: rig.local()
    rig.run(2.5)
    assert rig.set_mode(OFFBOARD) == [0, 1]
    rig.run(2.0)
    assert rig.set_mode(OFFBOARD) == [0, 0]


def test_equal_lines_end_both() -> None:
    rig = flying(faults=("1-2 deaf", "1-2 deaf", "1-2 silence", "1-2 silence"))
    rig.run(3.0)
    rig.streaming = lambda _: rig.local()
    rig.run(0.5)
    assert rig.set_mode(OFFBOARD) == [0, 0]


@pytest.mark.parametrize("kind", ["deaf", "no-gps"])
def test_ears_and_position_come_back_with_the_last_line(kind: str) -> None:
    rig = flying(faults=(f"1-3 {kind}", f"2-5 {kind}"), params={"COM_OBL_RC_ACT": 5})
    rig.streaming = lambda _: rig.local()
    rig.run(3.5)
    assert rig.set_mode(OFFBOARD) == [0, 1]
    rig.run(2.0)
    assert rig.set_mode(OFFBOARD) == [0, 0]


def test_the_end_of_no_gps_gives_no_gps_to_a_vehicle_without_one() -> None:
    rig = Rig(gps=False, faults=("1-2 no-gps",))
    rig.run(3.0)
    assert rig.all("GPS_RAW_INT") == [] or rig.all("GPS_RAW_INT")[-1].fix_type == 0
    assert not rig.stub.autopilot.commander.position_ok


def ranges_cm(*lines: str) -> dict[float, int]:
    rig = Rig(radio=True, beacon_east_m=100.0, range_sigma_m=0.0, faults=lines, streams=(132,))
    rig.run(6.0)
    who = (1, 158)
    heard = [(t, m) for t, m in rig.heard if m.get_type() == "DISTANCE_SENSOR"]
    return {t: m.current_distance for t, m in heard if (m.get_srcSystem(), m.get_srcComponent()) == who}


def test_what_is_added_adds_up_and_the_last_value_wins() -> None:
    heard = ranges_cm("1-3 range-add 10", "2-4 range-add 5", "4.5-5.5 range-value 7", "5-5.25 range-value 9")
    at = {t: next(v for when, v in heard.items() if when >= t) for t in (1.5, 2.5, 3.5, 4.25, 4.75, 5.1, 5.4)}
    assert [*at.values()] == [11000, 11500, 10500, 10000, 700, 900, 700]


def test_two_stops_of_the_range_end_with_the_later_one() -> None:
    times = [*ranges_cm("1-3 range-stop", "2-5 range-stop")]
    assert not [t for t in times if 1.05 < t < 4.95]
    assert [t for t in times if t > 5.0]


def test_a_line_may_last_for_ever() -> None:
    assert max(ranges_cm("2-inf range-stop")) <= 2.05


def test_a_foreign_vehicle_stays_until_its_last_line_ends() -> None:
    rig = Rig(faults=("1-3 foreign 42", "2-6 foreign 42", "2-4 foreign 43"))
    rig.run(8.0)
    beats = {s: [t for t, m in rig.heard if m.get_type() == "HEARTBEAT" and m.get_srcSystem() == s] for s in (42, 43)}
    assert len(beats[42]) == pytest.approx(4, abs=1)
    assert 4.9 < max(beats[42]) <= 6.1
    assert max(beats[43]) <= 4.1
