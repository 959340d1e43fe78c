"""Monotonic time, and the fixed grid on which setpoints leave."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable
from math import ceil


class Clock:
    """Flight seconds since this clock was made: monotonic, never the wall's. speed: flight seconds a wall second."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start_s = time.monotonic()

    def now(self) -> float:
        """Return the flight time, s."""
        return (time.monotonic() - self._start_s) * self.speed

    async def sleep_until(self, flight_s: float) -> None:
        """Sleep to a flight time; at once where it has passed (other tasks still get their turn)."""
        await asyncio.sleep(max(0.0, (flight_s - self.now()) / self.speed))


async def run_on_grid(clock: Clock, rate_hz: float, tick: Callable[[float, float, int], bool]) -> None:
    """Call tick(now_s, lateness_s, missed) on the grid start + n / rate_hz until it returns False.

    A missed grid point is skipped and counted, never made up for in a burst. now_s is flight time; lateness_s is how long
    after its grid point the tick began, in wall seconds.
    """
    start_s = clock.now()
    n = 0
    while True:
        now_s = clock.now()
        due = ceil((now_s - start_s) * rate_hz)
        missed = max(0, due - 1 - n)  # whole grid points that have gone by
        n += missed
        late_s = (now_s - (start_s + n / rate_hz)) / clock.speed
        if not tick(now_s, late_s, missed):
            return
        n = max(n + 1, ceil((clock.now() - start_s) * rate_hz)) if missed else n + 1
        await clock.sleep_until(start_s + n / rate_hz)


def new_event_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop whose timers do not wake late: epoll rounds time-outs up to a millisecond, select does not."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())
