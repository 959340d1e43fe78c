"""What a flight leaves of every tick: one line of ticks.csv."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from circumnav_mav.guidance.computer import Limits
from circumnav_mav.guidance.phases import ENGAGED


class TickRecord(NamedTuple):
    """One line of the flight record. Seconds are flight seconds but lateness_s, which is on the wall."""

    t_s: float
    phase: str
    control: str
    mode: str
    r_m: float  # estimated horizontal range
    r_dot_m_s: float
    range_m: float  # newest range as measured, used or not
    sample_age_s: float  # of the newest range that was used
    turn_rate_wanted_rad_s: float  # by the law, + counter-clockwise
    turn_rate_sent_rad_s: float  # NaN: nothing sent
    turn_rate_flown_rad_s: float  # measured
    speed_m_s: float
    speed_source: str
    height_m: float
    target_east_m: float  # of the vehicle, estimated; NaN where the estimator or the heading is missing
    target_north_m: float
    target_sigma_m: float  # root of the sum of both variances
    drift_east_m_s: float  # wind minus the target's velocity
    drift_north_m_s: float
    drift_sigma_m_s: float
    target_lat_deg: float  # NaN while the autopilot shows no position
    target_lon_deg: float
    saturated: int  # 1: the law wanted more than the turn-rate limit
    slewed: int  # 1: and a faster change than the turn-acceleration limit
    barrier: int  # 1: its turn rate was changed, to stay within r_min and r_max
    way_out: int  # 1: it gave way to the safer full turn, while the bearing was several
    rejected: int  # ranges rejected so far
    lateness_s: float
    missed_ticks: int


class LimitedTicks:
    """Counts the engaged ticks in which something was taken from the law's turn rate, for the live view."""

    def __init__(self) -> None:
        self._engaged = 0
        self._counts: Counter[str] = Counter()

    def count(self, tick: TickRecord) -> None:
        """Take in one tick."""
        if tick.phase in ENGAGED:
            self._engaged += 1
            self._counts.update({name: getattr(tick, name) for name in Limits._fields})

    def words(self) -> str:
        """Return the shares of the engaged ticks; empty before the first."""
        return ", ".join(f"{name} {count / self._engaged:.1%}" for name, count in self._counts.items())
