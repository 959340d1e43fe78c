"""What ends a flight besides the pilot and a lost range: causes as ONE table, top to bottom. Pure, driven by now_s."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, nan
from typing import NamedTuple

FLY_ON = "fly_on"
"""The action that only tells."""


class Limits(NamedTuple):
    """What is allowed; the defaults allow everything."""

    r_min_m: float = -inf
    r_max_m: float = inf
    battery_pct: float = -inf
    height_lost_s: float = inf
    restarts_a_minute: float = inf
    flight_time_s: float = inf
    laps: float = inf


class Facts(NamedTuple):
    """What the table looks at. NaN: not known, and then no cause."""

    r_m: float = nan  # estimated range, once the band was entered
    battery_pct: float = nan
    battery_alarm: bool = False  # the autopilot itself calls it low
    height_age_s: float = nan  # while engaged
    blind: str = ""  # what no setpoint can be made without, while engaged
    estimates_missing: bool = False  # the autopilot's estimator lost what the vehicle class needs
    restarts_a_minute: int = 0  # of our own estimator, while engaged
    engaged_s: float = nan
    laps: float = nan


class Row(NamedTuple):
    """A cause: holds for `for_s` on end before it counts; `ends`: the flight is over with it."""

    cause: str
    holds: Callable[[Facts, Limits], bool]
    for_s: float
    ends: bool
    text: str


TABLE: tuple[Row, ...] = (
    Row(
        "diverged",
        lambda f, s: f.restarts_a_minute >= s.restarts_a_minute,
        0.0,
        False,
        "the ranges outvoted the estimate {f.restarts_a_minute} times within a minute",
    ),
    Row(
        "band_broken",
        lambda f, s: f.r_m < s.r_min_m or f.r_m > s.r_max_m,
        1.0,
        False,
        "{f.r_m:.1f} m from the beacon, outside {s.r_min_m:g} to {s.r_max_m:g} m",
    ),
    Row(
        "estimates_lost",
        lambda f, s: f.estimates_missing,
        1.0,
        False,
        "the autopilot's estimator has lost attitude or velocity",
    ),
    Row("blind", lambda f, s: bool(f.blind), 0.2, False, "{f.blind}: no setpoint can be made"),
    Row(
        "height_lost",
        lambda f, s: f.height_age_s > s.height_lost_s,
        0.0,
        False,
        "no height from the autopilot for {f.height_age_s:.1f} s",
    ),
    Row(
        "battery_low",
        lambda f, s: f.battery_pct <= s.battery_pct or f.battery_alarm,
        3.0,
        False,
        "battery low: {f.battery_pct:.0f} %, the limit is {s.battery_pct:g} %",
    ),
    Row("time_used_up", lambda f, s: f.engaged_s >= s.flight_time_s, 0.0, True, "{s.flight_time_s:g} s are flown"),
    Row("laps_used_up", lambda f, s: f.laps >= s.laps, 0.0, True, "{s.laps:g} laps are flown"),
)


@dataclass(frozen=True, slots=True)
class Trip:
    """A cause that holds: what is done about it, and what people read."""

    cause: str
    action: str
    ends: bool
    text: str


class Watch:
    """Walks the table at every tick. actions: what to do about each cause, by its name."""

    def __init__(self, limits: Limits, actions: Mapping[str, str]) -> None:
        missing = {row.cause for row in TABLE} - set(actions)
        if missing:
            raise ValueError(f"no action for {', '.join(sorted(missing))}")
        self._limits, self._actions = limits, actions
        self._since_s: dict[str, float] = {}
        self._told: set[str] = set()

    def check(self, now_s: float, facts: Facts) -> tuple[Trip | None, list[Trip]]:
        """Return (the first cause that calls for an action, the causes that began to hold at this tick)."""
        acting: Trip | None = None
        news: list[Trip] = []
        for row in TABLE:
            if not row.holds(facts, self._limits):
                self._since_s.pop(row.cause, None)
                self._told.discard(row.cause)
                continue
            if now_s - self._since_s.setdefault(row.cause, now_s) < row.for_s:
                continue
            trip = Trip(row.cause, self._actions[row.cause], row.ends, row.text.format(f=facts, s=self._limits))
            if row.cause not in self._told:
                self._told.add(row.cause)
                news.append(trip)
            if acting is None and trip.action != FLY_ON:
                acting = trip
        return acting, news
