"""`circumnav check CONFIG --live`: listen to a real vehicle, and say in a table what would stop a flight."""

from __future__ import annotations

import asyncio
import textwrap
from collections.abc import Iterator
from functools import partial

from circumnav_mav.config import Config
from circumnav_mav.readiness import Audit
from circumnav_mav.runtime.clock import Clock, new_event_loop, run_on_grid
from circumnav_mav.runtime.keyfile import open_signer
from circumnav_mav.runtime.links import open_ranging_link, open_vehicle_link
from circumnav_mav.runtime.transport import Transport
from circumnav_mav.settings_check import Finding, Severity

RATE_HZ = 20.0
MARK = {Severity.OK: "ok", Severity.WARNING: "warning", Severity.ERROR: "ERROR"}
WIDTH = 100
INDENT = " " * 28


def listen(config: Config, seconds: float) -> list[Finding]:
    """Listen for so long and return the findings. Raises LinkError where a link cannot be opened."""
    clock = Clock()
    audit = Audit(config, open_signer(config.vehicle.signing_key_file, clock.now()))
    links: list[Transport] = []
    loop = new_event_loop()
    try:
        links.append(open_vehicle_link(config.vehicle))
        if (own := audit.ranges.endpoint) is not None:
            links.append(open_ranging_link(own, audit.ranges))
        loop.run_until_complete(_run(audit, links, clock, seconds))
    finally:
        for link in links:
            link.close()
        loop.close()
    return audit.findings(clock.now())


async def _run(audit: Audit, links: list[Transport], clock: Clock, seconds: float) -> None:
    loop = asyncio.get_running_loop()

    def on_data(ranging: bool, link: Transport, data: bytes) -> bool:
        return audit.receive(data, clock.now(), ranging=ranging, whole=link.whole)

    for i, link in enumerate(links):
        link.start(loop, partial(on_data, i == 1, link), lambda up, words: None)

    def tick(now_s: float, lateness_s: float, missed: int) -> bool:
        for frame in audit.tick(now_s):
            links[0].send(frame)
        for frame in audit.questions(now_s):
            links[-1].send(frame)
        return now_s < seconds

    await run_on_grid(clock, RATE_HZ, tick)


def table(findings: list[Finding]) -> Iterator[str]:
    """Yield the findings as lines, each fix below what it mends, and a last line that sums up."""
    for f in findings:
        yield from _lines(f"{MARK[f.severity]:<9}{f.what:<18} ", f.text)
        if f.fix:
            yield from _lines(f"{'':<24}-> ", f.fix)
    errors = sum(f.severity is Severity.ERROR for f in findings)
    warnings = sum(f.severity is Severity.WARNING for f in findings)
    if errors:
        yield f"not ready: {errors} error{'s' * (errors > 1)}, {warnings} warning{'s' * (warnings != 1)}"
    elif warnings:
        yield f"can fly, but read the {warnings} warning{'s' * (warnings > 1)} first"
    else:
        yield "ready"


def _lines(head: str, text: str) -> list[str]:
    # A finding without words must be seen too: it is counted.
    return textwrap.wrap(text or "-", WIDTH, initial_indent=head, subsequent_indent=INDENT, break_long_words=False)
