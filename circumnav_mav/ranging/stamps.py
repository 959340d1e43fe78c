"""A device's clock seen from ours: when was this measured, in the app's monotonic seconds?

arrival - stamp = (offset of the clocks) + (delay of this sample), and a delay is never negative: a line under all
differences of the last minute is the offset plus the shortest delay seen. So the part of the delay that varies is taken
out; the part that is always there cannot be seen from one side and is the `latency_s` of the configuration.

Nor can everything else be told from one side. A latency that grows by up to MOST_RATE looks like a slow clock, one that
steps up and then stays looks like a clock that lost time: both are believed to be the clock's, and `words` says so. A
backlog that grows faster, or runs empty, shows as age for as long as it does, and so does a clock slower than that.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

WINDOW_S = 60.0
"""How long a difference is believed: clocks drift by up to 50 us a second, 3 ms in a window."""

SLOT_S = 0.4
"""Of each such piece of the window the least difference is kept."""

RESTART_S = 0.1
RESTART_AFTER = 3

DOUBT_SLOTS = 3
"""So many slots in a row, each too old and all of one age, put the blame on the clock."""

MOST_RATE = 0.06
"""By how much a clock may run slow [s/s] and be followed."""

JITTER_S = 0.03
"""What the least delays of two slots may differ by, beside the rate."""

NOTICE_S = 0.1
LEARN_SLOTS = 8
"""A rate is followed once it makes NOTICE_S over the window, and that is LEARN_SLOTS long: less may be jitter."""


class StampClock:
    """Converts stamps of one device to the app's clock with a line under WINDOW_S of differences; bounded memory.

    A device that reboots starts its clock again: after RESTART_AFTER stamps in a row that lie more than RESTART_S
    before the newest one, the window starts anew. A single old stamp (a packet overtaken on its way) is only old.
    doubt_s: samples that come in their own cadence and yet stay older than this [s] are a clock that lost time.
    """

    def __init__(self, doubt_s: float = 0.25) -> None:
        self._doubt_s = doubt_s
        self._newest_s = -math.inf
        self._backwards = 0
        self.doubts = 0
        """How often the clock was found to have lost time."""
        self.lost_s = 0.0
        """How much in all of these [s]."""
        self._slots: deque[tuple[float, float]] = deque()  # (when, least difference) of each slot, oldest first
        self._slot_began_s = -math.inf
        self._rate = self._too_slow = 0.0
        self._base_s = math.inf

    @property
    def rate(self) -> float:
        """By how much the device's clock is slower than ours [s/s]; 0 where that is too little to matter."""
        return self._rate

    @property
    def words(self) -> str:
        """What is wrong with the clock, for people; empty where nothing is."""
        if self.doubts:
            return f"the ranging device's clock lost {self.lost_s:.2f} s against ours (or its link got slower to stay)"
        if self._too_slow:
            runs = (
                f"the ranging device's clock runs at {1.0 - self._too_slow:.2f} of ours, or its link gets ever slower"
            )
            return f"{runs}: its ranges count as old; with a simulator that is slow, set ranging.use_stamps: false"
        if self._rate:
            return f"the ranging device's clock runs at {1.0 - self._rate:.3f} of ours (or its link gets ever slower)"
        return ""

    def to_ours(self, stamp_s: float, arrival_s: float) -> float:
        """Return when the stamp was, on our clock [s]; never after its arrival. Both arguments must be finite."""
        self._watch_restart(stamp_s)
        difference_s = arrival_s - stamp_s
        slots = self._slots
        if not slots or arrival_s - self._slot_began_s > SLOT_S:
            self._close_slot(arrival_s)
            slots.append((arrival_s, difference_s))
            self._slot_began_s = arrival_s
        elif difference_s < slots[-1][1]:
            slots[-1] = (arrival_s, difference_s)
        self._base_s = min(self._base_s, difference_s - self._rate * arrival_s)
        return min(arrival_s, stamp_s + self._offset_s(arrival_s))

    def _offset_s(self, at_s: float) -> float:
        return self._base_s + self._rate * at_s

    def _close_slot(self, now_s: float) -> None:
        """The newest slot is complete: doubt the clock, learn its rate, and lay the line anew."""
        slots = self._slots
        if self._is_doubtful():
            last_s, difference_s = slots[-1]
            self.doubts += 1
            self.lost_s += difference_s - self._offset_s(last_s)
            self._forget(list(slots)[-DOUBT_SLOTS:])
            slots = self._slots
        while slots and now_s - slots[0][0] > WINDOW_S:
            slots.popleft()
        self._learn_rate()
        self._base_s = min((least - self._rate * at_s for at_s, least in slots), default=math.inf)

    def _is_doubtful(self) -> bool:
        last = list(self._slots)[-DOUBT_SLOTS:]
        if len(last) < DOUBT_SLOTS or any(least - self._offset_s(at_s) <= self._doubt_s for at_s, least in last):
            return False
        (first_s, first), (last_s, newest) = last[0], last[-1]
        return abs(newest - first) <= MOST_RATE * (last_s - first_s) + JITTER_S

    def _learn_rate(self) -> None:
        slots = self._slots
        if len(slots) < LEARN_SLOTS:
            return
        slope = slope_below(slots)
        if self._rate or slope * (slots[-1][0] - slots[0][0]) >= NOTICE_S:
            self._rate = slope if 0.0 < slope <= MOST_RATE else 0.0
        if slope > MOST_RATE:
            self._too_slow = slope

    def _forget(self, kept: list[tuple[float, float]]) -> None:
        self._slots = deque(kept)
        self._slot_began_s = kept[-1][0] if kept else -math.inf
        self._rate = 0.0
        self._base_s = math.inf

    def _watch_restart(self, stamp_s: float) -> None:
        if stamp_s >= self._newest_s - RESTART_S:
            self._backwards = 0
            self._newest_s = max(self._newest_s, stamp_s)
            return
        self._backwards += 1
        if self._backwards >= RESTART_AFTER:
            self._backwards = 0
            self._newest_s = stamp_s
            self._forget([])


def slope_below(points: Sequence[tuple[float, float]]) -> float:
    """Return the slope of the line under all points (x rising) that is nearest to them: the edge of their lower hull
    over the middle (Moon, Skelly, Towsley 1999, clock skew from delays that are never negative).
    """
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (x1, y1), (x2, y2) = hull[-2:]
            if (y2 - y1) * (x - x1) < (y - y1) * (x2 - x1):
                break
            hull.pop()
        hull.append((x, y))
    middle = sum(x for x, _ in points) / len(points)
    for (x1, y1), (x2, y2) in pairwise(hull):
        if x2 >= middle:
            return (y2 - y1) / (x2 - x1)
    return 0.0
