"""How noisy the ranges are, as they show it: a radio in the field is seldom as good as its configured sigma.

Differences of successive innovations have twice the noise's variance and hardly any of what a wrong speed or wind
leaves in them; an outlier stands in two of them, so that their lower quartile bears a third of outliers.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from math import isnan, nan, sqrt

WINDOW, ENOUGH = 100, 50
"""Differences that are looked at, and how many there must be before anything is said."""
QUARTILE_OF_NORMAL = 0.3186
"""Lower quartile of |x| for a standard normal x."""
CLEARLY, NO_MORE, MOST = 2.0, 1.4, 6.0
"""Times the expected sigma: from where on the ranges are called noisier (a quarter of outliers alone comes to this),
until when, and how far they are followed; beyond, the sensor is not the one that was configured, and the gate's vote
says so."""


class NoiseMeter:
    """Measures the noise of ranges. sigma_m: as measured, m; NaN while too few were heard."""

    def __init__(self) -> None:
        self._differences: deque[float] = deque()
        self._ordered: list[float] = []  # the same, by size
        self._last = nan
        self._noisier = False
        self.sigma_m = nan

    def add(self, innovation_m: float) -> None:
        """Take in a measured range minus the predicted one, used or not; NaN where nothing was predicted."""
        if not isnan(innovation_m - self._last):
            self._put(abs(innovation_m - self._last))
            if len(self._ordered) >= ENOUGH:
                self.sigma_m = self._ordered[(len(self._ordered) - 1) // 4] / (QUARTILE_OF_NORMAL * sqrt(2.0))
        self._last = innovation_m

    def _put(self, difference_m: float) -> None:
        """Take a difference in and the oldest out; in order always, because sorting costs as much as a filter."""
        self._differences.append(difference_m)
        insort(self._ordered, difference_m)
        if len(self._differences) > WINDOW:
            del self._ordered[bisect_left(self._ordered, self._differences.popleft())]

    def restart(self) -> None:
        """The belief was replaced: the next innovation has nothing to do with the last."""
        self._last = nan

    def noisier(self, expected_m: float) -> bool:
        """Return whether the ranges are clearly noisier than expected."""
        self._noisier = self.sigma_m > (NO_MORE if self._noisier else CLEARLY) * expected_m
        return self._noisier

    def sigma(self, expected_m: float) -> float:
        """Return the sigma to use, m: the expected one, unless the ranges are clearly noisier."""
        return min(self.sigma_m, MOST * expected_m) if self.noisier(expected_m) else expected_m
