"""`check --live`: every row of the table brought about on the stub, and the command as a user starts it."""

from __future__ import annotations

import math
import subprocess

import pytest
import yaml
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.readiness import Audit
from circumnav_mav.runtime.live_check import WIDTH, table
from circumnav_mav.settings_check import Severity, facts, judged
from circumnav_mav.settings_table import TABLES
from sitl_stub import Stub
from sitl_stub.modes import Mode
from sitl_stub.pace import Pace
from sitl_stub.server import Endpoint, Server
from tests.app_process import start_app, wait_for_pace
from tests.lockstep import OFFBOARD_LINK, Peer, airborne, config
from tests.trust.test_safety import shows
from tests.vehicles.ardupilot import COPTER, PLANE, FakeArduPilot
from tests.vehicles.test_ardupilot import APPS, LOITER

OK, WARNING, ERROR = Severity.OK, Severity.WARNING, Severity.ERROR
SAFE = {"COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3}


def listen(app=None, for_s: float = 10.0, also=None, **world):
    """Audit a stub in lockstep for ten seconds; return (findings by what, the frames that the audit sent)."""
    world = {"params": SAFE, "height_m": 15.0, **world}
    stub = Stub(airborne(80.0, **world))
    audit = Audit(config(**(app or {})))
    sent: list[bytes] = []
    t = 0.0
    while t < for_s:
        t += 0.05
        stub.advance(t)
        if also is not None:
            also(stub, audit, t)
        for data in stub.take(OFFBOARD_LINK):
            audit.receive(data, t)
        for frame in audit.tick(t):
            sent.append(frame)
            stub.receive(OFFBOARD_LINK, frame)
    findings = audit.findings(t)
    return {f.what: f for f in findings if f.what != "streams"} | {"all": findings}, sent


def sticks(stub, audit, t) -> None:
    Peer(stub, link=OFFBOARD_LINK).send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    audit.receive(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0).pack(mavlink.MAVLink(None, 255, 190)), t)


def test_a_vehicle_that_is_ready_has_nothing_but_ok():
    found, _ = listen(also=sticks)
    assert [f for f in found["all"] if f.severity is not OK] == []
    assert {"vehicle", "mode", "range", "COM_OF_LOSS_T", "COM_OBL_RC_ACT", "battery", "RC"} <= set(found)
    assert list(table(found["all"]))[-1] == "ready"


@pytest.mark.parametrize(("engage", "words"), [("pilot", "take off before you engage"), ("auto", "ready to take off")])
def test_a_vehicle_on_the_ground_is_ready_too(engage, words):
    """Where the field guide has it run: who reads it stands beside the aircraft."""
    app = {"engage": engage, "orbit": {"height_m": 15.0}}
    found, _ = listen(app, also=sticks, height_m=0.0)
    assert [f for f in found["all"] if f.severity is not OK] == []
    assert words in found["mode"].text
    assert list(table(found["all"]))[-1] == "ready"


def test_on_the_ground_in_offboard_is_still_a_warning():
    def left_over(stub, audit, t):
        if t > 2.0:
            stub.autopilot.commander.intention = stub.autopilot.commander.mode = Mode.OFFBOARD

    found, _ = listen(also=left_over, height_m=0.0)
    assert found["mode"].severity is WARNING and "choose another mode first" in found["mode"].text


def test_an_autopilot_that_is_to_give_its_own_ranges_is_asked_for_them():
    found, sent = listen({"ranging": {"from": [1, 1]}}, also=sticks)
    assert found["range"].severity is OK
    asked = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in sent]
    assert [m.param2 for m in asked if m.get_type() == "COMMAND_LONG" and m.param1 == 132] == [50_000.0]


def test_a_rover_is_not_told_to_take_off():
    app = {"vehicle": {"class": "px4_rover"}}
    mav, audit = mavlink.MAVLink(None, 1, 1), Audit(config(**app))
    for message in (
        mavlink.MAVLink_heartbeat_message(10, 12, 29, 0x03040000, 3, 3),
        mavlink.MAVLink_current_mode_message(0, 0x03040000, 0x03040000),
        mavlink.MAVLink_extended_sys_state_message(0, 1),
    ):
        audit.receive(message.pack(mav), 9.0)
    row = next(f for f in audit.findings(10.0) if f.what == "mode")
    assert row.severity is OK and row.text == "Hold, disarmed"


