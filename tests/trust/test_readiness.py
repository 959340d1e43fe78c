"""`check --live`: every row of the table brought about on the stub, and the command as a user starts it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.readiness import Audit, Severity
from circumnav_mav.runtime.live_check import WIDTH, table
from sitl_stub import Stub
from sitl_stub.server import Endpoint, Server
from tests.lockstep import OFFBOARD_LINK, Peer, airborne, config
from tests.trust.test_safety import shows

ROOT = Path(__file__).parents[2]
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


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.parametrize(("params", "code", "words"), [({}, 1, "not ready"), (SAFE, 4, "can fly")])
def test_the_command_says_it_and_its_exit_code_tells_how_grave_it_is(tmp_path, params, code, words):
    stub = Stub(airborne(80.0, params=params))
    server = Server(stub, {"offboard": Endpoint(0, 0)})
    file = tmp_path / "c.yaml"
    file.write_text(yaml.safe_dump({"vehicle": {"link": f"udpout://127.0.0.1:{server.port('offboard')}"}}))
    command = [sys.executable, "-m", "circumnav_mav.cli", "check", str(file), "--live", "--seconds", "6"]
    child = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"import sys; sys.argv[1:] = {command[3:]!r}; from circumnav_mav.cli import main; main()",
        ],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        server.run(60.0, stop=lambda: child.poll() is not None)
        out, _ = child.communicate(timeout=30.0)
    finally:
        child.kill()
        server.close()
    assert child.returncode == code, out
    assert words in out
