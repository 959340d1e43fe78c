"""One clock for the app and a simulated vehicle: neither runs ahead while the machine holds the other up.

At five times real time, a fifth of a second lost to a busy machine would be a second of flight without a setpoint or a
range. The two keep each other's pace through a file of two native doubles, both in the vehicle's flight seconds: what
the vehicle has reached and what the app has (NaN: not there yet). Only `demo` flies so: a real vehicle waits for none.
"""

from __future__ import annotations

import asyncio
import mmap
import time
from array import array
from math import inf, isnan, nan
from pathlib import Path

from circumnav_mav.runtime.clock import Clock

LEAD_S = 0.1
"""How far ahead of the vehicle the app may be, in flight seconds: far below any limit on the age of a message."""
HOLD_S = 1.5
"""A vehicle that stands still for so long, in wall seconds, is not waited for. Less than the watchdog's patience."""
LOOK_S = 0.05
"""One look at the vehicle proves no longer a stand than this: a machine that stands still holds both processes up."""
POLL_S = 0.001


class PacedClock(Clock):
    """Flight seconds that follow the wall clock, but never run further than LEAD_S ahead of the vehicle."""

    def __init__(self, speed: float, path: Path) -> None:
        """`path`: made here; the vehicle opens it. Raises OSError where it cannot be written."""
        super().__init__(speed)
        path.write_bytes(array("d", (nan, nan)).tobytes())
        with path.open("r+b") as file:
            self._reached = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")
        self._now_s, self._wall_s = 0.0, time.monotonic()
        self._vehicle_s, self._still_s, self._alone = nan, 0.0, True
        self._ahead_s = nan  # this clock minus the vehicle's, as they were when they met

    def now(self) -> float:
        """Return the flight time, s; it stands still while the vehicle is held up."""
        wall_s = time.monotonic()
        wanted_s = self._now_s + (wall_s - self._wall_s) * self.speed
        now_s = max(self._now_s, min(wanted_s, self._limit_s(wall_s - self._wall_s)))
        self.held_s += (wanted_s - now_s) / self.speed
        self._now_s, self._wall_s = now_s, wall_s
        self._reached[1] = now_s - self._ahead_s
        return now_s

    async def sleep_until(self, flight_s: float) -> None:
        """Sleep to a flight time, however long the clock is held."""
        await super().sleep_until(flight_s)
        while self.now() < flight_s:  # noqa: ASYNC110 - another process moves the limit: there is no event
            await asyncio.sleep(POLL_S)

    def _limit_s(self, since_s: float) -> float:
        """Return how far this clock may go; since_s: wall time since the last look."""
        vehicle_s = self._reached[0]
        if isnan(vehicle_s):
            return inf
        if vehicle_s != self._vehicle_s:
            if self._alone:  # met for the first time, or back after it was given up
                self._alone, self._ahead_s = False, self._now_s - vehicle_s
            self._vehicle_s, self._still_s = vehicle_s, 0.0
        else:
            self._still_s += min(since_s, LOOK_S)
            self._alone = self._alone or self._still_s > HOLD_S
        return inf if self._alone else vehicle_s + self._ahead_s + LEAD_S
