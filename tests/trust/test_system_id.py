"""Several vehicles on one link: the one that vehicle.system_id names is flown, whoever speaks first."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.readiness import Audit
from circumnav_mav.runtime.app import no_autopilot
from circumnav_mav.settings_check import Severity
from tests.lockstep import Rig, airborne, config
from tests.trust.rules import OFFBOARD, keep_the_rules

OTHER, OURS = 9, 7


def other_speaks(receive) -> None:
    """The heartbeat of another PX4 that flies in Hold."""
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 157, 0x03040000, 4, 3)
    receive(heartbeat.pack(mavlink.MAVLink(None, OTHER, 1)), 0.0)


def test_the_vehicle_that_is_named_is_flown_though_another_speaks_first():
    rig = Rig(config(vehicle={"system_id": OURS}), airborne(80.0, system_id=OURS, faults=(f"0-60 foreign {OTHER}",)))
    other_speaks(rig.flight.receive)
    rig.run(4.0)
    rig.pilot.mode(OFFBOARD)
    rig.run(8.0)
    assert rig.log.ticks[-1].control == "held"
    assert {m.target_system for _, m in rig.decoded() if hasattr(m, "target_system")} == {OURS}
    assert {m.get_srcSystem() for _, m in rig.decoded()} == {OURS}, "from the first heartbeat on"
    keep_the_rules(rig)


def test_without_a_name_the_first_one_is_flown_and_the_other_is_told():
    rig = Rig(config(), airborne(80.0, system_id=OURS))
    rig.run(2.0)
    other_speaks(rig.flight.receive)
    other_speaks(rig.flight.receive)
    rig.run(1.0)
    told = [e.text for e in rig.flight.events if "another autopilot" in e.text]
    assert told == [f"system {OTHER} is another autopilot; system {OURS} is flown: set vehicle.system_id"]


def test_a_vehicle_that_does_not_come_is_told_with_those_that_do():
    rig = Rig(config(vehicle={"system_id": 3}), airborne(80.0, system_id=OURS))
    rig.run(6.0)
    assert rig.log.phases == ["waiting_autopilot"]
    assert rig.setpoints() == []
    words = no_autopilot("udpin://0.0.0.0:14540", rig.flight)
    assert words == f"system {OURS} on udpin://0.0.0.0:14540, but not vehicle.system_id = 3: set it to the one to fly"


def test_check_live_tells_it_too():
    audit = Audit(config(vehicle={"system_id": 3}))
    other_speaks(audit.receive)
    row = audit.findings(10.0)[0]
    assert row.severity is Severity.ERROR
    assert row.text == f"system {OTHER} is heard, but not vehicle.system_id = 3" and "vehicle.system_id" in row.fix


@pytest.mark.parametrize("value", ["0", "256", "one", "true"])
def test_an_id_that_cannot_be_is_a_fault_of_the_file(value):
    with pytest.raises(ConfigError) as caught:
        parse(f"vehicle: {{system_id: {value}}}", "c.yaml")
    assert any("vehicle.system_id" in line for line in caught.value.lines())
