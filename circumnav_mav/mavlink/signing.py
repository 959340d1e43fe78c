"""MAVLink 2 signing, SANS-IO: sign what is sent, believe only what is rightly signed and newer than what came before.

Source: mavlink.io, "Message Signing". A signature is the link id, a timestamp of 48 bits (units of 10 us since
2015-01-01 UTC) and the first 48 bits of SHA-256(key + frame with CRC + link id + timestamp).
"""

from __future__ import annotations

from hashlib import sha256
from hmac import compare_digest

KEY_BYTES = 32
SIGNATURE_BYTES, HASH_BYTES = 13, 6
FLAG_SIGNED = 0x01
MAGIC_2 = 0xFD
EPOCH_S = 1_420_070_400
"""2015-01-01 00:00 UTC on the Unix clock."""
PER_S = 100_000
NEW_STREAM_BEHIND = 60 * PER_S
"""A sender that is heard for the first time may lag behind our clock by a minute at most."""
LINK_ID = 0
REMEDY = {
    "unsigned": "set up signing in the autopilot too, or leave vehicle.signing_key_file out",
    "wrong key": "the autopilot's key is another than that of vehicle.signing_key_file",
    "replayed": "frames come twice, or somebody sends recorded ones",
    "too old": "the autopilot's clock is more than a minute behind this computer's: set the clock",
}


def timestamp(unix_s: float) -> int:
    """Return the signing time of a wall clock, in units of 10 us since 2015; 0 for a clock that is not set."""
    return max(0, round((unix_s - EPOCH_S) * PER_S))


def key_from(content: bytes) -> bytes:
    """Return the key in a key file: 32 bytes, 64 hexadecimal digits, or the SHA-256 of a passphrase.

    Ground stations make the same key of the same passphrase; 32 printable characters are taken for one, because no
    random key looks like that. Raises ValueError, in words.
    """
    try:
        text = content.decode("utf-8").strip("\r\n")
        printable = text.isprintable()
    except UnicodeDecodeError:
        text, printable = "", False
    if printable and text.strip():
        digits = text.strip()
        if len(digits) == 2 * KEY_BYTES:
            try:
                return bytes.fromhex(digits)
            except ValueError:
                pass
        return sha256(text.encode()).digest()
    if len(content) == KEY_BYTES:
        return content
    if not content.strip():
        raise ValueError("it is empty: write a passphrase, 64 hexadecimal digits or 32 bytes into it")
    raise ValueError(f"{len(content)} bytes are no key: write a passphrase, 64 hexadecimal digits or 32 bytes into it")


class Signer:
    """One link's key and clock. `start` is the signing time at now_s = 0.

    Our timestamps never step back, and follow any later one that is rightly signed, so that a computer without a set
    clock is believed again as soon as it hears the autopilot.
    """

    def __init__(self, key: bytes, start: int, link_id: int = LINK_ID) -> None:
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._start = start
        self._link_id = link_id
        self._last = start
        self._streams: dict[tuple[int, int, int], int] = {}
        self.accepted = 0
        self.refused: dict[str, int] = {}
        """Frames that were not believed, by reason."""

    def advance(self, now_s: float) -> None:
        """Carry our clock to the app's monotonic time."""
        self._last = max(self._last, self._start + int(now_s * PER_S))

    def sign(self, unsigned: bytes) -> bytes:
        """Return the signature of a frame whose signed flag is set already and whose CRC stands at its end."""
        self._last += 1
        body = unsigned + bytes((self._link_id,)) + self._last.to_bytes(6, "little")
        return body[-7:] + sha256(self._key + body).digest()[:HASH_BYTES]

    def believes(self, raw: bytes, sysid: int, compid: int) -> bool:
        """Return whether a frame is rightly signed and new; count why not."""
        why = self._doubt(raw, sysid, compid)
        if why:
            self.refused[why] = self.refused.get(why, 0) + 1
        else:
            self.accepted += 1
        return not why

    def complaint(self) -> str:
        """Return in words why most frames are not believed, and what to do; empty where none was refused."""
        if not self.refused:
            return ""
        why, count = max(self.refused.items(), key=lambda item: item[1])
        return f"{count} {why} ({REMEDY[why]})"

    def _doubt(self, raw: bytes, sysid: int, compid: int) -> str:
        if raw[0] != MAGIC_2 or not raw[2] & FLAG_SIGNED:
            return "unsigned"
        if not compare_digest(sha256(self._key + raw[:-HASH_BYTES]).digest()[:HASH_BYTES], raw[-HASH_BYTES:]):
            return "wrong key"
        stream = (sysid, compid, raw[-SIGNATURE_BYTES])
        stamp = int.from_bytes(raw[-SIGNATURE_BYTES + 1 : -HASH_BYTES], "little")
        newest = self._streams.get(stream)
        if newest is not None and stamp <= newest:
            return "replayed"
        if newest is None and stamp + NEW_STREAM_BEHIND < self._last:
            return "too old"
        self._streams[stream] = stamp
        self._last = max(self._last, stamp)
        return ""
