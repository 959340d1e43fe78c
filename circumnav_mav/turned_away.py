"""The ranges that a flight did not use, for people: how many in all, and why none is used now. Pure."""

from __future__ import annotations

from collections import Counter
from math import nan

from circumnav_mav.range_words import commonest
from circumnav_mav.ranging.plug import Reason


class TurnedAway:
    """Counts by reason, whoever turned them away. `echoes`, of each call: those of the autopilot's own, so far."""

    def __init__(self) -> None:
        self.total: Counter[str] = Counter()
        self._since: Counter[str] = Counter()  # the last range that was used
        self._used_s = nan
        self._echoes = 0

    def add(self, reason: str) -> None:
        """Count one."""
        self.total[reason] += 1
        self._since[reason] += 1

    def used(self, now_s: float, echoes: int) -> None:
        """A range was used."""
        self._since.clear()
        self._used_s, self._echoes = now_s, echoes

    def words(self, echoes: int) -> str:
        """Return the figure that the live view shows: the total, the autopilot's own, the commonest reason."""
        total = self.total.total()
        if echoes >= total:
            return f"{total} (the autopilot's own)" if total else "0"
        others = Counter(self.total)
        others[Reason.WRONG_SOURCE] -= echoes
        reason, count = others.most_common(1)[0]
        own = f"{echoes} of the autopilot's own, then " if echoes else "most "
        return f"{total}: {own}{reason} {count}"

    def why_none(self, now_s: float, echoes: int, max_age_s: float) -> str:
        """Return why none has been used, or none since the last."""
        echoes -= self._echoes
        silent_s = now_s - self._used_s
        if silent_s <= max_age_s:
            return "ranges come, but there is no estimate from them yet"
        lead = f"no range for {silent_s:.1f} s: " if silent_s == silent_s else ""
        if not self._since:
            what = "nothing comes any more" if lead else "no range message has come"
            return f"{lead}{what}: check that the ranging radio runs, and the ranging section of the configuration"
        if echoes >= self._since.total():
            return f"{lead}only the autopilot's own range finder or its echoes come ({echoes}), never the beacon's"
        return f"{lead}no range can be flown on: {commonest(self._since, echoes)}"
