"""Which ranges to believe: a gate on the innovation, and a vote that ends a wrong belief.

Echoes and walls make a range too long, one sample at a time; a beacon that moved, or a belief that was wrong, makes
every sample differ, and by the same amount. So a refused reading becomes the rival; readings that agree with the rival
vote for it, all others against it (the majority vote of Boyer and Moore), and VOTES of them win the bank over.
"""

from __future__ import annotations

from math import isnan

from circumnav_mav.guidance.kernel import ACCEPTED, NAN, OUTLIER, RESTARTED, Memory

VOTES = 5.0
"""Readings that must agree, net of those that do not, before the old belief falls."""


def remember(mem: Memory, dt: float, nis: float, known: float, alarm: float, error: float = NAN) -> Memory:
    """Return the memory after an accepted reading: it speaks against the rival."""
    votes = mem.votes - 1.0 if mem.votes > 1.0 else 0.0
    return Memory(known, ACCEPTED, nis, alarm, mem.rival_r, mem.rival_age + dt, votes, error)


def refuse(mem: Memory, r: float, dt: float, closing_speed: float, spread: float, error: float = NAN) -> Memory:
    """Return the memory after a reading that the gate refused; its verdict is RESTARTED when the rival has won.

    closing_speed: the fastest that range can change, m/s; spread: how far two honest readings may differ, m.
    """
    age = mem.rival_age + dt
    if mem.votes <= 0.0 or isnan(mem.rival_r):
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, r, 0.0, 1.0, error)
    if abs(r - mem.rival_r) > closing_speed * age + spread:
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, mem.rival_r, age, mem.votes - 1.0, error)
    if mem.votes + 1.0 < VOTES:
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, r, 0.0, mem.votes + 1.0, error)
    return Memory(mem.known, RESTARTED, NAN, 0.0, NAN, 0.0, 0.0, NAN)
