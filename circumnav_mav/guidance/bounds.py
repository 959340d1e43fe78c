"""What the options of laws and estimators may be, measured in the study's simulation: docs/estimation.md."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import NamedTuple


class Bound(NamedTuple):
    """Outside `least` to `most` nothing flies; outside `low` to `high` a value is odd, and `check` warns of it.

    small, large: what a value that is too small or too large does, in words that follow "it".
    """

    least: float = 0.0  # a least of 0 is not allowed itself
    low: float = 0.0
    high: float = inf
    most: float = inf
    small: str = ""
    large: str = ""

    def fault(self, value: float) -> str:
        """Return what a value must be instead, and why; empty where it flies."""
        if not value > 0.0 and not self.least:
            return f"must be above 0, not {value:g}"
        if not value >= self.least:
            return f"must be at least {self.least:g}, not {value:g}: it {self.small}"
        return f"must be at most {self.most:g}, not {value:g}: it {self.large}" if value > self.most else ""

    def odd(self, value: float) -> str:
        """Return what an odd value does; empty for any other."""
        return self.small if value < self.low else self.large if value > self.high else ""


POSITIVE = Bound()


def refuse_options(options: Mapping[str, float], bounds: Mapping[str, Bound]) -> None:
    """Raise ValueError, in words, for the first option that cannot fly."""
    for name, bound in bounds.items():
        if fault := bound.fault(options[name]):
            raise ValueError(f"{name} {fault}")


GATE = Bound(
    least=1.0,
    low=2.0,
    high=10.0,
    most=100.0,
    small="refuses good ranges: 5 % of them lie beyond 2 standard deviations, 32 % beyond 1",
    large="hardly refuses an echo: one that is off by fewer standard deviations is flown on",
)
ALARM = Bound(least=1.0, low=2.0, small="starts the ring again for nothing: good ranges average 1")
RATE = Bound(low=0.05, small="believes a range rate more than any sensor deserves, against the ranges")
NOISE = {"sigma_m": POSITIVE, "sigma_rate_m_s": RATE, "gate_sigmas": GATE}
"""Of every filter."""


def forgets(what: str, high: float, most: float) -> Bound:
    """Return the bound of a noise that makes the filter forget."""
    return Bound(high=high, most=most, large=f"forgets {what} sooner than ranges show it")


LAYER = Bound(high=0.5, most=1.0, large="flies beside the circle, whose own turn takes so great an error")
TURN_SHARE = Bound(high=1.0, large="asks for more than the turn-rate limit, which is never passed")
