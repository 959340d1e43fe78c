"""Holds a turn rate within what the vehicle can fly, and says when it had to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limited:
    """A turn rate that the vehicle can fly, and what was taken away to make it so."""

    turn_rate_rad_s: float
    saturated: bool  # more was asked than the turn-rate limit
    slewed: bool  # the change was faster than the turn-acceleration limit


@dataclass(slots=True)
class TurnRateLimiter:
    """Saturate, then slew. Infinite limits switch either off. Signs as everywhere: + counter-clockwise."""

    turn_rate_limit_rad_s: float
    turn_accel_limit_rad_s2: float
    _last_rad_s: float = 0.0
    _last_s: float | None = None

    def __post_init__(self) -> None:
        for name in ("turn_rate_limit_rad_s", "turn_accel_limit_rad_s2"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")

    def reset(self) -> None:
        """Forget the last command (after a hand-over, for instance): the next one is not slewed."""
        self._last_s = None

    def limit(self, now_s: float, turn_rate_rad_s: float) -> Limited:
        """Return the command to fly at `now_s`. The first one after a reset is not slewed."""
        wanted = min(max(turn_rate_rad_s, -self.turn_rate_limit_rad_s), self.turn_rate_limit_rad_s)
        flown = wanted
        if self._last_s is not None:
            step = self.turn_accel_limit_rad_s2 * max(0.0, now_s - self._last_s)
            flown = min(max(wanted, self._last_rad_s - step), self._last_rad_s + step)
        self._last_rad_s, self._last_s = flown, now_s
        return Limited(flown, saturated=wanted != turn_rate_rad_s, slewed=flown != wanted)
