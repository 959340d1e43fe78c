"""The study's rows, flown again by the app on the stub's airplane: real MAVLink bytes, in lockstep, drift + tangent.

python -m tests.stub_rows [--seeds N] [--seed FIRST] [ROW ...]       (all rows, 4 seeds each: some minutes)

Prints the table of docs/estimation.md: rms of the stub's truth over the last 150 s of 300, pooled over the seeds,
beside the rms of the study's row. The stub's airplane is PX4's simulated one, which cannot fly 15 m/s level: it flies
12 m/s on the same circle in the same wind, so that wind and target are faster for it than they are in the study.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from circumnav_mav.study import compare
from circumnav_mav.study.scenarios import PLANNED_LAG_S, SCENARIOS, Scenario
from circumnav_mav.study.simulate import Pilot
from tests.lockstep import Rig, airborne, config

ROWS = (
    "R_calm",
    "R_wind5",
    "R_wind7",
    "R_moving",
    "R_outliers",
    "R_dropout",
    "R_lag1",
    "R_sigma5",
    "R_1Hz",
    "R_2Hz_sigma5",
    "R_airspeed_high",
    "R_airspeed_low",
)
SPEED_M_S, HEIGHT_M, BANK_DEG = 12.0, 100.0, 35.0
FLIGHT_S, TAIL_S = 300.0, 150.0
TIMES, PLUS_M = 1.5, 0.3
"""How far above the study's rms a flight on the stub may lie."""
STUDY_RUNS = 200


def rig_of(s: Scenario, seed: int, law: str = "tangent", estimator: str = "drift") -> Rig:
    """Return the scenario as a flight of the stub's airplane, start and directions drawn by the seed."""
    draw = random.Random(f"{s.name} {seed}")
    wind, target, bearing, heading = (draw.uniform(-math.pi, math.pi) for _ in range(4))
    period_s = s.range_every * s.control_s
    slow = s.lag_s > PLANNED_LAG_S["R"]  # a lag as long, and as wrongly believed, as in the study's row
    app = config(
        vehicle={"class": "px4_fixed_wing"},
        # The airplane flies the airspeed that is shown: so much more, and it is SPEED_M_S in truth.
        orbit={"radius_m": s.r_a_m, "speed_m_s": SPEED_M_S * s.believed_speed},
        law={"name": law, "lag_s": PLANNED_LAG_S["R"]} if slow else {"name": law},
        estimator={"name": estimator},
        ranging={"sigma_m": s.sigma_r_m, "max_age_s": max(1.0, 3.0 * period_s)},
        limits={"turn_accel_rad_s2": 0.5, "bank_deg": BANK_DEG},
    )
    world = airborne(
        distance_m=draw.uniform(*s.start_m),
        bearing_rad=bearing,
        heading_rad=heading,
        height_m=HEIGHT_M,
        airframe="fixed_wing",
        start_speed_m_s=SPEED_M_S,
        seed=seed,
        wind_east_m_s=s.wind_m_s * math.cos(wind),
        wind_north_m_s=s.wind_m_s * math.sin(wind),
        beacon_east_m_s=s.target_m_s * math.cos(target),
        beacon_north_m_s=s.target_m_s * math.sin(target),
        airspeed_scale=s.believed_speed,
        **({"roll_lag_s": s.lag_s} if slow else {}),
        range_sigma_m=s.sigma_r_m,
        range_rate_hz=1.0 / period_s,
        range_max_m=5000.0,
        range_dropouts_s=s.gaps_s,
        outlier_share=s.outlier_share,
        outlier_mean_m=s.outlier_mean_m or 10.0,
    )
    return Rig(app, world)


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of a row on the stub. Metres, of the true horizontal range."""

    name: str
    flights: int
    rms_m: float  # pooled over the flights
    worst_rms_m: float
    least_range_m: float
    lost: int  # flights with an rms above a quarter of the radius, or given up
    study_rms_m: float

    @property
    def bound_m(self) -> float:
        return TIMES * self.study_rms_m + PLUS_M


def fly(name: str, seeds: Sequence[int]) -> Flown:
    """Fly a row with each seed and return what came of it."""
    s = SCENARIOS[name]
    rms, least = [], math.inf
    for seed in seeds:
        rig = rig_of(s, seed).engage()
        log = rig.run(FLIGHT_S - rig.now_s)
        held = log.phases[-1] in ("acquiring", "orbiting", "coasting")
        rms.append(log.rms_m(TAIL_S) if held else math.inf)
        least = min(least, *(s.r_a_m + error for error in log.error_m()))
    return Flown(
        name,
        len(rms),
        math.sqrt(sum(e * e for e in rms) / len(rms)),
        max(rms),
        least,
        sum(e > compare.LOST_SHARE * s.r_a_m for e in rms),
        compare.row(s, Pilot(*compare.BEST), STUDY_RUNS, 1).tail_rms_m,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 when a row lies above its bound, 2 for a row that does not exist."""
    parser = argparse.ArgumentParser(prog="python -m tests.stub_rows", description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--seeds", type=int, default=4, help="flights a row")
    parser.add_argument("--seed", type=int, default=1, help="the first of them")
    given = parser.parse_args(arguments)
    unknown = [name for name in given.rows if name not in ROWS]
    if unknown:
        print(f"no row {', '.join(unknown)}; there are {', '.join(ROWS)}", file=sys.stderr)
        return 2
    print("| row | flights | rms m | the study's rms m | bound m | worst flight's rms m | least range m | lost |")
    print("|---|---|---|---|---|---|---|---|")
    within = True
    for name in given.rows or ROWS:
        row = fly(name, range(given.seed, given.seed + given.seeds))
        within = within and row.rms_m <= row.bound_m
        numbers = (row.rms_m, row.study_rms_m, row.bound_m, row.worst_rms_m)
        cells = [name, str(row.flights), *(f"{x:.2f}" for x in numbers), f"{row.least_range_m:.0f}", str(row.lost)]
        print(f"| {' | '.join(cells)} |", flush=True)
    return 0 if within else 1


if __name__ == "__main__":
    sys.exit(main())
