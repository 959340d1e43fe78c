"""The mission store and its protocol: what is uploaded is kept and returned; nothing is flown from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

ACCEPTED, INVALID_SEQUENCE = 0, 13
REQUEST_INT, ITEM, ITEM_INT, COUNT, ACK = 51, 39, 73, 44, 47
MISSION_TYPES = 3  # mission, fence, rally
Reply = tuple[int, tuple[Any, ...]]


@dataclass(slots=True)
class _Upload:
    count: int
    mission_type: int
    items: list[tuple[Any, ...]] = field(default_factory=list)


class Missions:
    """Items by mission type, as the fields of MISSION_ITEM_INT after target_component. Replies are (id, fields)."""

    def __init__(self) -> None:
        self._items: dict[int, list[tuple[Any, ...]]] = {}
        self._uploads: dict[tuple[int, int], _Upload] = {}

    def total(self, mission_type: int = 0) -> int:
        """Return how many items there are."""
        return len(self._items.get(mission_type, []))

    def list(self, peer: tuple[int, int], mission_type: int) -> Reply:
        """Answer MISSION_REQUEST_LIST."""
        return COUNT, (*peer, self.total(mission_type), mission_type)

    def item(self, peer: tuple[int, int], seq: int, mission_type: int, as_int: bool) -> Reply:
        """Answer MISSION_REQUEST(_INT)."""
        items = self._items.get(mission_type, [])
        if not 0 <= seq < len(items):
            return ACK, (*peer, INVALID_SEQUENCE, mission_type)
        stored = items[seq]
        if as_int:
            return ITEM_INT, (*peer, *stored)
        x, y = (v * 1e-7 for v in stored[9:11])
        return ITEM, (*peer, *stored[:9], x, y, *stored[11:])

    def begin(self, peer: tuple[int, int], count: int, mission_type: int) -> Reply:
        """Answer MISSION_COUNT: ask for the first item, or clear at once."""
        if count == 0:
            return self.clear(peer, mission_type)
        self._uploads[peer] = _Upload(count, mission_type)
        return REQUEST_INT, (*peer, 0, mission_type)

    def take(self, peer: tuple[int, int], stored: tuple[Any, ...]) -> Reply | None:
        """Answer an uploaded item: ask for the next one, or accept the whole."""
        upload = self._uploads.get(peer)
        if upload is None:
            return None
        if stored[0] == len(upload.items):
            upload.items.append(stored)
        if len(upload.items) < upload.count:
            return REQUEST_INT, (*peer, len(upload.items), upload.mission_type)
        self._items[upload.mission_type] = upload.items
        del self._uploads[peer]
        return ACK, (*peer, ACCEPTED, upload.mission_type)

    def clear(self, peer: tuple[int, int], mission_type: int) -> Reply:
        """Answer MISSION_CLEAR_ALL; 255 means every type."""
        for kind in range(MISSION_TYPES) if mission_type == 255 else (mission_type,):
            self._items.pop(kind, None)
        return ACK, (*peer, ACCEPTED, mission_type)
