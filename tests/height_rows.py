"""A plane that is not told whether its ranges are slant: random flights of a shipped file on both kinds of range.

python -m tests.height_rows [--flights N] [--seed FIRST] [--config FILE] [ROW ...]       (6 flights a row: 2 minutes)

ground: the beacon stands on the ground, and its ranges are slant; level: it is as high as the aircraft, so that ranges
are horizontal. _outliers: every tenth range is too long. Direction, place, course and a wind of 0 to 5 m/s are drawn.
Errors are the stub's truth, over the last 100 s of 240.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from circumnav_mav.config_file import load
from tests.lockstep import Rig, airborne

ROWS = ("ground", "level", "ground_outliers", "level_outliers")
SHIPPED = Path(__file__).parents[1] / "configs" / "px4_fixed_wing.yaml"
FLIGHT_S, TAIL_S, HEIGHT_M, WIND_M_S = 240.0, 100.0, 100.0, 5.0
START_M = (150.0, 600.0)
HELD = ("acquiring", "orbiting", "coasting")
SETTLED_RMS_M, LEAST_SHARE = 3.0, 0.25
"""A flight is good with an rms of less than the first, and never nearer than this share of the radius."""


def rig_of(row: str, seed: int, file: Path = SHIPPED) -> Rig:
    """Return a flight of the row, drawn by the seed."""
    kind, _, outliers = row.partition("_")
    draw = random.Random(f"{row} {seed}")
    app = load(file)
    side = draw.choice(("clockwise", "anticlockwise"))
    app = app.model_copy(update={"orbit": app.orbit.model_copy(update={"direction": side})})
    wind, bearing, heading = (draw.uniform(-math.pi, math.pi) for _ in range(3))
    wind_m_s = draw.uniform(0.0, WIND_M_S)
    world = airborne(
        distance_m=draw.uniform(*START_M),
        bearing_rad=bearing,
        heading_rad=heading,
        height_m=HEIGHT_M,
        beacon_height_m=HEIGHT_M if kind == "level" else 0.0,
        airframe="fixed_wing",
        start_speed_m_s=app.orbit.speed_m_s,
        seed=seed,
        wind_east_m_s=wind_m_s * math.cos(wind),
        wind_north_m_s=wind_m_s * math.sin(wind),
        range_sigma_m=app.ranging.sigma_m,
        range_max_m=5000.0,
        outlier_share=0.1 if outliers else 0.0,
        outlier_mean_m=40.0,
    )
    return Rig(app, world)


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of one flight. Metres, of the true horizontal range."""

    row: str
    seed: int
    rms_m: float  # infinite where the flight was broken off
    least_m: float  # since control began
    right: bool  # flown on as what the ranges were, in the end
    chosen_s: float  # from the beginning, till the right one was flown on for good
    decided_s: float  # till it flew alone; NaN: never
    said: tuple[str, ...]

    @property
    def good(self) -> bool:
        return self.right and self.rms_m < SETTLED_RMS_M


def fly(row: str, seed: int, file: Path = SHIPPED) -> Flown:
    """Fly once."""
    rig = rig_of(row, seed, file).engage()
    choice = rig.flight.computer.choice
    truth = "horizontal" if row.startswith("level") else "slant"
    wrong_s, decided_s = rig.now_s, math.nan
    while rig.now_s < FLIGHT_S:
        rig.step()
        if choice is None or choice.taken != truth:
            wrong_s = rig.now_s
        if choice is None or not choice.decided:
            decided_s = math.nan
        elif math.isnan(decided_s):
            decided_s = rig.now_s
    held = rig.log.ticks[-1].phase in HELD
    return Flown(
        row,
        seed,
        rig.log.rms_m(TAIL_S) if held else math.inf,
        min(rig.config.orbit.radius_m + error for error in rig.log.error_m()),
        choice is not None and choice.taken == truth,
        wrong_s,
        decided_s,
        tuple(f"{event.t_s:.0f} s: {event.text}" for event in rig.flight.events if event.t_s > 0.0),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 when a flight is not good, 2 for a row that does not exist."""
    parser = argparse.ArgumentParser(prog="python -m tests.height_rows", description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--flights", type=int, default=6, help="flights a row")
    parser.add_argument("--seed", type=int, default=1, help="the first of them")
    parser.add_argument("--config", type=Path, default=SHIPPED)
    parser.add_argument("--each", action="store_true", help="a line for each flight, too")
    given = parser.parse_args(arguments)
    unknown = [name for name in given.rows if name not in ROWS]
    if unknown:
        print(f"no row {', '.join(unknown)}; there are {', '.join(ROWS)}", file=sys.stderr)
        return 2
    radius_m = load(given.config).orbit.radius_m
    print(
        "| row | flights | good | rms m | worst rms m | least range m | right after s, median | worst | never alone |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    all_good = True
    for row in given.rows or ROWS:
        flights = []
        for seed in range(given.seed, given.seed + given.flights):
            flight = fly(row, seed, given.config)
            flights.append(flight)
            if given.each or not flight.good:
                print(flight, file=sys.stderr, flush=True)
        all_good = all_good and all(f.good and f.least_m > LEAST_SHARE * radius_m for f in flights)
        chosen = sorted(f.chosen_s for f in flights)
        cells = (
            row,
            len(flights),
            sum(f.good for f in flights),
            f"{math.sqrt(sum(f.rms_m**2 for f in flights) / len(flights)):.2f}",
            f"{max(f.rms_m for f in flights):.2f}",
            f"{min(f.least_m for f in flights):.0f}",
            f"{chosen[len(chosen) // 2]:.0f}",
            f"{chosen[-1]:.0f}",
            sum(math.isnan(f.decided_s) for f in flights),
        )
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    return 0 if all_good else 1


if __name__ == "__main__":
    sys.exit(main())
