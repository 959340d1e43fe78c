"""How `circumnav ranging` shows a sensor: a table that moves on a terminal, a line a second elsewhere."""

from __future__ import annotations

import os
import sys
from collections import deque
from math import isfinite, nan
from typing import Any, Protocol, TextIO

from circumnav_mav.ranging.monitor import Status

PLAIN_EVERY_S = 1.0
EVENTS_SHOWN = 5


class RangingView(Protocol):
    """Where a sensor's figures are shown."""

    def show(self, now_s: float, status: Status, hint: str) -> None:
        """Show the present figures; `hint`: why no range comes."""

    def event(self, now_s: float, text: str) -> None:
        """Show something that happened."""

    def close(self) -> None:
        """Stop showing."""


def open_ranging_view(title: str) -> RangingView:
    """Return the view that fits: live on a terminal, plain lines elsewhere."""
    return LiveRangingView(title) if sys.stdout.isatty() else PlainRangingView(sys.stdout)


class PlainRangingView:
    """A line a second, for logs and pipes."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._next_s = PLAIN_EVERY_S

    def show(self, now_s: float, status: Status, hint: str) -> None:
        """Print a line when the last one is old enough."""
        if now_s >= self._next_s:
            self._next_s = now_s + PLAIN_EVERY_S - (now_s - self._next_s) % PLAIN_EVERY_S
            self.event(now_s, line(status, hint))

    def event(self, now_s: float, text: str) -> None:
        """Print it; a closed pipe ends the printing, not the listening."""
        try:
            print(f"{now_s:8.1f} s  {text}", file=self._out, flush=True)
        except BrokenPipeError:
            self._out = open(os.devnull, "w")  # noqa: SIM115, PTH123

    def close(self) -> None:
        """Nothing to stop."""


class LiveRangingView:
    """A table, drawn anew four times a second."""

    def __init__(self, title: str) -> None:
        from rich.console import Console
        from rich.live import Live

        self._title = title
        self._events: deque[str] = deque(maxlen=EVENTS_SHOWN)
        self._live = Live(console=Console(), auto_refresh=False)
        self._live.start()

    def show(self, now_s: float, status: Status, hint: str) -> None:
        """Draw the figures."""
        title = f"{self._title}  {now_s:.1f} s"
        self._live.update(draw(status, hint, title, list(self._events)), refresh=True)

    def event(self, now_s: float, text: str) -> None:
        """Add it to the last few."""
        self._events.append(f"{now_s:8.1f} s  {text}")

    def close(self) -> None:
        """Leave the last table standing."""
        self._live.stop()


def number(value: float, form: str, unit: str = "") -> str:
    """Return a value for people; a dash where it is not known."""
    return f"{value:{form}}{unit}" if isfinite(value) else "-"


def line(s: Status, hint: str) -> str:
    """Return the figures in one line."""
    last_m = s.last.range_m if s.last else nan
    rate_m_s = s.last.range_rate_m_s if s.last else nan
    text = (
        f"range {number(last_m, '.3f', ' m')}  range rate {number(rate_m_s, '+.2f', ' m/s')}  "
        f"{number(s.rate_hz, '.1f', ' Hz')}  age {number(s.age_s, '.2f', ' s')}  "
        f"jitter {number(s.jitter_s * 1e3, '.1f', ' ms')}  noise {number(s.noise_m, '.3f', ' m')}  "
        f"accepted {s.accepted}  rejected {sum(s.rejected.values())}{_reasons(s)}"
    )
    return f"{text}  {hint}".rstrip()


def _reasons(s: Status) -> str:
    if not s.rejected:
        return ""
    return f" ({', '.join(f'{reason} {count}' for reason, count in s.rejected.items())})"


def draw(s: Status, hint: str, title: str, events: list[str]) -> Any:
    """Return the table, as rich draws it."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    last = s.last
    beacon = "-" if last is None or last.beacon_id is None else str(last.beacon_id)
    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(justify="right")
    for row in (
        ("range", number(last.range_m if last else nan, ".3f", " m"), "rate", number(s.rate_hz, ".1f", " Hz")),
        ("range rate", number(last.range_rate_m_s if last else nan, "+.2f", " m/s"), "beacon", beacon),
        ("age", number(s.age_s, ".2f", " s"), s.delay_name, number(s.delay_s * 1e3, ".1f", " ms")),
        ("jitter", number(s.jitter_s * 1e3, ".1f", " ms"), "longest gap", number(s.longest_gap_s, ".2f", " s")),
        ("noise", number(s.noise_m, ".3f", " m"), "accepted", str(s.accepted)),
    ):
        table.add_row(Text(row[0], style="dim"), row[1], Text(row[2], style="dim"), row[3])
    rejected = [
        Text(f"rejected {count} {reason}: {s.details.get(reason, '')}", style="yellow")
        for reason, count in s.rejected.items()
    ]
    head = Text(hint, style="red") if hint else Text("listening; Ctrl-C ends", style="dim")
    body = Group(head, Text(), table, Text(), *rejected, *(Text(e, style="dim") for e in events))
    return Panel(body, title=title, width=96)
