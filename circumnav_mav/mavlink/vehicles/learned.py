"""A number of the vehicle's own that is configured, or learned while the autopilot flies."""

from __future__ import annotations

from math import isfinite, isnan

LEARNING_S = 2.0
KNOWN_AFTER_S = 1.0


class Learned:
    """The value: as configured, or a low-pass of what was seen; known only after a second of it."""

    def __init__(self, configured: float, low: float, high: float) -> None:
        self._fixed = not isnan(configured)
        self._low, self._high = low, high
        self._seen_s = 0.0
        self.value = configured

    @property
    def known(self) -> bool:
        """Whether there is a value to fly with."""
        return self._fixed or self._seen_s >= KNOWN_AFTER_S

    def learn(self, seen: float, dt_s: float) -> None:
        """Take in what is flown now; what is not between low and high is no level flight, and is passed over."""
        if self._fixed or not isfinite(seen) or not self._low <= seen <= self._high:
            return
        self.value = seen if isnan(self.value) else self.value + (seen - self.value) * min(1.0, dt_s / LEARNING_S)
        self._seen_s += dt_s
