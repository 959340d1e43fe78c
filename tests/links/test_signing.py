"""MAVLink 2 signing against pymavlink's own, both ways; and a flight on a signed link among liars."""

from __future__ import annotations

import hashlib
import os

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.flight import Flight
from circumnav_mav.mavlink.codec import Frame, Packer, Splitter
from circumnav_mav.mavlink.signing import Signer, key_from, timestamp
from circumnav_mav.runtime.app import no_autopilot
from circumnav_mav.runtime.keyfile import open_signer
from circumnav_mav.runtime.transport import LinkError
from tests.lockstep import OFFBOARD_LINK, Rig, airborne, config

KEY, OTHER = bytes(range(32)), bytes(32)
NOW = timestamp(1_800_000_000.0)
MINUTE = 60 * 100_000


def theirs(key: bytes = KEY, stamp: int = NOW, *, system: int = 1, component: int = 1, link: int = 3):
    """Return pymavlink's end of a signed link."""
    mav = mavlink.MAVLink(None, system, component)
    mav.signing.secret_key = key
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = stamp
    mav.signing.link_id = link
    return mav


def heartbeat(mav, mode: int = 0) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0x81, mode, 4, 3).pack(mav))


def frame_of(raw: bytes) -> Frame:
    (frame,) = Splitter().feed(raw, whole=True)
    return frame


def believes(signer: Signer, raw: bytes) -> bool:
    return all(signer.believes(f.raw, f.sysid, f.compid) for f in Splitter().feed(raw, whole=True))


def ours(signer: Signer) -> Packer:
    return Packer(1, 191, signer)


def system_time(packer: Packer, i: int = 1) -> bytes:
    return packer.pack("SYSTEM_TIME", time_unix_usec=i, time_boot_ms=0)


def test_pymavlink_believes_what_we_sign():
    packer, mav = ours(Signer(KEY, NOW)), theirs()
    for i in range(300):  # the sequence number wraps
        message = mav.decode(bytearray(system_time(packer, i)))
        assert message.time_unix_usec == i and message.get_signed()


def test_pymavlink_does_not_believe_another_key():
    with pytest.raises(mavlink.MAVError, match="signature"):
        theirs(OTHER).decode(bytearray(system_time(ours(Signer(KEY, NOW)))))


def test_we_believe_what_pymavlink_signs_and_its_fields_are_read():
    signer, mav = Signer(KEY, NOW), theirs()
    for _ in range(300):
        assert believes(signer, heartbeat(mav))
    assert signer.accepted == 300 and not signer.refused


def test_no_byte_of_a_signed_frame_can_be_changed():
    raw = heartbeat(theirs())
    for at in range(len(raw)):
        for bit in (0x01, 0x80):
            forged = bytearray(raw)
            forged[at] ^= bit
            frames = Splitter().feed(bytes(forged), whole=True)
            signer = Signer(KEY, NOW)
            assert not any(signer.believes(f.raw, f.sysid, f.compid) for f in frames), at


def test_unsigned_and_version_1_frames_are_refused():
    signer, plain = Signer(KEY, NOW), mavlink.MAVLink(None, 1, 1)
    assert not believes(signer, heartbeat(plain))
    version_1 = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(plain, force_mavlink1=True))
    assert not believes(signer, version_1)
    assert signer.refused == {"unsigned": 2}


def test_a_replay_is_refused_and_each_stream_counts_for_itself():
    signer, mav = Signer(KEY, NOW), theirs()
    first, second = heartbeat(mav), heartbeat(mav)
    assert believes(signer, second)
    assert not believes(signer, second) and not believes(signer, first)
    assert signer.refused == {"replayed": 2}
    for other in (theirs(system=2), theirs(component=2), theirs(link=4)):
        assert believes(signer, heartbeat(other))


def test_a_refused_frame_does_not_move_the_clock_of_its_stream():
    signer, mav = Signer(KEY, NOW), theirs()
    assert believes(signer, heartbeat(mav))
    assert not believes(signer, heartbeat(theirs(OTHER, NOW + 50 * MINUTE)))
    assert believes(signer, heartbeat(mav))


def test_a_new_stream_may_lag_by_a_minute_and_no_more():
    assert believes(Signer(KEY, NOW), heartbeat(theirs(stamp=NOW - MINUTE)))
    signer = Signer(KEY, NOW)
    assert not believes(signer, heartbeat(theirs(stamp=NOW - MINUTE - 2)))
    assert signer.refused == {"too old": 1}


def stamp_of(raw: bytes) -> int:
    return int.from_bytes(raw[-12:-6], "little")


def test_our_timestamps_rise_with_time_and_never_repeat():
    signer = Signer(KEY, NOW)
    packer = ours(signer)
    burst = [stamp_of(system_time(packer)) for _ in range(1000)]
    assert burst == sorted(set(burst)) and burst[0] > NOW
    signer.advance(20.0)
    later = stamp_of(system_time(packer))
    assert later == NOW + 20 * 100_000 + 1
    signer.advance(1.0)
    assert stamp_of(system_time(packer)) > later


