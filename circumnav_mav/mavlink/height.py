"""The height above home, from the best message there is.

GLOBAL_POSITION_INT knows home; LOCAL_POSITION_NED counts from where the estimator started; VFR_HUD is the barometer,
there even when all else is lost. A worse source steps in when the better ones are silent, and goes on from the height
that was known: the height that is held does not jump because a sensor was lost.
"""

from __future__ import annotations

from math import isfinite, nan

SOURCES = ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "VFR_HUD")
"""In order of trust."""
SILENT_S = 1.0
"""A source that is silent for so long is left for the next one."""
SETTLED_S = 3.0
"""The height of a source that was used for less than this is no reference for the next one."""


class Height:
    """Heights in, one height out [m, + up]."""

    def __init__(self) -> None:
        self.source = ""
        self.from_home = False
        """Whether 0 is home; else it is where the vehicle was when it was first heard."""
        self._height_m = self._heard_s = self._since_s = nan
        self._offset_m = 0.0

    def take(self, source: str, value_m: float, now_s: float, *, on_ground: bool) -> None:
        """Take in a height by one source."""
        if not isfinite(value_m):
            return
        if source != self.source:
            better = not self.source or SOURCES.index(source) < SOURCES.index(self.source)
            if not better and now_s - self._heard_s < SILENT_S:
                return
            self._change_to(source, value_m, now_s, on_ground=on_ground)
        self._height_m, self._heard_s = value_m + self._offset_m, now_s

    def at(self, now_s: float, within_s: float) -> float:
        """Return the newest height; NaN where none was heard for `within_s`."""
        return self._height_m if now_s - self._heard_s <= within_s else nan

    def _change_to(self, source: str, value_m: float, now_s: float, *, on_ground: bool) -> None:
        if self.from_home and self._heard_s - self._since_s >= SETTLED_S:
            self._offset_m = self._height_m - value_m
        elif source != "VFR_HUD":  # counted from home by itself
            self._offset_m, self.from_home = 0.0, True
        else:  # above the sea: home is here if this is the ground
            self._offset_m, self.from_home = -value_m, on_ground
        self.source, self._since_s = source, now_s
