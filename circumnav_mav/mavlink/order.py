"""Which of two messages of one sender left first, by MAVLink's sequence numbers, which go round every 256 frames."""

from __future__ import annotations

from math import inf

SURE_WITHIN_S = 0.12
"""Half a round at 1000 frames a second (PX4 sends 408, measured): after longer without news, numbers tell nothing."""


class Order:
    """Gives every message its place in the order of sending. Feed it all that is read of one sender."""

    def __init__(self) -> None:
        self._newest = 0
        self._advanced_s = -inf

    def place(self, seq: int, now_s: float) -> int:
        """Return the place of the message `seq` that arrived at `now_s`: lower than another's, if it was sent before.

        After SURE_WITHIN_S without a newer message the count begins anew, above all places that were given.
        """
        if now_s - self._advanced_s > SURE_WITHIN_S:
            self._newest = (self._newest | 0xFF) + 257 + seq
            self._advanced_s = now_s
            return self._newest
        ahead = (seq - self._newest + 128 & 0xFF) - 128
        place = self._newest + ahead
        if ahead > 0:
            self._newest, self._advanced_s = place, now_s
        return place
