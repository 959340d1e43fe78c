"""The clocks of others, by TIMESYNC, SANS-IO: what they show while ours shows something else.

A question carries our time, and comes back with it and theirs. The answer was given between the two times that we read,
so the middle is wrong by half the round trip at most: that is a bound, whatever the link does. Of the last answers the
one with the least bound is believed, and a bound grows with the age of its answer, since clocks drift apart. So a slow
answer does no harm, and one that nobody asked for is not looked at. TIMESYNC has no address: whoever hears the question
may answer, and each is kept apart by its system and component (asking several with one token upsets nobody: an answer
to somebody else's token is not ours).
"""

from __future__ import annotations

from collections import deque
from math import inf, nan
from typing import NamedTuple

from circumnav_mav.types import ClockOffset

ASK_S = 1.0
"""PX4 asks ten times a second; for clocks that drift by 50 us a second, once is plenty."""
ANSWERS = 16
DRIFT = 1e-3
"""By how much a bound grows with its age [s/s]: twenty times what crystals do, so a simulator's clock is followed."""
SILENT_AFTER_S = 30.0
PATIENCE_S = 5.0
"""An answer later than this is not worth having."""
JUMP_S = 0.1
MOST_PEERS = 8


class _Answer(NamedTuple):
    at_s: float
    offset_s: float  # their clock less ours
    half_trip_s: float

    def bound_s(self, now_s: float) -> float:
        return self.half_trip_s + DRIFT * (now_s - self.at_s)


class _Peer:
    """One clock. Two answers in a row that contradict what is believed are a clock that was set, or a restart."""

    def __init__(self) -> None:
        self._answers: deque[_Answer] = deque(maxlen=ANSWERS)
        self._odd: _Answer | None = None

    def take(self, answer: _Answer) -> None:
        known = self.best(answer.at_s)
        if known is not None and _contradict(known, answer):
            if self._odd is None or _contradict(self._odd, answer):
                self._odd = answer
                return
            self._answers.clear()
            self._answers.append(self._odd)
        self._odd = None
        self._answers.append(answer)

    def best(self, now_s: float) -> _Answer | None:
        if not self._answers or now_s - self._answers[-1].at_s > SILENT_AFTER_S:
            return None
        return min(self._answers, key=lambda answer: answer.bound_s(now_s))


def _contradict(one: _Answer, other: _Answer) -> bool:
    return abs(one.offset_s - other.offset_s) > one.half_trip_s + other.half_trip_s + JUMP_S


class TimeSync:
    """A client of TIMESYNC. It asks nothing until it is `wanted`."""

    def __init__(self) -> None:
        self.wanted = False
        self._asked: dict[int, float] = {}  # token -> when it left [s]
        self._next_s = nan
        self._peers: dict[tuple[int, int], _Peer] = {}

    def question(self, now_s: float) -> int | None:
        """Return the token (ts1) of a question that is to leave now, None while none is due."""
        if not self.wanted or now_s < self._next_s:
            return None
        self._next_s = now_s + ASK_S
        self._asked = {token: sent_s for token, sent_s in self._asked.items() if now_s - sent_s < PATIENCE_S}
        token = int(now_s * 1e9)
        self._asked[token] = now_s
        return token

    def answer(self, sender: tuple[int, int], token: int, their_ns: int, now_s: float) -> None:
        """Take an answer (tc1 = their_ns, ts1 = token) of (system, component) that arrived at `now_s`."""
        sent_s = self._asked.get(token, inf)
        if not 0.0 <= now_s - sent_s < PATIENCE_S:
            return
        if sender not in self._peers and len(self._peers) >= MOST_PEERS:
            return
        half_trip_s = (now_s - sent_s) / 2
        offset_s = their_ns * 1e-9 - (sent_s + half_trip_s)
        self._peers.setdefault(sender, _Peer()).take(_Answer(now_s, offset_s, half_trip_s))

    def offset(self, sender: tuple[int, int], now_s: float) -> ClockOffset | None:
        """Return the clock of (system, component); None while it is not known."""
        peer = self._peers.get(sender)
        best = peer.best(now_s) if peer is not None else None
        return None if best is None else ClockOffset(best.offset_s, best.bound_s(now_s))

    def forget(self) -> None:
        """Whatever answered may have restarted, or the way there is another one."""
        self._peers.clear()
        self._asked.clear()