def test_a_restart_with_a_right_clock_goes_on_and_with_a_wrong_one_follows_the_autopilot():
    autopilot = theirs()
    last = stamp_of(system_time(ours(Signer(KEY, NOW))))
    restarted = Signer(KEY, NOW + 5 * 100_000)
    assert stamp_of(system_time(ours(restarted))) > last
    unset = Signer(KEY, timestamp(0.0))  # 1970: a computer without a clock of its own
    assert stamp_of(system_time(ours(unset))) < last
    assert believes(unset, heartbeat(autopilot))
    autopilot.signing.timestamp = max(autopilot.signing.timestamp, last)
    assert autopilot.decode(bytearray(system_time(ours(unset)))).get_signed()


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (KEY, KEY),
        (bytes([0xFF]) * 32, bytes([0xFF]) * 32),
        (KEY.hex().encode() + b"\n", KEY),
        (KEY.hex().upper().encode(), KEY),
        (b"correct horse battery staple\n", hashlib.sha256(b"correct horse battery staple").digest()),
        (b"correct horse battery staple", hashlib.sha256(b"correct horse battery staple").digest()),
        ("Grüße".encode(), hashlib.sha256("Grüße".encode()).digest()),
        (b"a passphrase of 32 characters, 1", hashlib.sha256(b"a passphrase of 32 characters, 1").digest()),
        (b"g" * 64, hashlib.sha256(b"g" * 64).digest()),
    ],
)
def test_a_key_in_each_form(content, key):
    assert key_from(content) == key


@pytest.mark.parametrize("content", [b"", b"\n", b"  \n", bytes(31), b"two\nlines", b"\xff\xfe\x00"])
def test_what_is_no_key_is_refused(content):
    with pytest.raises(ValueError, match="write a passphrase, 64 hexadecimal digits or 32 bytes"):
        key_from(content)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660])
def test_a_key_that_others_may_read_is_refused(tmp_path, mode):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(mode)
    with pytest.raises(LinkError, match=f"others may read it \\(mode {mode:o}\\): chmod 600"):
        open_signer(str(path), 0.0)


def test_a_key_file_is_read_and_what_is_wrong_with_it_said(tmp_path):
    path = tmp_path / "key"
    with pytest.raises(LinkError, match="cannot read it: No such file"):
        open_signer(str(path), 0.0)
    path.touch(mode=0o600)
    with pytest.raises(LinkError, match="it is empty"):
        open_signer(str(path), 0.0)
    path.write_bytes(KEY)
    for mode in (0o600, 0o400):
        os.chmod(path, mode)  # noqa: PTH101
        signer = open_signer(str(path), 0.0)
        assert signer is not None and believes(signer, heartbeat(theirs(stamp=timestamp(1.9e9))))
    assert open_signer(None, 0.0) is None


class SignedRig(Rig):
    """The stub knows no signing: pymavlink signs for it, and checks for it what the app sent."""

    def __init__(self, **more) -> None:
        super().__init__(config(orbit={"radius_m": 30.0}), airborne(distance_m=60.0, **more))
        self.flight = Flight(self.config, Signer(KEY, NOW))
        self.vehicle, self.reader, self.plain = theirs(), theirs(), mavlink.MAVLink(None, 1, 191)
        self.lies: list[bytes] = []
        self._take = self.stub.take
        self.stub.take = self.signed  # type: ignore[method-assign]

    def signed(self, link: str) -> list[bytes]:
        reader, taken = mavlink.MAVLink(None), []
        for raw in self._take(link):
            for message in reader.parse_buffer(bytearray(raw)) or []:
                if isinstance(message, mavlink.MAVLink_unknown):
                    continue
                self.vehicle.srcSystem, self.vehicle.srcComponent = message.get_srcSystem(), message.get_srcComponent()
                self.vehicle.seq = message.get_seq()
                taken.append(bytes(message.pack(self.vehicle)))
        return taken + (self.lies if link == OFFBOARD_LINK else [])

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            message = self.reader.decode(bytearray(frame))  # raises for a signature that is not right
            assert message.get_signed()
            self.app_frames.append((self.now_s, frame))
            self.stub.receive(OFFBOARD_LINK, bytes(message.pack(self.plain)))

    def decoded(self, from_s: float = 0.0):
        return [(t, mavlink.MAVLink(None).decode(bytearray(f))) for t, f in self.app_frames if t >= from_s]


def test_a_signed_flight_circles_and_forged_or_repeated_modes_move_nothing():
    rig = SignedRig()
    rig.engage()
    rig.run(20.0)
    hold = 0x03040000
    rig.lies = [
        heartbeat(mavlink.MAVLink(None, 1, 1), hold),  # unsigned
        heartbeat(theirs(OTHER, NOW + 5 * MINUTE), hold),  # another key
        heartbeat(theirs(stamp=NOW - 1), hold),  # recorded before the flight
    ]
    log = rig.run(20.0)
    assert log.ticks[-1].control == "held" and log.ticks[-1].phase in ("acquiring", "orbiting")
    assert len(log.sent(rig.now_s - 10.0)) > 400
    refused = rig.flight.link.signer.refused
    assert refused["unsigned"] > 500 and refused["wrong key"] > 500 and refused["replayed"] > 500


def test_a_link_on_which_nothing_is_believed_says_why():
    flight = Flight(config(), Signer(KEY, NOW))
    for raw in (heartbeat(theirs(OTHER)), heartbeat(theirs(OTHER)), heartbeat(mavlink.MAVLink(None, 1, 1))):
        assert len(flight.receive(raw, 1.0)) == 1  # recorded all the same
    words = no_autopilot("udpin://0.0.0.0:14540", flight)
    assert "2 wrong key" in words and "signing_key_file" in words
    assert flight.link.autopilot.sysid is None


def test_an_autopilot_that_signs_while_we_have_no_key_is_told_of_once():
    flight = Flight(config())
    mav = theirs()
    for i in range(5):
        flight.receive(heartbeat(mav), 1.0 + i)
        flight.tick(1.0 + i)
    assert [event.text for event in flight.events if "signs" in event.text] == [
        "the autopilot signs its messages: without vehicle.signing_key_file it obeys nothing"
    ]
