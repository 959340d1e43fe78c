"""Why no range comes, in words for a person: since the start, or since the last one. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.mavlink.autopilot import AUTOPILOT_COMPONENT
from circumnav_mav.mavlink.codec import LinkCounts, Splitter
from circumnav_mav.ranging import SOURCES, ByteSource, MessageSource
from circumnav_mav.ranging.framing import LONGEST_LINE
from circumnav_mav.ranging.plug import Reading, Reason, Source

LEAST_BYTES = 64
"""Fewer bytes than this prove nothing about a baud rate."""
TAIL_BYTES = 2 * LONGEST_LINE
LEAST_READ = 3
"""So many readings of another source, beside half as many lines or pieces that it cannot read, prove that source."""
CARRIERS = {
    i: source.name for source in SOURCES.values() if isinstance(source, MessageSource) for i in source.message_ids
}
"""The source by the id of the MAVLink message that carries its ranges."""
SHOWN = 60
TEXT_SHARE = 0.9
"""The least share of printable ASCII in text; of noise it is a third."""
END = frozenset(b"\r\n")
PRINTABLE = frozenset(range(32, 127)) | {9} | END


@dataclass(frozen=True, slots=True)
class Heard:
    """What came over `endpoint` since the start, or since the last range where one has come (`before`).

    messages: names of those that carry ranges; others: sources whose messages came besides, not of the autopilot;
    rejected: by reason, of which `echoes` are the autopilot's own; tail: the end of what came; baud: of the device as
    delivered.
    """

    endpoint: Endpoint
    source: Source
    options: Mapping[str, Any]
    messages: frozenset[str]
    others: frozenset[str]
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
    if not heard.bytes_in:
        return _nothing(heard)
    if heard.messages and heard.link.noise:
        return f"{heard.bytes_in} bytes on {endpoint} that are not MAVLink{_what_then(heard)}"
    if not heard.messages and set(rejected) <= {Reason.BAD_FRAME}:
        return _lines(heard) or _not_its_own(heard)
    also = f"; {_instead(heard.others)}" if heard.others else ""
    if rejected and heard.echoes == sum(rejected.values()):
        own = f"only the autopilot's own ranges come on {endpoint} ({heard.echoes})"
        return f"{own}: is the radio on, and does it send to this place?{also}"
    if rejected:
        return f"no range can be used: {commonest(rejected, heard.echoes)}{also}"
    names = " or ".join(sorted(heard.messages))
    return f"{heard.link.understood} MAVLink frames on {endpoint}, but no {names}{also}"


def _what_then(heard: Heard) -> str:
    """Return what else the bytes are: those of another source, or of another baud rate, as far as can be told."""
    if found := _read_by(heard.tail, heard.source):
        return f"; {_instead(found)}"
    if not heard.messages and Splitter().feed(heard.tail, whole=False)[LEAST_READ - 1 :]:
        return ", but MAVLink without a range: is this the autopilot's port?"
    serial = heard.endpoint.kind == "serial"
    return f": another baud rate than {heard.endpoint.baud or heard.baud}?" if serial else ""


def _instead(names: Iterable[str]) -> str:
    """Return what to do about ranges of other sources."""
    return f"ranges of {' or '.join(sorted(names))} come there: set ranging.source"


def _read_by(tail: bytes, own: Source) -> set[str]:
    """Return the other sources that find their ranges in what came."""
    frames = [] if isinstance(own, MessageSource) else Splitter().feed(tail, whole=False)
    found = {CARRIERS[f.msgid] for f in frames if f.msgid in CARRIERS and f.compid != AUTOPILOT_COMPONENT}
    for source in SOURCES.values():
        if source is own or not isinstance(source, ByteSource) or source.named is not None:
            continue  # `named`: options must say where its range stands
        results = source.decoder({}).feed(tail, 0.0)
        read = sum(isinstance(result, Reading) for result in results)
        if read >= LEAST_READ and len(results) - read <= read // 2:
            found.add(source.name)
    return found


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


def _not_its_own(heard: Heard) -> str:
    if heard.bytes_in < LEAST_BYTES:
        return f"only {heard.bytes_in} bytes on {heard.endpoint}: too few to tell what sends them"
    return f"{heard.bytes_in} bytes on {heard.endpoint} that are not {heard.source.name}{_what_then(heard)}"


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
    if name == "lines" and not heard.rejected and "ignore" in heard.options:
        return f"lines come on {on}, but ranging.ignore passes over all of them: {_shown(line)}"
    reader = name if name != "lines" else "ranging.pattern" if "pattern" in heard.options else "ranging.json"
    found = _read_by(tail, heard.source)
    return f"lines come on {on}, but {reader} finds no range in them: {_shown(line)}" + (
        f"; {_instead(found)}" if found else ""
    )


def _shown(line: bytes) -> str:
    text = line.decode("ascii", "replace").strip()
    return repr(text if len(text) <= SHOWN else text[:SHOWN] + "...")
