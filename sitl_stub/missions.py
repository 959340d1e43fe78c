"""The mission store: what is uploaded is kept and returned; nothing is flown from it."""

from __future__ import annotations


class Missions:
    """Items by mission type (0 mission, 1 fence, 2 rally), as MISSION_ITEM_INT fields."""

    def __init__(self) -> None:
        self._items: dict[int, list[tuple[float, ...]]] = {}

    def total(self, mission_type: int = 0) -> int:
        """Return how many items there are."""
        return len(self._items.get(mission_type, []))