def test_it_moves_nothing():
    _, sent = listen()
    decoder = mavlink.MAVLink(None)
    messages = [decoder.decode(bytearray(frame)) for frame in sent]
    assert {m.get_type() for m in messages} <= {
        "HEARTBEAT",
        "COMMAND_LONG",
        "PARAM_REQUEST_READ",
        "TIMESYNC",
    }
    assert {m.command for m in messages if m.get_type() == "COMMAND_LONG"} <= {511, 512}


def test_a_stock_px4_without_sticks_is_told_that_it_would_sink():
    found, _ = listen(params={})
    row = found["COM_OBL_RC_ACT"]
    assert row.severity is ERROR and "SINKS" in row.text and "5 (Hold)" in row.fix
    assert found["RC"].severity is WARNING
    assert found["COM_RC_OVERRIDE"].severity is WARNING and "set COM_RC_OVERRIDE to 3" in found["COM_RC_OVERRIDE"].fix


def test_with_sticks_the_same_is_a_warning():
    found, _ = listen(params={}, also=sticks)
    assert found["COM_OBL_RC_ACT"].severity is WARNING


@pytest.mark.parametrize(("action", "word"), [(6, "TERMINATION"), (7, "DISARM")])
def test_a_fall_is_an_error_with_or_without_sticks(action, word):
    found, _ = listen(params={**SAFE, "COM_OBL_RC_ACT": action}, also=sticks)
    assert found["COM_OBL_RC_ACT"].severity is ERROR and word in found["COM_OBL_RC_ACT"].text


def test_a_long_loss_timeout_is_told():
    found, _ = listen(params={**SAFE, "COM_OF_LOSS_T": 10.0})
    assert found["COM_OF_LOSS_T"].severity is WARNING and "10 s" in found["COM_OF_LOSS_T"].text


def test_rc_loss_that_is_excepted_is_told():
    found, _ = listen(params={**SAFE, "COM_RCL_EXCEPT": 4}, also=sticks)
    assert found["COM_RCL_EXCEPT"].severity is WARNING


def ranging_row(source: str, pieces: list[bytes]):
    """Return (the row on the range, the table as printed) after ten seconds of a device of its own."""
    audit = Audit(config(ranging={"source": source, "endpoint": "udpin://127.0.0.1:14560"}))
    for n, piece in enumerate(pieces):
        audit.receive(piece, 0.1 * n, ranging=True)
    findings = audit.findings(10.0)
    return next(f for f in findings if f.what == "range"), list(table(findings))


@pytest.mark.parametrize("count", [1, 2, 12])
def test_every_error_that_is_counted_is_printed(count):
    """Few bytes of a device that says nothing sensible."""
    row, lines = ranging_row("us_d1", [b"\x01"] * count)
    assert row.severity is ERROR and f"only {count} bytes" in row.text
    assert sum(line.startswith("ERROR") for line in lines) == int(lines[-1].split()[2])


def test_few_ranges_are_told_with_what_befell_the_others():
    row, _ = ranging_row("lightware", [b"50.00\r\n"] + [b"130.00\r\n"] * 100)
    assert row.severity is WARNING and "only 0.0 Hz, 100 rejected, most of them no_reading (100)" in row.text


def test_few_ranges_and_then_nothing_are_told_so():
    row, _ = ranging_row("lightware", [b"50.00\r\n"])
    assert row.severity is WARNING and "nothing more is heard on udpin://127.0.0.1:14560" in row.text


def test_a_radio_s_own_link_is_not_signed_and_it_is_asked_for_its_clock_alone():
    from circumnav_mav.mavlink.signing import Signer

    own = {"endpoint": "udpin://127.0.0.1:14560"}
    audit = Audit(config(ranging=own), Signer(bytes(32), 0))
    mav = mavlink.MAVLink(None, 1, 158)
    for n in range(100):
        message = mavlink.MAVLink_distance_sensor_message(1000 + 100 * n, 10, 60000, 5000 + n, 0, 7, 0, 255)
        audit.receive(message.pack(mav), 0.1 * n, ranging=True)
    asked = [mavlink.MAVLink(None).decode(bytearray(f)) for n in range(100) for f in audit.questions(0.1 * n)]
    assert len(asked) == 10 and {(m.get_type(), m.tc1, m.get_srcComponent()) for m in asked} == {("TIMESYNC", 0, 191)}
    assert next(f for f in audit.findings(10.0) if f.what == "range").severity is OK


