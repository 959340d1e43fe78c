"""What the estimators with many hypotheses share: they differ in their states, not in how belief moves.

A bank is a list of NamedTuples with a `log_weight`. One reading judges them all: refused by every likely one, it is an
echo (gate.py); else it moves each hypothesis that takes it and costs the others a fixed price, so that an echo cannot
end the right one.
"""

from __future__ import annotations

from math import log
from typing import Any

PRUNE = 14.0
"""A hypothesis this much less likely than the best (natural logarithm) is given up."""

LIKELY = 6.0
"""A hypothesis within this of the best has a say in whether a reading is an echo."""

CHANGE = 1.0
"""How much likelier another hypothesis must be before the vehicle flies on it."""

TWIN = 3.0
"""A kind of air that was given up starts again from the leader, this much less likely (natural logarithm)."""

ALARM_SHARE = 0.04
"""Weight of one reading in the smoothed normalised innovation: the alarm remembers about 25 readings."""


def best_of(bank: list[Any]) -> int:
    """Return the index of the likeliest hypothesis."""
    best = 0
    for i in range(1, len(bank)):
        if bank[i].log_weight > bank[best].log_weight:
            best = i
    return best


def lead(bank: list[Any]) -> None:
    """Put the hypothesis to fly on first: the likeliest, but not for a near tie, or the vehicle would dither."""
    best = best_of(bank)
    if bank[best].log_weight > bank[0].log_weight + CHANGE:
        bank[0], bank[best] = bank[best], bank[0]


def log_likelihood(nis: float, s: float, gate: float) -> float:
    """Return ln of the likelihood of an innovation, with a floor at the gate."""
    return -0.5 * (min(nis, gate * gate) + log(s))


def prune(bank: list[Any]) -> None:
    """Give up hypotheses that the readings speak against."""
    least = bank[best_of(bank)].log_weight - PRUNE
    for i in range(len(bank) - 1, -1, -1):
        if bank[i].log_weight < least:
            bank.pop(i)
    lead(bank)


def smoothed(alarm: float, nis: float) -> float:
    """Return the alarm after a reading that passed the gate: near 1 while the best hypothesis explains the ranges."""
    return alarm + ALARM_SHARE * (nis - alarm)
