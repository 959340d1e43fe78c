"""MAVLink 2 signing of one link: what leaves is signed, what comes in must be."""

from __future__ import annotations

import hashlib

from sitl_stub import wire

EPOCH_UNIX_S = 1_420_070_400  # timestamps count 10 us since 2015-01-01
UNSIGNED_ALLOWED = frozenset({109})  # RADIO_STATUS, made by radios on the way
OLDEST = 6_000_000  # a new sender may be a minute behind


def key_of(passphrase: str | None) -> bytes:
    """Return the key that MAVProxy and others make of a passphrase; none: no key. ValueError: it is empty."""
    if passphrase == "":
        raise ValueError("--sign: the passphrase is empty")
    return hashlib.sha256(passphrase.encode()).digest() if passphrase is not None else b""


class Signer:
    """Signs and checks frames with a key of 32 bytes."""

    def __init__(self, key: bytes, link_id: int) -> None:
        if len(key) != 32:
            raise ValueError(f"a signing key has 32 bytes, not {len(key)}")
        self._key, self._link_id = key, link_id
        self._last = 0
        self._streams: dict[tuple[int, int, int], int] = {}
        self.rejected = 0

    def signature(self, frame: bytes, unix_us: int) -> bytes:
        """Return the 13 bytes that follow a frame whose header already says that it is signed."""
        self._last = max(self._last + 1, (unix_us - EPOCH_UNIX_S * 1_000_000) // 10)
        tail = bytes((self._link_id,)) + self._last.to_bytes(6, "little")
        return tail + hashlib.sha256(self._key + frame + tail).digest()[:6]

    def accepts(self, raw: bytes) -> bool:
        """Say whether a frame is signed with our key and is not an old one played again."""
        if wire.msgid_of(raw) in UNSIGNED_ALLOWED:
            return True
        if raw[0] != wire.V2_MAGIC or not raw[2] & wire.SIGNED or not self._fresh(raw):
            self.rejected += 1
            return False
        return True

    def _fresh(self, raw: bytes) -> bool:
        frame, tail = raw[:-13], raw[-13:-6]
        if hashlib.sha256(self._key + frame + tail).digest()[:6] != raw[-6:]:
            return False
        stream, stamp = (raw[5], raw[6], tail[0]), int.from_bytes(tail[1:], "little")
        if stamp <= self._streams.get(stream, self._last - OLDEST):
            return False
        self._streams[stream] = stamp
        return True
