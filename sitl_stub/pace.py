"""One clock for two processes: a vehicle faster than real time waits for a companion that the machine holds up.

At `--speed 5` a fifth of a second lost to a busy machine is a second of flight without a setpoint, which no autopilot
forgives. With a pace file neither runs further than LEAD_S ahead of the other; who stands still for HOLD_S of wall time
is not waited for any longer. The file holds two native doubles, both in the vehicle's flight seconds: what the vehicle
has reached, and what the companion has (NaN: not there yet).
"""

from __future__ import annotations

import math
import mmap
from pathlib import Path

LEAD_S = 0.1
HOLD_S = 5.0
LOOK_S = 0.05  # one look proves no longer a stand than this: a machine that stands still holds both processes up
SIZE = 16


class Pace:
    """The vehicle's end of a pace file. Raises ValueError where the file is not one, OSError where it is not there."""

    def __init__(self, path: Path) -> None:
        with path.open("r+b") as file:
            if len(file.read()) != SIZE:
                raise ValueError(f"{path} is no pace file: it must hold {SIZE} bytes, two doubles")
            self._reached = memoryview(mmap.mmap(file.fileno(), SIZE)).cast("d")
        self._companion_s = math.nan
        self._wall_s = math.inf
        self._still_s = 0.0

    def limit_s(self, now_s: float, wall_s: float) -> float:
        """Tell the companion that the vehicle has reached now_s; return the flight time up to which it may go."""
        self._reached[0] = now_s
        companion_s = self._reached[1]
        if companion_s != self._companion_s:
            self._companion_s, self._still_s = companion_s, 0.0
        else:
            self._still_s += min(max(wall_s - self._wall_s, 0.0), LOOK_S)
        self._wall_s = wall_s
        return math.inf if math.isnan(companion_s) or self._still_s > HOLD_S else companion_s + LEAD_S
