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
    return dt / wanted_s if dt * AGREE < wanted_s else 1.0 / AGREE


def believed_s(period_s: float) -> float:
    """Return how long ranges that come period_s [s] apart must agree, at most, before they end a belief, s."""
    return max(LONGER_S, AGREE * period_s)


def remember(mem: Memory, dt: float, nis: float, known: float, alarm: float, error: float = NAN) -> Memory:
    """Return the memory after an accepted reading: it speaks against the rival, and for the belief from now on."""
    _, _, _, _, rival_r, rival_age, votes, _, _, _, stood_s = mem
    if votes > 0.0:
        votes = max(0.0, votes - vote(dt, min(AGREE_S, stood_s)))
    if stood_s < LONGER_S:
        stood_s = min(stood_s + min(dt, LONGER_S / AGREE), LONGER_S)
    return Memory(known, ACCEPTED, nis, alarm, rival_r, rival_age + dt, votes, error, NAN, 0.0, stood_s)


def refuse(mem: Memory, r: float, dt: float, closing_speed: float, spread: float, error: float = NAN) -> Memory:
    """Return the memory after a reading that the gate refused; its verdict is RESTARTED when the rival has won.

    closing_speed: the fastest that range can change, m/s; spread: how far two honest readings may differ, m.
    A belief falls to no less than it has behind it, and the youngest to AGREE readings: the first may be an echo.
    """
    age, stood_s = mem.rival_age + dt, mem.stood_s
    weight = vote(dt, min(LONGER_S if error > 0.0 else AGREE_S, stood_s))
    rival_r, rival_age, votes = r, 0.0, mem.votes + weight
    if mem.votes <= ROUNDING or isnan(mem.rival_r):
        votes = weight
    elif abs(r - mem.rival_r) > closing_speed * age + spread:
        rival_r, rival_age, votes = mem.rival_r, age, mem.votes - weight
    if votes >= 1.0 - ROUNDING:
        return restarted(mem, NAN, 0.0)
    return Memory(mem.known, OUTLIER, mem.nis, mem.alarm, rival_r, rival_age, votes, error, NAN, 0.0, stood_s)


def restarted(mem: Memory, nis: float, alarm: float) -> Memory:
    """Return the memory after a reading that started the bank again."""
    return Memory(mem.known, RESTARTED, nis, alarm, NAN, 0.0, 0.0, NAN, NAN, 0.0, 0.0)


def shelved(mem: Memory, shelf_s: float, shelf_votes: float) -> Memory:
    """Return the memory with a belief on the shelf (the last of the bank) for shelf_s [s]."""
    known, verdict, nis, alarm, rival_r, rival_age, votes, error, _, _, stood_s = mem
    return Memory(known, verdict, nis, alarm, rival_r, rival_age, votes, error, shelf_s, shelf_votes, stood_s)


def compared(mem: Memory, before: Memory, dt: float, error: float, nis: float, gate: float, spread: float) -> Memory:
    """Return the memory after a reading that the shelved belief missed by `error` [m], with innovation `nis`.

    mem: after the belief that is flown on took or refused it; before: before it came. The verdict is RETURNED when the
    shelved one is to be taken back; shelf_s is NaN when its time is over.
    """
    votes, nearer = before.shelf_votes, abs(mem.error) - abs(error)  # NaN when it has just started
    fits = nis <= gate * gate and abs(error) <= spread
    if fits and mem.verdict == RESTARTED:
        votes = 1.0
    elif fits and nearer > spread:
        votes += vote(dt, AGREE_S)
    elif nearer < -spread:
        votes = max(0.0, votes - vote(dt, AGREE_S))
    if votes >= RETURN - ROUNDING:
        return Memory(1.0, RETURNED, nis, 1.0, NAN, 0.0, 0.0, NAN, NAN, 0.0, LONGER_S)
    age = before.shelf_s + dt
    return shelved(mem, NAN if age > SHELF_S else age, votes)
