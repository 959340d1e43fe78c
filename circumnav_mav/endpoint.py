"""Connection strings, in MAVSDK's spelling and in pymavlink's: who calls whom, and where.

udpin://0.0.0.0:14540      udpin:0.0.0.0:14540     listen, and answer whoever speaks
udpout://192.168.1.5:14580 udpout:192.168.1.5:14580  speak first
tcpout://192.168.1.5:5760  tcp:192.168.1.5:5760    call (tcp:// too, as in MAVSDK)
tcpin://0.0.0.0:5760       tcpin:0.0.0.0:5760      wait for one caller
serial:///dev/ttyACM0:57600  /dev/ttyACM0,57600    a serial port; without a baud rate, the usual one
file://ranges.csv                                  recorded ranges, at their own pace
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_NETWORK = re.compile(r"(?P<kind>[a-z]+):(//)?(?P<host>[^:/\[\]]*):(?P<port>\d+)")
_SERIAL = re.compile(r"(serial:(//)?)?(?P<device>/.+?|COM\d+)([:,](?P<baud>\d+))?", re.IGNORECASE)
_KINDS = {"udpin": "udpin", "udpout": "udpout", "udp": "udpin", "tcp": "tcpout", "tcpout": "tcpout", "tcpin": "tcpin"}
_CALLS = ("udpout", "tcpout")
USUAL_BAUD = 57_600
"""Where a MAVLink link names none: what PX4's TELEM 1 and MAVSDK take."""
LEAST_BAUD, MOST_BAUD = 1200, 12_000_000

FORMS = (
    "udpin://0.0.0.0:14540 (listen), udpout://192.168.1.5:14580 (call), tcpout://192.168.1.5:5760, "
    "tcpin://0.0.0.0:5760 or serial:///dev/ttyACM0:57600"
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a link is opened. kind: udpin, udpout, tcpin, tcpout (host, port), serial (path, baud) or file (path).

    baud 0: not given.
    """

    kind: str
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 0

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"serial://{self.path}:{self.baud}" if self.baud else f"serial://{self.path}"
        if self.kind == "file":
            return f"file://{self.path}"
        return f"{self.kind}://{self.host}:{self.port}"


def parse(text: str) -> Endpoint:
    """Return the endpoint that `text` names. Raises ValueError saying what a right one looks like."""
    text = text.strip()
    if text.startswith("file:") and (path := re.sub("^file:(//)?", "", text)):
        return Endpoint("file", path=path)
    if match := _SERIAL.fullmatch(text):
        return _serial(text, match)
    match = _NETWORK.fullmatch(text)
    kind = _KINDS.get(match["kind"]) if match else None
    if match is None or kind is None:
        raise ValueError(f"{text!r} is no link: write {FORMS}")
    port = int(match["port"])
    if not (0 < port < 65536 or (port == 0 and kind not in _CALLS)):
        raise ValueError(f"{text!r}: the port must lie between 1 and 65535")
    if kind in _CALLS and not match["host"]:
        raise ValueError(f"{text!r}: {kind} needs the address to call, as in {kind}://192.168.1.5:14580")
    return Endpoint(kind, match["host"] or "0.0.0.0", port)


def _serial(text: str, match: re.Match[str]) -> Endpoint:
    baud = int(match["baud"] or 0)
    if match["baud"] and not LEAST_BAUD <= baud <= MOST_BAUD:
        raise ValueError(f"{text!r}: the baud rate must lie between {LEAST_BAUD} and {MOST_BAUD}, as in {EXAMPLE}")
    return Endpoint("serial", path=match["device"], baud=baud)


EXAMPLE = "serial:///dev/ttyACM0:57600"
