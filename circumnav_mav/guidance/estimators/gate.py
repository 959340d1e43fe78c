"""Which ranges to believe: a gate on the innovation, a vote that ends a belief, and a shelf for the one that fell.

Echoes and walls make a range too long, one sample at a time or for a while; a beacon that moved, or a belief that was
wrong, makes every sample differ, and by the same amount. So a refused reading becomes the rival; readings that agree
with the rival vote for it, all others against it (the majority vote of Boyer and Moore). A vote weighs the time that
its reading stands for, so that a quick radio is not sooner misled than a slow one.

A belief that fell may have been right all the same: it stays on the shelf for a while, carried by dead reckoning alone,
and is taken back when the ranges are where it expects them and not where the new one does.
"""

from __future__ import annotations

from math import isnan

from circumnav_mav.guidance.kernel import ACCEPTED, NAN, OUTLIER, RESTARTED, RETURNED, Memory

AGREE_S, AGREE = 2.0, 5.0
"""For how long, and how many, readings must agree, net of those that do not, before the old belief falls. Echoes off a
bank or a wall that is passed last a second; two seconds of dead reckoning cost nothing."""

LONGER_S = 4.0
"""The same for readings that are longer than expected: an echo is, and to be farther off than believed is no danger."""

RETURN = 0.4
"""Net share of such a vote that brings a shelved belief back: it was known well, and asks for less than a stranger."""

SHELF_S = 20.0
"""How long a shelved belief may wait: dead reckoning is good for so long (the study's R_dropout: 15 s)."""

ROUNDING = 1e-9


def vote(dt: float, wanted_s: float) -> float:
    """Return what a reading that comes dt [s] after the last one weighs, where 1 wins after wanted_s [s]."""
    return min(dt / wanted_s, 1.0 / AGREE)


def remember(mem: Memory, dt: float, nis: float, known: float, alarm: float, error: float = NAN) -> Memory:
    """Return the memory after an accepted reading: it speaks against the rival."""
    votes = max(0.0, mem.votes - vote(dt, AGREE_S))
    return Memory(known, ACCEPTED, nis, alarm, mem.rival_r, mem.rival_age + dt, votes, error, NAN, 0.0)


def refuse(mem: Memory, r: float, dt: float, closing_speed: float, spread: float, error: float = NAN) -> Memory:
    """Return the memory after a reading that the gate refused; its verdict is RESTARTED when the rival has won.

    closing_speed: the fastest that range can change, m/s; spread: how far two honest readings may differ, m.
    """
    age, weight = mem.rival_age + dt, vote(dt, LONGER_S if error > 0.0 else AGREE_S)
    if mem.votes <= ROUNDING or isnan(mem.rival_r):
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, r, 0.0, weight, error, NAN, 0.0)
    if abs(r - mem.rival_r) > closing_speed * age + spread:
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, mem.rival_r, age, mem.votes - weight, error, NAN, 0.0)
    if mem.votes + weight < 1.0 - ROUNDING:
        return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, r, 0.0, mem.votes + weight, error, NAN, 0.0)
    return restarted(mem, NAN, 0.0)


def restarted(mem: Memory, nis: float, alarm: float) -> Memory:
    """Return the memory after a reading that started the bank again."""
    return Memory(mem.known, RESTARTED, nis, alarm, NAN, 0.0, 0.0, NAN, NAN, 0.0)


def shelved(mem: Memory, shelf_s: float, shelf_votes: float) -> Memory:
    """Return the memory with a belief on the shelf (the last of the bank) for shelf_s [s]."""
    known, verdict, nis, alarm, rival_r, rival_age, votes, error, _, _ = mem
    return Memory(known, verdict, nis, alarm, rival_r, rival_age, votes, error, shelf_s, shelf_votes)


def compared(mem: Memory, before: Memory, dt: float, error: float, nis: float, gate: float, spread: float) -> Memory:
    """Return the memory after a reading that the shelved belief missed by `error` [m], with innovation `nis`.

    mem: after the belief that is flown on took or refused it; before: before it came. The verdict is RETURNED when the
    shelved one is to be taken back; shelf_s is NaN when its time is over.
    """
    votes, nearer = before.shelf_votes, abs(mem.error) - abs(error)  # NaN when it has just started: no vote
    if nearer > spread and nis <= gate * gate and abs(error) <= spread:
        votes += vote(dt, AGREE_S)
    elif nearer < -spread:
        votes = max(0.0, votes - vote(dt, AGREE_S))
    if votes >= RETURN - ROUNDING:
        return Memory(1.0, RETURNED, nis, 1.0, NAN, 0.0, 0.0, NAN, NAN, 0.0)
    age = before.shelf_s + dt
    return shelved(mem, NAN if age > SHELF_S else age, votes)
