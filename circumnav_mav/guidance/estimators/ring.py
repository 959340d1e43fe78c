"""What the estimators with many hypotheses share: they differ in their states, not in how belief moves.

A bank is a list of NamedTuples with `stir` and `log_weight`; the first one leads: the vehicle flies on it. One reading
judges them all: refused by every likely one, it is an echo (gate.py); else it moves each hypothesis that takes it and
costs the others a fixed price, so that an echo cannot end the right one.
"""

from __future__ import annotations

from math import log
from typing import Any

PRUNE = 14.0
"""A hypothesis this much less likely than the best (natural logarithm) is given up."""

LIKELY = 6.0
"""A hypothesis within this of the best has a say in whether a reading is an echo."""

CHANGE = 1.0
"""How much likelier (natural logarithm) another hypothesis must be before the vehicle flies on it. At 3 one run of
1,000 of the study's R_moving was lost: it stayed too long with a wrong one."""

TWIN = 3.0
"""A kind of air that was given up starts again from the leader, this much less likely (natural logarithm)."""

NEVER = -1e300
"""The weight (natural logarithm) of a hypothesis on the shelf: it stands in the bank and has no say."""

ALARM_SHARE = 0.04
"""Weight of one reading in the smoothed normalised innovation: the alarm remembers about 25 readings."""


def best_of(bank: list[Any]) -> int:
    """Return the index of the likeliest hypothesis."""
    best, most, i = 0, bank[0].log_weight, 0
    for h in bank:
        if h.log_weight > most:
            best, most = i, h.log_weight
        i += 1  # noqa: SIM113 (plain Python is quicker so)
    return best


def all_refuse(bank: list[Any], nis: list[float], gate: float) -> bool:
    """Return whether a reading, with its normalised innovations squared, is beyond the gate of all that are likely."""
    best, most = best_of(bank), gate * gate
    if nis[best] <= most:
        return False
    likely, i = bank[best].log_weight - LIKELY, 0
    for h in bank:
        if nis[i] <= most and h.log_weight > likely:
            return False
        i += 1  # noqa: SIM113
    return True


def merge(bank: list[Any], same: list[bool]) -> None:
    """Drop what has become the same as the best; where that is the leader, the best takes its place."""
    if same.count(True) < 2:  # the best itself is
        return
    best = best_of(bank)
    leads = same[0]
    for i in range(len(bank) - 1, 0, -1):
        if i != best and same[i]:
            bank.pop(i)
            if i < best:
                best -= 1
    if best > 0 and leads:
        bank[0] = bank.pop(best)


def prune(bank: list[Any]) -> None:
    """Give up hypotheses that the readings speak against, and let the likeliest lead.

    Not for a near tie, or the vehicle would dither.
    """
    best, i = 0, 0
    most = fewest = bank[0].log_weight
    for h in bank:
        weight = h.log_weight
        if weight > most:
            best, most = i, weight
        elif weight < fewest:
            fewest = weight
        i += 1  # noqa: SIM113
    least = most - PRUNE
    if fewest < least:
        for i in range(len(bank) - 1, -1, -1):
            if bank[i].log_weight < least:
                bank.pop(i)
                if i < best:
                    best -= 1
    if most > bank[0].log_weight + CHANGE:
        bank[0], bank[best] = bank[best], bank[0]


def unflown(bank: list[Any], stirs: tuple[float, ...]) -> list[float]:
    """Return the kinds of air that no hypothesis flies in, once few are left: each is to be flown by one at least."""
    lacking = []
    if len(bank) <= 2 * len(stirs):
        for stir in stirs:
            flown = False
            for h in bank:
                if h.stir == stir:
                    flown = True
                    break
            if not flown:
                lacking.append(stir)
    return lacking


def smoothed(alarm: float, nis: float) -> float:
    """Return the alarm after a reading that passed the gate: near 1 while the best hypothesis explains the ranges."""
    return alarm + ALARM_SHARE * (nis - alarm)


def log_likelihood(nis: float, s: float, gate: float) -> float:
    """Return ln of the likelihood of an innovation, with a floor at the gate."""
    return -0.5 * (min(nis, gate * gate) + log(s))
