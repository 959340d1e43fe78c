"""How noisy the ranges are, as they show it: a radio in the field is seldom as good as its configured sigma.

Differences of successive innovations have twice the noise's variance and hardly any of what a wrong speed or wind
leaves in them; an outlier stands in two of them, so that their lower quartile bears a third of outliers. Each is taken
as a multiple of the sigma expected of its range, which for a levelled slant range changes along the flight.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from math import nan, sqrt

WINDOW, ENOUGH = 100, 50
"""Differences that are looked at, and how many there must be before anything is said."""
QUARTILE_OF_NORMAL = 0.3186
"""Lower quartile of |x| for a standard normal x."""
EXPECTED = QUARTILE_OF_NORMAL * sqrt(2.0)
"""The same for a difference of two."""
CLEARLY, NO_MORE, MOST = 2.0, 1.4, 6.0
"""Times the expected sigma: from where on the ranges are called noisier (a quarter of outliers alone comes to this),
until when, and how far they are followed; beyond, the sensor is not the one that was configured, and the gate's vote
says so."""


class NoiseMeter:
    """Measures the noise of ranges. times: how many times the expected sigma; NaN while too few were heard.

    noisier: whether that is clearly more than once; it changes with ranges only, never because somebody asks.
    """

    def __init__(self) -> None:
        self._differences: deque[float] = deque()
        self._ordered: list[float] = []  # the same, by size
        self._last = nan
        self.noisier = False
        self.times = nan
        self._lasting = 0  # ranges since it became so

    def add(self, innovation_m: float, expected_m: float) -> None:
        """Take in a measured range minus the predicted one, used or not, and its expected sigma; NaN: not known."""
        difference = abs(innovation_m - self._last) / expected_m
        self._last = innovation_m
        if difference != difference:  # NaN
            return
        differences, ordered = self._differences, self._ordered  # in order always: sorting costs as much as a filter
        differences.append(difference)
        insort(ordered, difference)
        if len(differences) > WINDOW:
            del ordered[bisect_left(ordered, differences.popleft())]
        if (count := len(ordered)) >= ENOUGH:
            self.times = times = ordered[(count - 1) // 4] / EXPECTED
            self.noisier = noisier = times > (NO_MORE if self.noisier else CLEARLY)
            self._lasting = self._lasting + 1 if noisier else 0

    def restart(self) -> None:
        """The belief was replaced: the next innovation has nothing to do with the last."""
        self._last = nan

    @property
    def surely(self) -> bool:
        """Whether they were noisier for so long that nothing is left of what first showed it: chance seldom stays."""
        return self._lasting > WINDOW

    def sigma(self, expected_m: float) -> float:
        """Return the sigma to use, m: the expected one, unless the ranges are clearly noisier."""
        return min(self.times, MOST) * expected_m if self.noisier else expected_m
