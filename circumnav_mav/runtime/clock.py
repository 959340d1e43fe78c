"""Monotonic time, and the fixed grid on which setpoints leave."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable
from math import ceil

QUIET_S = 0.001
"""The last moment before a tick, in wall seconds, is slept outside the event loop: no datagram gets in between."""


class Clock:
    """Flight seconds since this clock was made: monotonic, never the wall's. speed: flight seconds a wall second."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self.held_s = 0.0  # wall time that did not count as flight
        self._start_s = time.monotonic()

    def now(self) -> float:
        """Return the flight time, s."""
        return (time.monotonic() - self._start_s) * self.speed

    def left_s(self, flight_s: float) -> float:
        """Return the wall time until a flight time, s; 0 where it has passed."""
        return max(0.0, (flight_s - self.now()) / self.speed)

    async def sleep_until(self, flight_s: float) -> None:
        """Sleep to a flight time; at once where it has passed (other tasks still get their turn)."""
        await asyncio.sleep(max(0.0, self.left_s(flight_s) - QUIET_S))
        self._sleep_quietly_until(flight_s)

    def _sleep_quietly_until(self, flight_s: float) -> None:
        """Sleep like a bare loop; a timer of the event loop comes after the datagrams that woke with it."""
        if (left_s := self.left_s(flight_s)) > 0.0:
            time.sleep(left_s)


async def run_on_grid(clock: Clock, rate_hz: float, tick: Callable[[float, float, int], bool]) -> None:
    """Call tick(now_s, lateness_s, missed) on the grid start + n / rate_hz until it returns False.

    A missed grid point is skipped and counted, never made up for in a burst. now_s: flight time; lateness_s: how long
    after its grid point the tick began, in wall seconds; missed: grid points skipped since the tick before.
    """
    start_s = clock.now()
    n = missed = 0
    while tick(now_s := clock.now(), (now_s - start_s - n / rate_hz) / clock.speed, missed):
        n_next = max(n + 1, ceil((clock.now() - start_s) * rate_hz))
        missed = n_next - n - 1
        n = n_next
        await clock.sleep_until(start_s + n / rate_hz)


def new_event_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop whose timers do not wake late: epoll rounds up to a millisecond, select does not."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())