def test_nothing_on_the_link_is_an_error_with_what_to_check():
    audit = Audit(config())
    audit.tick(0.0)
    (row, *_) = audit.findings(10.0)
    assert row.severity is ERROR and row.text == "nothing is heard" and "vehicle.link" in row.fix


def test_rubbish_on_the_link_is_told_from_silence():
    audit = Audit(config())
    audit.receive(bytes(range(200)) * 5, 1.0)
    assert "not MAVLink" in audit.findings(10.0)[0].text


def test_mavlink_without_an_autopilot_is_told():
    audit = Audit(config())
    radio = mavlink.MAVLink(None, 1, 158)
    audit.receive(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(radio), 1.0)
    assert "no autopilot" in audit.findings(10.0)[0].text


def test_no_radio_is_an_error():
    found, _ = listen(radio=False)
    assert found["range"].severity is ERROR


def test_the_decoy_alone_is_no_range():
    """The autopilot's own range finder is heard before its stream can be turned off."""

    def decoy(stub, audit, t):
        message = mavlink.MAVLink_distance_sensor_message(int(t * 1e3), 0, 10000, 1500, 0, 0, 25, 0)
        audit.receive(message.pack(mavlink.MAVLink(None, 1, 1)), t)

    found, _ = listen(radio=False, also=decoy)
    assert found["range"].severity is ERROR
    assert "only the autopilot's own" in found["range"].text


def test_a_slow_radio_is_a_warning():
    found, _ = listen(range_rate_hz=1.0)
    assert found["range"].severity is WARNING and "only 1." in found["range"].text


@pytest.mark.parametrize(
    ("index", "value", "severity", "words"),
    [(6, 10, ERROR, "10 %"), (6, -1, WARNING, "does not measure")],
)
def test_the_battery_is_judged(monkeypatch, index, value, severity, words):
    shows(1, index, value)(None, monkeypatch)
    found, _ = listen()
    assert found["battery"].severity is severity and words in found["battery"].text


def test_lost_estimates_stop_a_flight(monkeypatch):
    shows(230, 1, 0b10100101)(None, monkeypatch)
    found, _ = listen()
    assert found["vehicle"].severity is ERROR and "velocity" in found["vehicle"].text


def test_the_wrong_vehicle_class_is_named_with_the_right_one():
    found, _ = listen({"vehicle": {"class": "arducopter"}})
    assert found["vehicle"].severity is ERROR and "px4_multirotor" in found["vehicle"].text
    assert not any("did not say" in f.text for f in found["all"]), "what matters is the class"
    assert {f.severity for f in found["all"] if f.what not in ("vehicle", "RC", "streams")} == {OK}


def test_a_failsafe_is_told():
    def lost(stub, audit, t):
        stub.autopilot.commander.failsafe = True
        stub.autopilot.commander.intention = 0x00060000

    found, _ = listen(also=lost)
    assert found["mode"].severity is WARNING


def test_a_second_companion_and_a_second_autopilot_are_told():
    def others(stub, audit, t):
        if t < 3.0:
            return  # the first autopilot that is heard is the one that is flown
        for sender in ((1, 191), (9, 1)):
            message = mavlink.MAVLink_heartbeat_message(18, 8 if sender[1] == 191 else 12, 0, 0, 4, 3)
            audit.receive(message.pack(mavlink.MAVLink(None, *sender)), t)

    found, _ = listen(also=others)
    texts = [f.text for f in found["all"] if f.what == "ids"]
    assert any("system 9 is another autopilot" in text for text in texts)
    assert any("speaks as system 1 component 191" in text for text in texts)


def test_a_vehicle_that_refuses_to_arm_is_told():
    found, _ = listen(height_m=0.0, ready_after_s=1e9)
    assert found["pre-arm"].severity is WARNING


def test_slow_streams_are_told(monkeypatch):
    """A link that loses two thirds of what is sent: the rates that arrive are what counts."""
    audit_receive, count = Audit.receive, [0]

    def lossy(self, data, now_s, **kw):
        count[0] += 1
        if count[0] % 4 == 0:
            audit_receive(self, data, now_s, **kw)

    monkeypatch.setattr(Audit, "receive", lossy)
    found, _ = listen(for_s=15.0)
    slow = [f for f in found["all"] if f.what == "streams" and f.severity is WARNING]
    assert slow and "baud" in slow[0].fix


