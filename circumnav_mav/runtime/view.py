"""The live terminal view. It runs in a process of its own, so that drawing never takes time from the ticks.

The flight writes one JSON line four times a second to the viewer's standard input and never waits for it. Without a
terminal, phases and a line every ten seconds are printed instead.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from math import isfinite
from typing import Any, Protocol, TextIO

REFRESH_HZ = 4.0
PLAIN_EVERY_S = 10.0


class View(Protocol):
    """Where a flight shows itself."""

    def show(self, snapshot: dict[str, Any]) -> None:
        """Show the present state."""

    def event(self, t_s: float, text: str) -> None:
        """Show something that happened."""

    def close(self) -> None:
        """Stop showing."""


def open_view(title: str) -> View:
    """Return the view that fits: live on a terminal, plain lines elsewhere."""
    return LiveView(title) if sys.stdout.isatty() else PlainView(sys.stdout)


class PlainView:
    """Lines, for logs and pipes."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._next_s = 0.0

    def show(self, snapshot: dict[str, Any]) -> None:
        """Print a line when the last one is old enough."""
        if snapshot["t_s"] >= self._next_s:
            self._next_s = snapshot["t_s"] + PLAIN_EVERY_S
            self._print(snapshot["t_s"], summary_line(snapshot))

    def event(self, t_s: float, text: str) -> None:
        """Print it."""
        self._print(t_s, text)

    def _print(self, t_s: float, text: str) -> None:
        try:
            print(f"{t_s:8.1f} s  {text}", file=self._out, flush=True)
        except OSError:
            self._out = open(os.devnull, "w")  # noqa: SIM115, PTH123 - a closed pipe must not end a flight

    def close(self) -> None:
        """Nothing to stop."""


class LiveView:
    """The child process that draws, fed through a pipe that is never waited for."""

    def __init__(self, title: str) -> None:
        command = [sys.executable, "-m", "circumnav_mav.runtime.view", title]
        # A session of its own: Ctrl-C is for the flight, which then ends politely and closes the pipe.
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)
        assert self._child.stdin is not None
        self._pipe = self._child.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def show(self, snapshot: dict[str, Any]) -> None:
        """Hand the state to the child; drop it if the child is busy."""
        self._write({"show": snapshot})

    def event(self, t_s: float, text: str) -> None:
        """Hand the event to the child."""
        self._write({"event": f"{t_s:8.1f} s  {text}"})

    def _write(self, item: dict[str, Any]) -> None:
        with suppress(OSError):  # a viewer that is slow or gone must not matter to a flight
            os.write(self._pipe, (json.dumps(item) + "\n").encode())

    def close(self) -> None:
        """Let the child draw the last picture and go."""
        assert self._child.stdin is not None
        self._child.stdin.close()
        try:
            self._child.wait(timeout=3.0)
        except subprocess.TimeoutExpired:
            self._child.kill()


def number(value: Any, form: str, unit: str = "") -> str:
    """Return a value for people; a dash where it is not known."""
    known = isinstance(value, int | float) and isfinite(value)
    return f"{value:{form}}{unit}" if known else "-"


def summary_line(s: dict[str, Any]) -> str:
    """Return the state in one line."""
    target = f"target {s['target']}  " if s["target"] else ""
    return (
        f"{s['phase']:<12} r {number(s['r_m'], '.1f', ' m')}  error {number(s['error_m'], '+.2f', ' m')}  "
        f"u {number(s['turn_rate_rad_s'], '+.3f', ' rad/s')}  {target}rejected {s['rejected']}  {s['waiting_for']}"
    ).rstrip()


def draw(s: dict[str, Any], title: str, events: list[str]) -> Any:
    """Return the picture of one state, as rich draws it."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    colour = {
        "orbiting": "green",
        "acquiring": "cyan",
        "coasting": "yellow",
        "range_lost": "red",
        "broken_off": "red",
        "released": "red",
    }
    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(justify="right")
    rows = [
        ("range", number(s["r_m"], ".1f", " m"), "orbit error", number(s["error_m"], "+.2f", " m")),
        (
            "range rate",
            number(s["r_dot_m_s"], "+.2f", " m/s"),
            "turn rate",
            number(s["turn_rate_rad_s"], "+.3f", " rad/s"),
        ),
        (
            "speed",
            number(s["speed_m_s"], ".2f", f" m/s ({s['speed_source']})"),
            "height",
            number(s["height_m"], ".1f", " m"),
        ),
        ("range age", number(s["sample_age_s"], ".2f", " s"), "rejected", s["rejected"]),
        ("lateness", number(s["lateness_ms"], ".2f", " ms"), "missed ticks", str(s["missed_ticks"])),
        ("autopilot", s["mode"] or "-", "authority", s["control"]),
        ("turn rate limited", s["limited"] or "-", "", ""),
    ]
    for row in rows:
        table.add_row(Text(row[0], style="dim"), row[1], Text(row[2], style="dim"), row[3])
    if s["target"]:
        places = [Text.assemble(("target from here  ", "dim"), s["target"])]
        places += [Text.assemble(("drift             ", "dim"), s["drift"])] if s["drift"] else []
    else:
        places = []
    phase = s["phase"]
    head = Text.assemble((phase, f"bold {colour.get(phase, 'white')}"), "  ", s["waiting_for"] or s["reason"])
    body = Group(head, Text(), table, *places, Text(), *(Text(e, style="dim") for e in events[-5:]))
    return Panel(body, title=f"{title}  {s['t_s']:.1f} s", width=86)


def main() -> None:
    """Draw what comes on standard input until it ends."""
    from rich.console import Console
    from rich.live import Live

    events: list[str] = []
    last: dict[str, Any] | None = None
    with Live(console=Console(), auto_refresh=False) as live:
        for line in sys.stdin:
            try:
                item = json.loads(line)
            except ValueError:
                continue  # the tail of a line that did not fit into the pipe
            if "event" in item:
                events.append(item["event"])
            last = item.get("show", last)
            if last is not None:
                live.update(draw(last, sys.argv[1], events), refresh=True)


if __name__ == "__main__":
    main()
