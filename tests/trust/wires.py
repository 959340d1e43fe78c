"""A bad link, one direction: loss, duplicates, reordering and delay, all drawn from one seed."""

from __future__ import annotations

import heapq
import random

from tests.lockstep import Wire, Wires


class BadWire(Wire):
    """Datagrams are lost, doubled or held back; those held back are overtaken by later ones."""

    def __init__(
        self,
        seed: int | str,
        *,
        loss: float = 0.0,
        doubled: float = 0.0,
        held_back: float = 0.0,
        held_back_s: float = 0.1,
        delay_s: float = 0.0,
    ) -> None:
        super().__init__()
        self._random = random.Random(seed)
        self._loss, self._doubled, self._held_back = loss, doubled, held_back
        self._held_back_s, self._delay_s = held_back_s, delay_s
        self._on_the_way: list[tuple[float, int, bytes]] = []
        self._count = 0
        self.dead = False
        """Nothing passes any more."""

    def put(self, data: bytes, now_s: float) -> None:
        for _ in range(1 + (self._random.random() < self._doubled)):
            if self.dead or self._random.random() < self._loss:
                continue
            late_s = self._held_back_s * self._random.random() if self._random.random() < self._held_back else 0.0
            self._count += 1
            heapq.heappush(self._on_the_way, (now_s + self._delay_s + late_s, self._count, data))

    def due(self, now_s: float) -> list[bytes]:
        arrived = []
        while self._on_the_way and self._on_the_way[0][0] <= now_s + 1e-9:
            arrived.append(heapq.heappop(self._on_the_way)[2])
        return arrived


def bad(seed: int, **faults: float) -> Wires:
    """Return both directions with the same faults, drawn apart."""
    return Wires(BadWire(f"{seed} to app", **faults), BadWire(f"{seed} to vehicle", **faults))