def test_the_table_is_sorted_by_severity_fits_the_terminal_and_sums_up():
    found, _ = listen(params={}, radio=False)
    severities = [f.severity for f in found["all"]]
    assert severities == sorted(severities, reverse=True)
    lines = list(table(found["all"]))
    assert all(len(line) <= WIDTH for line in lines)
    assert lines[-1].startswith("not ready: ")


PX4_SETTINGS = [
    ({"COM_OF_LOSS_T": 1.0}, OK, "1 s after the last setpoint"),
    ({"COM_OF_LOSS_T": 5.0}, WARNING, "5 s after the last setpoint"),
    ({"COM_OBL_RC_ACT": 3}, OK, "Return"),
    ({"COM_OBL_RC_ACT": 4}, OK, "Land"),
    ({"COM_OBL_RC_ACT": 5}, OK, "Hold"),
    ({"COM_OBL_RC_ACT": 6}, ERROR, "TERMINATION"),
    ({"COM_OBL_RC_ACT": 7}, ERROR, "DISARM"),
    ({"COM_RC_OVERRIDE": 3}, OK, "moved sticks end Offboard"),
    ({"COM_RC_OVERRIDE": 1}, WARNING, "do NOT end Offboard"),
    ({"COM_RCL_EXCEPT": 4}, OK, "does nothing in Offboard"),
    ({"COM_RCL_EXCEPT": 0}, OK, "NAV_RCL_ACT says"),
    ({"NAV_RCL_ACT": 5}, ERROR, "it falls"),
    ({"NAV_RCL_ACT": 6}, ERROR, "it falls"),
    ({"NAV_RCL_ACT": 5, "COM_RCL_EXCEPT": 4}, OK, "not asked in Offboard"),
    ({"NAV_RCL_ACT": 1}, OK, "Hold"),
    ({"NAV_RCL_ACT": 2}, OK, "Return"),
    ({"NAV_RCL_ACT": 3}, OK, "Land"),
    ({"NAV_RCL_ACT": 0}, WARNING, "does nothing"),
]
SETTINGS = [
    *(("px4_multirotor", *case) for case in PX4_SETTINGS),
    *(("px4_fixed_wing", *case) for case in PX4_SETTINGS),
    ("px4_multirotor", {"COM_OBL_RC_ACT": 0}, ERROR, "SINKS"),
    ("px4_multirotor", {"COM_OBL_RC_ACT": 1}, ERROR, "sinks at 0.7"),
    ("px4_multirotor", {"COM_OBL_RC_ACT": 2}, ERROR, "sinks at 0.4"),
    ("px4_multirotor", {"MPC_XY_VEL_MAX": 12.0}, OK, "above orbit.speed_m_s"),
    ("px4_multirotor", {"MPC_XY_VEL_MAX": 4.0}, ERROR, "clips the speed at 4 m/s"),
    ("px4_fixed_wing", {"COM_OBL_RC_ACT": 0}, ERROR, "STRAIGHT AWAY"),
    ("px4_fixed_wing", {"COM_OBL_RC_ACT": 1}, ERROR, "straight away"),
    ("px4_fixed_wing", {"COM_OBL_RC_ACT": 2}, ERROR, "straight away"),
    ("px4_fixed_wing", {"FW_AIRSPD_MIN": 10.0}, ERROR, "above orbit.speed_m_s, 5 m/s"),
    ("px4_fixed_wing", {"FW_AIRSPD_MIN": 4.0}, OK, "below orbit.speed_m_s"),
    ("px4_fixed_wing_position", {"FW_AIRSPD_TRIM": 15.0}, WARNING, "flies 15 m/s whatever is asked"),
    ("px4_fixed_wing_position", {"FW_AIRSPD_TRIM": 5.2}, OK, "flies 5.2 m/s"),
    ("px4_fixed_wing_position", {"FW_R_LIM": 20.0}, WARNING, "banks 20 deg at most, limits.bank_deg is 30"),
    ("px4_fixed_wing_position", {"FW_R_LIM": 50.0}, OK, "banks 50 deg"),
    ("px4_multirotor_attitude", {"COM_OBL_RC_ACT": 5}, WARNING, "needs a position"),
    ("px4_multirotor_attitude", {"COM_OBL_RC_ACT": 4}, OK, "Land"),
    ("px4_multirotor_attitude", {"COM_OBL_RC_ACT": 1}, ERROR, "sinks at 0.7"),
    ("px4_rover", {"COM_OBL_RC_ACT": 0}, WARNING, "never measured"),
    ("arducopter", {"GUID_TIMEOUT": 3.0}, WARNING, "TURNING, for 3 s"),
    ("arducopter", {"GUID_TIMEOUT": 1.0}, OK, "stays in Guided"),
    ("arducopter", {"GUID_OPTIONS": 4}, WARNING, "yaw stick is ignored"),
    ("arducopter", {"GUID_OPTIONS": 0}, OK, "yaw stick overrides"),
    ("arducopter", {"FS_THR_ENABLE": 0}, OK, "none is there"),
    ("arducopter", {"FS_THR_ENABLE": 1}, OK, "is acted on"),
    ("arducopter", {"FS_OPTIONS": 20}, OK, "does nothing in Guided"),
    ("arducopter", {"FS_OPTIONS": 16}, OK, "ends Guided"),
    ("arducopter", {"WPNAV_SPEED": 300}, ERROR, "clips the speed at 300 cm/s"),
    ("arducopter", {"WPNAV_SPEED": 1000}, OK, "above orbit.speed_m_s"),
    ("arducopter", {"WPNAV_ACCEL": 100}, WARNING, "100 cm/s2 at most"),
    ("arducopter", {"WPNAV_ACCEL": 250}, OK, "is flown"),
    ("arducopter", {"SYSID_MYGCS": 1}, OK, "RTL if it stops"),
    ("arducopter", {"SYSID_MYGCS": 255}, OK, "nothing watches the companion"),
    ("arduplane", {"STICK_MIXING": 0}, OK, "sticks do nothing"),
    ("arduplane", {"STICK_MIXING": 1}, OK, "none is there"),
    ("arduplane", {"FS_LONG_ACTN": 0}, OK, "none is there"),
    ("arduplane", {"FS_LONG_ACTN": 1}, OK, "RTL"),
    ("arduplane", {"FS_LONG_ACTN": 2}, WARNING, "FBWA"),
    ("arduplane", {"TKOFF_ALT": 50.0}, OK, "50 m"),
    ("arduplane", {"ROLL_LIMIT_DEG": 20.0}, WARNING, "20 deg at most, limits.bank_deg is 30"),
    ("arduplane", {"ROLL_LIMIT_DEG": 65.0}, OK, "65 deg at most"),
    ("arduplane", {"AIRSPEED_CRUISE": 22.0}, WARNING, "22 m/s (calibrated) whatever is asked, orbit.speed_m_s is 5"),
    ("arduplane", {"AIRSPEED_CRUISE": 5.0}, OK, "about orbit.speed_m_s"),
]
WITH_RC = [
    *(("px4_multirotor", {"COM_OBL_RC_ACT": n}, WARNING, "if this app dies") for n in (0, 1, 2)),
    *(("px4_fixed_wing", {"COM_OBL_RC_ACT": n}, WARNING, "if this app dies") for n in (0, 1, 2)),
    *(("px4_multirotor", {"COM_OBL_RC_ACT": n}, OK, "if this app dies") for n in (3, 4, 5)),
    *(("px4_multirotor", {"COM_OBL_RC_ACT": n}, ERROR, "it falls") for n in (6, 7)),
    ("px4_multirotor", {"COM_RCL_EXCEPT": 4}, WARNING, "does nothing in Offboard"),
    ("px4_multirotor_attitude", {"COM_OBL_RC_ACT": 1}, OK, "the pilot flies by stick"),
    ("arducopter", {"FS_THR_ENABLE": 0}, WARNING, "does nothing"),
    ("arducopter", {"FS_OPTIONS": 4}, WARNING, "does nothing in Guided"),
    ("arduplane", {"STICK_MIXING": 1}, WARNING, "ADDS to the app's bank"),
    ("arduplane", {"FS_LONG_ACTN": 0}, WARNING, "goes on obeying"),
]
AUTO = [
    ("arduplane", {"TKOFF_ALT": 50.0}, OK, "the rest to orbit.height_m is climbed once engaged"),
    ("arduplane", {"TKOFF_ALT": 0.0}, ERROR, "climbs to 0 m"),
    *(("px4_multirotor_attitude", {"COM_OBL_RC_ACT": n}, ERROR, "needs sticks or a position") for n in (0, 2, 6, 7)),
    ("px4_multirotor", {"COM_OF_LOSS_T": math.nan}, WARNING, "not a value that is known"),
]
CASES = [(case, False, {}) for case in SETTINGS] + [(case, True, {}) for case in WITH_RC]
CASES += [(case, False, {"engage": "auto", "orbit": {"height_m": 80.0}}) for case in AUTO]


