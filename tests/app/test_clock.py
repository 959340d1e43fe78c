"""The grid: a missed point is skipped and counted, never made up for; on simulated time."""

from __future__ import annotations

import asyncio

import pytest

from circumnav_mav.runtime.clock import run_on_grid


class Simulated:
    """A clock that only moves when told to: by sleeping, or by work in the tick."""

    speed = 1.0

    def __init__(self) -> None:
        self.t_s = 100.0

    def now(self) -> float:
        return self.t_s

    async def sleep_until(self, t_s: float) -> None:
        self.t_s = max(self.t_s, t_s)


def ticks(busy: dict[int, float], count: int = 10) -> list[tuple[float, float, int]]:
    """Run `count` ticks at 10 Hz; tick n keeps the loop busy for busy[n] seconds."""
    clock, seen = Simulated(), []

    def tick(now_s: float, late_s: float, missed: int) -> bool:
        seen.append((round(now_s - 100.0, 6), round(late_s, 6), missed))
        clock.t_s += busy.get(len(seen) - 1, 0.0)
        return len(seen) < count

    asyncio.run(run_on_grid(clock, 10.0, tick))
    return seen


def test_ticks_fall_on_the_grid_whatever_the_work_within_a_period():
    seen = ticks(dict.fromkeys(range(10), 0.09))
    assert [t for t, _, _ in seen] == pytest.approx([n / 10 for n in range(10)])
    assert all(late == pytest.approx(0.0, abs=1e-6) and missed == 0 for _, late, missed in seen)


def test_a_long_tick_skips_grid_points_and_counts_them():
    seen = ticks({2: 0.35}, count=5)
    assert [t for t, _, _ in seen] == pytest.approx([0.0, 0.1, 0.2, 0.6, 0.7])
    assert [missed for _, _, missed in seen] == [0, 0, 0, 3, 0]
