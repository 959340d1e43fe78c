"""Connection strings, in MAVSDK's spelling (udpin://0.0.0.0:14540) and in pymavlink's (udpin:0.0.0.0:14540)."""

from __future__ import annotations

import re
from dataclasses import dataclass

_FORM = re.compile(r"^(?P<kind>[a-z]+):(//)?(?P<host>[^:/]*):(?P<port>\d+)$")
_KINDS = {"udpin": "udpin", "udpout": "udpout", "udp": "udpin"}


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a link is opened. kind: udpin (bind and answer whoever speaks) or udpout (speak first)."""

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}://{self.host}:{self.port}"


def parse(text: str) -> Endpoint:
    """Return the endpoint that `text` names. Raises ValueError saying what a right one looks like."""
    match = _FORM.match(text.strip())
    kind = _KINDS.get(match["kind"]) if match else None
    if match is None or kind is None:
        raise ValueError(
            f"'{text}' is no link: write udpin://0.0.0.0:14540 (listen) or udpout://192.168.1.5:14580 (call)"
        )
    port = int(match["port"])
    if not (0 < port < 65536 or (port == 0 and kind == "udpin")):
        raise ValueError(f"'{text}': the port must lie between 1 and 65535")
    if kind == "udpout" and not match["host"]:
        raise ValueError(f"'{text}': udpout needs the address to call, as in udpout://192.168.1.5:14580")
    return Endpoint(kind, match["host"] or "0.0.0.0", port)