def slow(name, orbit=None, **app):
    """5 m/s and a bank of 30 degrees, whatever the class would fly by itself."""
    return config(vehicle={"class": name}, orbit={"speed_m_s": 5.0, **(orbit or {})}, limits={"bank_deg": 30.0}, **app)


@pytest.mark.parametrize(("case", "has_rc", "app"), CASES)
def test_a_setting_is_judged(case, has_rc, app):
    name, parameters, severity, words = case
    known = facts(slow(name, **app), has_rc=has_rc, sysid=1, parameters=parameters)
    found = {f.what: f for f in judged(TABLES[name], known)}
    row = found[next(iter(parameters))]
    assert (row.severity, words in row.text) == (severity, True), row
    assert bool(row.fix) == (severity is not OK), "what is wrong comes with what mends it, and only that"


def test_every_row_of_every_table_is_judged_by_a_case():
    reached = set()
    for (name, parameters, _, _), has_rc, app in CASES:
        known = facts(slow(name, **app), has_rc=has_rc, sysid=1, parameters=parameters)
        for parameter in parameters:
            rows = [row for row in TABLES[name] if row.parameter == parameter]
            reached.add(id(next(row for row in rows if row.holds(parameters[parameter], known))))
    missed = {(row.parameter, row.does) for rows in TABLES.values() for row in rows if id(row) not in reached}
    assert not missed


