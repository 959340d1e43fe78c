"""A device's clock seen from ours: when was this measured, in the app's monotonic seconds?

arrival - stamp = (offset of the clocks) + (delay of this sample), and a delay is never negative: the least difference
of the last minute is the offset plus the shortest delay seen. So the part of the delay that varies is taken out; the
part that is always there cannot be seen from one side and is the `latency_s` of the configuration.
"""

from __future__ import annotations

import math
from collections import deque

WINDOW_S = 60.0
"""How long a least difference is believed: clocks drift by up to 50 us a second, 3 ms in a window."""

BUCKETS = 6
RESTART_S = 0.1
RESTART_AFTER = 3


class StampClock:
    """Converts stamps of one device to the app's clock with a sliding minimum over WINDOW_S; bounded memory.

    A device that reboots starts its clock again: after RESTART_AFTER stamps in a row that lie more than RESTART_S
    before the newest one, the window starts anew. A single old stamp (a packet overtaken on its way) is only old.
    """

    def __init__(self) -> None:
        self._least: deque[tuple[float, float]] = deque()  # (start of the bucket on our clock, least difference in it)
        self._newest_s = -math.inf
        self._backwards = 0

    def to_ours(self, stamp_s: float, arrival_s: float) -> float:
        """Return when the stamp was, on our clock [s]; never after its arrival. Both arguments must be finite."""
        self._watch_restart(stamp_s)
        difference_s = arrival_s - stamp_s
        while self._least and arrival_s - self._least[0][0] > WINDOW_S:
            self._least.popleft()
        if not self._least or arrival_s - self._least[-1][0] > WINDOW_S / BUCKETS:
            self._least.append((arrival_s, difference_s))
        elif difference_s < self._least[-1][1]:
            self._least[-1] = (self._least[-1][0], difference_s)
        return min(arrival_s, stamp_s + min(least for _, least in self._least))

    def _watch_restart(self, stamp_s: float) -> None:
        if stamp_s >= self._newest_s - RESTART_S:
            self._backwards = 0
            self._newest_s = max(self._newest_s, stamp_s)
            return
        self._backwards += 1
        if self._backwards >= RESTART_AFTER:
            self._backwards = 0
            self._newest_s = stamp_s
            self._least.clear()
