"""The ranging radio: true ranges in, what a real radio would report out."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

from sitl_stub.config import StubConfig


class Radio:
    """Measures the range at a fixed rate with noise, bias, detours, dropouts and latency."""

    def __init__(self, config: StubConfig) -> None:
        self._config = config
        self._random = random.Random(f"{config.seed}:radio")
        self._index = 0  # of the next measurement; an index, so that the grid never drifts
        self._under_way: deque[tuple[float, float, float]] = deque()  # (arrives at, taken at, range)

    def step(self, t_s: float, true_range_m: Callable[[], float]) -> list[tuple[float, float]]:
        """Return the ranges that arrive by t_s, as (time of the measurement [s], range [m])."""
        c = self._config
        while self._index / c.range_rate_hz <= t_s + 1e-9:
            taken_s = self._index / c.range_rate_hz
            self._index += 1
            measured = self._measure(taken_s, true_range_m())
            if measured is not None:
                self._under_way.append((taken_s + c.range_latency_s, taken_s, measured))
        if not self._under_way:
            return []
        arrived = []
        while self._under_way and self._under_way[0][0] <= t_s + 1e-9:
            arrived.append(self._under_way.popleft()[1:])
        return arrived

    def _measure(self, t_s: float, true_m: float) -> float | None:
        c = self._config
        # Drawn always and in the same order: a dropout must not change the noise of the rest of the flight.
        noise, lot, detour = (
            self._random.gauss(0.0, 1.0),
            self._random.random(),
            self._random.expovariate(1.0),
        )
        if true_m > c.range_max_m or any(a <= t_s < b for a, b in c.range_dropouts_s):
            return None
        measured = true_m + c.range_bias_m + c.range_sigma_m * noise
        if lot < c.outlier_share:
            measured += c.outlier_mean_m * detour
        return max(0.0, measured)