def test_a_setting_that_is_not_told_and_one_that_nobody_knows_are_said():
    known = facts(config(), has_rc=False, sysid=1, parameters={"COM_OBL_RC_ACT": 99.0})
    found = {f.what: f for f in judged(TABLES["px4_multirotor"], known)}
    assert found["COM_OBL_RC_ACT"].severity is WARNING and "not a value that is known" in found["COM_OBL_RC_ACT"].text
    assert found["COM_OF_LOSS_T"].severity is WARNING and "did not say" in found["COM_OF_LOSS_T"].text


@pytest.mark.parametrize("name", ["arducopter", "arduplane"])
def test_an_ardupilot_is_judged_by_its_own_settings(name):
    kind = COPTER if name == "arducopter" else PLANE
    vehicle, audit = FakeArduPilot(kind, LOITER[kind], height_m=80.0), Audit(config(**APPS[kind]))
    for _ in range(500):
        vehicle.advance()
        for data in vehicle.take():
            audit.receive(data, vehicle.now_s)
        for frame in audit.tick(vehicle.now_s):
            vehicle.receive(frame)
    found = {f.what: f for f in audit.findings(vehicle.now_s)}
    assert set(vehicle.parameters) <= set(found)
    assert not [f for f in found.values() if "did not say" in f.text]
    if name == "arducopter":
        assert found["GUID_TIMEOUT"].severity is WARNING and "set GUID_TIMEOUT to 1" in found["GUID_TIMEOUT"].fix
    else:
        assert "straight on the heading" in found["if this app dies"].text


def test_a_stream_that_serves_two_needs_is_shown_once():
    found, _ = listen()
    names = [f.text.split()[0] for f in found["all"] if f.what == "streams"]
    assert sorted(names) == sorted(set(names)) and "LOCAL_POSITION_NED" in names


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize(("params", "code", "words"), [({}, 1, "not ready"), (SAFE, 4, "can fly")])
def test_the_command_says_it_and_its_exit_code_tells_how_grave_it_is(tmp_path, params, code, words):
    stub = Stub(airborne(80.0, params=params))
    server = Server(stub, {"offboard": Endpoint(0, 0)})
    file = tmp_path / "c.yaml"
    file.write_text(yaml.safe_dump({"vehicle": {"link": f"udpout://127.0.0.1:{server.port('offboard')}"}}))
    arguments, pace = ("check", str(file), "--live", "--seconds", "6"), tmp_path / "pace"
    child = start_app(*arguments, pace_file=pace, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        server._pace = Pace(wait_for_pace(pace, child))
        server.run(60.0, stop=lambda: child.poll() is not None)
        out, _ = child.communicate(timeout=30.0)
    finally:
        child.kill()
        server.close()
    assert child.returncode == code, out
    assert words in out
