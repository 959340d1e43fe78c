"""Why no range comes, in words for a person: since the start, or since the last one. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.mavlink.codec import LinkCounts
from circumnav_mav.ranging import ByteSource
from circumnav_mav.ranging.framing import LONGEST_LINE
from circumnav_mav.ranging.plug import Reason, Source

LEAST_BYTES = 64
"""Fewer bytes than this prove nothing about a baud rate."""
TAIL_BYTES = 2 * LONGEST_LINE
SHOWN = 60
TEXT_SHARE = 0.9
"""The least share of printable ASCII in text; of noise it is a third."""
END = frozenset(b"\r\n")
PRINTABLE = frozenset(range(32, 127)) | {9} | END


@dataclass(frozen=True, slots=True)
class Heard:
    """What came over `endpoint` since the start, or since the last range where one has come (`before`).

    messages: names of those that carry ranges; rejected: by reason, of which `echoes` are the autopilot's own; tail:
    the end of what a device wrote; baud: of the device as delivered.
    """

    endpoint: Endpoint
    source: Source
    options: Mapping[str, Any]
    messages: frozenset[str]
    baud: int
    before: bool
    bytes_in: int
    link: LinkCounts
    rejected: Mapping[str, int]
    echoes: int
    tail: bytes


def why_none(heard: Heard) -> str:
    """Return why no range has come, and what to do."""
    endpoint, rejected = heard.endpoint, heard.rejected
    baud = f": another baud rate than {endpoint.baud or heard.baud}?" if endpoint.kind == "serial" else ""
    if not heard.bytes_in:
        return _nothing(heard)
    if heard.messages and heard.link.noise:
        return f"{heard.bytes_in} bytes on {endpoint} that are not MAVLink{baud}"
    if not heard.messages and set(rejected) <= {Reason.BAD_FRAME}:
        return _lines(heard) or _not_its_own(heard, baud)
    if rejected:
        return f"no range can be used: {commonest(rejected, heard.echoes)}"
    names = " or ".join(sorted(heard.messages))
    return f"{heard.link.understood} MAVLink frames on {endpoint}, but no {names}"


def commonest(rejected: Mapping[str, int], echoes: int = 0) -> str:
    """Return how many ranges were rejected and why most were, leaving the autopilot's own (`echoes`) aside."""
    total = sum(rejected.values())
    left = dict(rejected)
    if 0 < echoes < total:
        left[Reason.WRONG_SOURCE] -= echoes
    reason = max(left, key=lambda word: left[word])
    own = f", beside {echoes} of the autopilot's own" if 0 < echoes < total else ""
    return f"{sum(left.values())} rejected, most of them {reason} ({left[reason]}){own}"


def _nothing(heard: Heard) -> str:
    endpoint, who = heard.endpoint, "sender" if heard.messages else "device"
    if not heard.before:
        return f"nothing is heard on {endpoint}: is there a {who}, and does it send to this place?"
    if endpoint.kind == "file":
        return f"nothing more comes from {endpoint}: the recording is over, or has a gap"
    return f"nothing more is heard on {endpoint}: is the {who} on, and the way to it whole?"


def _not_its_own(heard: Heard, baud: str) -> str:
    if heard.bytes_in < LEAST_BYTES:
        return f"only {heard.bytes_in} bytes on {heard.endpoint}: too few to tell what sends them"
    return f"{heard.bytes_in} bytes on {heard.endpoint} that are not {heard.source.name}{baud}"


def _lines(heard: Heard) -> str:
    """Return what is wrong with lines of text that come; empty where none do, as at a wrong baud rate."""
    tail, on, name = heard.tail, heard.endpoint, heard.source.name
    text = sum(byte in PRINTABLE for byte in tail) >= TEXT_SHARE * len(tail)
    if not (isinstance(heard.source, ByteSource) and heard.source.lines and text):
        return ""
    *whole, _ = tail.replace(b"\r", b"\n").split(b"\n")
    said = [line for line in whole if line.strip()]
    if not said:
        shown = _shown(tail)
        return f"text comes on {on}, but no end of a line (CR or LF): {shown}" if len(tail) >= LEAST_BYTES else ""
    line = said[-1]
    if len(line) > LONGEST_LINE:
        return f"lines on {on} are longer than {LONGEST_LINE} bytes, which is too long for {name}: {_shown(line)}"
    if name != "lines":
        return f"lines come on {on}, but {name} finds no range in them: {_shown(line)}"
    if not heard.rejected and "ignore" in heard.options:
        return f"lines come on {on}, but ranging.ignore passes over all of them: {_shown(line)}"
    key = "pattern" if "pattern" in heard.options else "json"
    return f"lines come on {on}, but ranging.{key} finds no range in them: {_shown(line)}"


def _shown(line: bytes) -> str:
    text = line.decode("ascii", "replace").strip()
    return repr(text if len(text) <= SHOWN else text[:SHOWN] + "...")
