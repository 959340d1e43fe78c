"""Stamps of a clock that TIMESYNC knows: no part of the delay stays hidden, as it does where a line must be fitted.

Whether a clock is the one that stamps is looked at before it is believed: a sender may answer TIMESYNC with another
clock than it stamps with, and a person may say `stamped_by: autopilot` of one that does not. Then the line of stamps.py
is used, and `words` says so.
"""

from __future__ import annotations

from circumnav_mav.types import ClockOffset

MOST_BOUND_S = 0.05
"""Clocks known less well than this are no better than a line."""
SLACK_S = 0.01
"""Stamps are rounded, and scheduling comes between."""
MOST_AGE_S = 5.0
"""A stamp older than this, or from the future, is not of that clock."""
DOUBT_AFTER, BELIEVE_AFTER = 3, 10
"""So many stamps in a row decide."""


class SharedClock:
    """Converts the stamps of one sender, and watches whether they can be of the clock that TIMESYNC knows."""

    def __init__(self) -> None:
        self._against = 0
        self._for = 0
        self._off_s = 0.0
        self.fits = False
        """Whether the stamps are of that clock."""

    def to_ours(self, stamp_s: float, arrival_s: float, clock: ClockOffset) -> float | None:
        """Return when the stamp was, on our clock [s], never after its arrival; None where it cannot be told."""
        if clock.bound_s > MOST_BOUND_S:
            return None
        ours_s = stamp_s - clock.offset_s
        age_s = arrival_s - ours_s
        if -clock.bound_s - SLACK_S <= age_s <= MOST_AGE_S:
            self._for, self._against = self._for + 1, 0
            self.fits = self.fits or self._for >= BELIEVE_AFTER
        else:
            self._for, self._against, self._off_s = 0, self._against + 1, age_s
            self.fits = self.fits and self._against < DOUBT_AFTER
        return min(arrival_s, ours_s) if self.fits else None

    @property
    def words(self) -> str:
        """What is wrong, for people; empty where nothing is."""
        if self.fits or self._against < DOUBT_AFTER:
            return ""
        return f"the ranges' stamps are {abs(self._off_s):.1f} s off the clock that TIMESYNC shows: another one stamps"
