"""Every way in which a range can come flies the orbit in lockstep: device bytes, and messages on either link.

The errors are the stub's truth, not the app's estimate; the devices' bytes are the stub's, after the vendors' formats.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.config_file import load
from circumnav_mav.flight import RANGING, VEHICLE
from sitl_stub.devices import DEVICES
from tests.app.test_table import keep_the_rules
from tests.links.rig import DeviceRig
from tests.lockstep import config

ROOT = Path(__file__).parents[2]
SERIAL = "serial:///dev/ttyUSB0:115200"
LINES = {"pattern": r"range=(?P<range>\S+) rate=(?P<rate>\S+)"}


def ranging_beacon(compid: int = 50):
    """Return an encoder of RANGING_BEACON from component `compid` of the vehicle."""
    mav = mavlink.MAVLink(None, 1, compid)

    def encode(range_m: float, rate_m_s: float, t_s: float) -> bytes:
        message = mavlink.MAVLink_ranging_beacon_message(
            time_usec=round(t_s * 1e6), target_system=0, target_component=0,
            beacon_id=7, range=round(range_m * 1e3), lat=0, lon=0, alt=0.0, alt_type=0,
            hacc_est=0, vacc_est=0, carrier_freq=0, sequence=mav.seq, range_accuracy=300, status=0,
        )  # fmt: skip
        return bytes(message.pack(mav))

    return encode


def flight(encode, *, link: str = RANGING, **ranging) -> DeviceRig:
    """Return a flight to a circle of 30 m around a beacon 80 m away: small, so that it settles within a minute."""
    settings = config(ranging=ranging, orbit={"radius_m": 30.0})
    return DeviceRig(settings, encode, link=link, world={"distance_m": 80.0})


def settles(rig: DeviceRig) -> None:
    rig.engage()
    log = rig.run(80.0)
    assert log.phases[-1] == "orbiting", (log.phases, rig.flight.events, rig.flight.rejected)
    assert "coasting" not in log.phases
    assert log.rms_m(40.0) < 0.6
    assert log.furthest_m(40.0) < 1.5
    keep_the_rules(rig)


@pytest.mark.parametrize(
    ("source", "device", "options"),
    [
        ("linktrack", "linktrack", {}),
        ("dwm1001_les", "dwm1001_les", {}),
        ("omnipresense", "omnipresense", {}),
        ("lightware", "lightware", {}),
        ("us_d1", "us_d1", {}),
        ("lines", "lines", LINES),
        ("replay", "replay", {}),
    ],
)
def test_flies_on_the_bytes_of(source, device, options):
    settles(flight(DEVICES[device](3).encode, source=source, endpoint=SERIAL, **options))


@pytest.mark.parametrize("link", [VEHICLE, RANGING])
def test_flies_on_ranging_beacon_messages(link):
    endpoint = "udpin://0.0.0.0:14560" if link == RANGING else None
    settles(flight(ranging_beacon(), link=link, source="ranging_beacon", endpoint=endpoint, beacon_id=7))


def test_the_shipped_serial_companion_flies():
    settings = load(ROOT / "configs" / "serial_companion.yaml")
    world = {"distance_m": 90.0, "beacon_height_m": 1.5}
    settles(DeviceRig(settings, DEVICES["linktrack"](1).encode, sigma_m=0.1, world=world))


def test_a_device_that_goes_silent_is_carried_and_then_handed_over():
    rig = flight(DEVICES["linktrack"](3).encode, source="linktrack", endpoint=SERIAL, coast_s=5.0).engage()
    rig.run(30.0)
    rig.silent = True
    silent_s = rig.now_s
    rig.run(4.5)
    assert rig.log.phases[-1] == "coasting"
    rig.run(2.0)  # coast_s counts from the newest range; then the mode request and its confirmation
    assert rig.log.phases[-1] == "range_lost"
    assert rig.stub.truth().mode == "AUTO/LOITER", rig.stub.truth().mode
    last = rig.log.sent(silent_s + 6.0)
    assert all(tick.turn_rate_sent_rad_s == 0.0 for tick in last)


def test_rubbish_on_the_line_is_counted_by_reason_and_flown_through():
    encode = DEVICES["linktrack"](3).encode
    count = 0

    def noisy(range_m: float, rate_m_s: float, t_s: float) -> bytes:
        nonlocal count
        count += 1
        return b"\x55\x05rubbish" + encode(range_m, rate_m_s, t_s) if count % 3 == 0 else encode(range_m, rate_m_s, t_s)

    rig = flight(noisy, source="linktrack", endpoint=SERIAL)
    settles(rig)
    assert rig.flight.rejected["bad_frame"] > 100


def test_another_beacon_of_the_same_device_is_never_flown_on():
    near, far = DEVICES["linktrack"](3), DEVICES["linktrack"](4)

    def both(range_m: float, rate_m_s: float, t_s: float) -> bytes:
        return far.encode(range_m + 40.0, rate_m_s, t_s) + near.encode(range_m, rate_m_s, t_s)

    rig = flight(both, source="linktrack", endpoint=SERIAL, beacon_id=3)
    settles(rig)
    assert rig.flight.rejected["wrong_beacon"] > 100
