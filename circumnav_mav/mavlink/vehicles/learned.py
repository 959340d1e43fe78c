"""A number of the vehicle's own that is configured, or learned while the autopilot flies."""

from __future__ import annotations

from math import isfinite, isnan

LEARNING_S = 2.0


class Learned:
    """The value: as configured, else a low-pass of what was seen, else the usual one."""

    def __init__(self, configured: float, usual: float) -> None:
        self._fixed = not isnan(configured)
        self._known = self._fixed
        self.value = configured if self._fixed else usual

    def learn(self, seen: float, dt_s: float) -> None:
        """Take in what is flown now; NaN is passed over."""
        if self._fixed or not isfinite(seen):
            return
        self.value = seen if not self._known else self.value + (seen - self.value) * min(1.0, dt_s / LEARNING_S)
        self._known = True
