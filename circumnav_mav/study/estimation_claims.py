"""Prints the figures of docs/estimation.md that are no row of `circumnav compare`.

python -m circumnav_mav.study.estimation_claims [--runs N] [--seed S]
python -m circumnav_mav.study.estimation_claims --entries ROWS [--runs N] [--seed S]     how near the entries come
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from circumnav_mav.study.compare import BEST, row
from circumnav_mav.study.noise import draw
from circumnav_mav.study.plant import World
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot, simulate

SEEING_TURN_RAD_S = 0.458
"""Of a pilot who sees the target: g tan(35 deg) / 15 m/s, the limit of the plane."""


def pilot_s_time(
    start: World, V: float = 15.0, r_a: float = 80.0, limit: float = SEEING_TURN_RAD_S, lag: float = 0.5
) -> float:
    """Return how long [s] a pilot who sees the target takes into the band (5 % of r_a) in still air.

    The shortest turn onto the tangent of the circle, then straight on, with the same lag of the turn rate [s].
    """
    x, y, psi, u, t, dt = start.x, start.y, start.psi, 0.0, 0.0, 0.05
    while math.hypot(x, y) > 1.05 * r_a:
        wanted = math.atan2(-y, -x) + math.asin(min(1.0, r_a / math.hypot(x, y)))
        command = max(-limit, min(limit, 2.0 * math.remainder(wanted - psi, 2.0 * math.pi) - u))
        u += (command - u) * (1.0 - math.exp(-dt / lag))
        psi += u * dt
        x, y, t = x + V * math.cos(psi) * dt, y + V * math.sin(psi) * dt, t + dt
    return t


def claims(runs: int, seed: int) -> Iterator[str]:
    """Yield the figures, a line each."""
    calm = SCENARIOS["P_calm"]
    for estimator in ("polar", "raw"):
        r = row(calm, Pilot("hashemi2013", estimator, {"kappa": 10.0}), runs, seed)
        u2 = r.u2_ratio * calm.turn_rate_on_the_circle**2
        yield f"P_calm, hashemi2013 (kappa 10) on {estimator}: {r.tail_ms_m2:.4f} m^2 at u^2 {u2:.4f}"
    flown = simulate(SCENARIOS["R_calm"], Pilot(*BEST), runs, seed)
    pilots = np.array([pilot_s_time(draw(SCENARIOS["R_calm"], seed, i).start) for i in range(runs)])
    times = np.where(np.isnan(flown["settle_s"]), np.inf, flown["settle_s"]) / pilots
    within = 100.0 * np.mean(times <= 1.5)
    yield (
        f"R_calm, {' on '.join(BEST)}: settled within 1.5 times the time of a pilot who sees the target in "
        f"{within:.1f} % of the runs; {np.median(times):.2f} times in the median"
    )
    for name in ("R_calm", "R_wind5", "X_gusts"):
        restarts = simulate(SCENARIOS[name], Pilot(*BEST), runs, seed)["restarts"]
        yield f"{name}, {' on '.join(BEST)}: the ring starts again in {100.0 * np.mean(restarts > 0):.1f} % of the runs"


ENTRIES = ("R_moving", "R_wind7", "R_lag1", "R_wind5", "R_outliers", "R_dropout")
"""Rows that are to keep a quarter of the radius, the hard ones first."""

ENTRY_S = 60.0
"""An entry is over by then; what comes later is the circle."""


def entries(rows: int, runs: int, seed: int) -> Iterator[str]:
    """Yield, a line a scenario, how near the entries of so many rows come: seeds `seed` and on, `runs` entries each."""
    for name in ENTRIES:
        scenario, too_near, least = replace(SCENARIOS[name], duration_s=ENTRY_S), 0, (math.inf, "")
        for s in range(seed, seed + rows):
            ranges = simulate(scenario, Pilot(*BEST), runs, s)["least_range"]
            too_near += int(np.sum(ranges < 0.25 * scenario.r_a_m))
            least = min(least, (float(ranges.min()), f"seed {s}, entry {int(ranges.argmin())}"))
        yield (
            f"{name}, {' on '.join(BEST)}: of {rows} rows of {runs} entries, {too_near} entries come nearer than "
            f"a quarter of the radius; the nearest comes to {least[0]:.1f} m ({least[1]})"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="flights a figure")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--entries", type=int, metavar="ROWS", help="instead: how near the entries of so many rows come"
    )
    given = parser.parse_args(arguments)
    lines = claims(given.runs, given.seed)
    if given.entries:
        lines = entries(given.entries, given.runs, given.seed)
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
