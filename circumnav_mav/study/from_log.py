"""What a recorded flight tells of its aircraft: range noise and rate, the lag of its turns, and the wind.

Reads the `ticks.csv` of a flight's record. Each figure comes with a reason when the flight does not show it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from circumnav_mav.report import numbers, read_columns

Floats = NDArray[np.float64]

MOST_LAG_S = 3.0
LEAST_RANGES = 60
LEAST_TURNING_RAD_S = 0.02
"""Standard deviation of the turn rate sent below which no lag can be seen."""

NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal draw."""

STEP_S = 0.05
"""Grid on which the lag is looked for."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What was seen, or None; `reasons` says why not."""

    sigma_r_m: float | None
    range_rate_hz: float | None
    lag_s: float | None  # of the turn rate: time to 63 % of a step, dead time in it
    wind_m_s: float | None  # as it shows in the speed over the ground
    reasons: tuple[str, ...]


def look(record: Path) -> Seen:
    """Return what a flight's directory (or its ticks.csv) tells. Raises ValueError in words when it cannot be read."""
    file = record / "ticks.csv" if record.is_dir() else record
    try:
        columns = read_columns(file)
    except (OSError, UnicodeDecodeError) as error:
        wanted = "it is not text; give the flight's directory, or the ticks.csv in it"
        reason = error.strerror if isinstance(error, OSError) else wanted
        raise ValueError(f"cannot read {file}: {reason}") from error
    names = ("t_s", "range_m", "turn_rate_sent_rad_s", "turn_rate_flown_rad_s", "speed_m_s")
    missing = [name for name in names if name not in columns]
    if missing:
        raise ValueError(f"{file} is not the ticks.csv of a flight record: it has no column {missing[0]}")
    t, ranges, sent, flown, speed = (numbers(columns[name]) for name in names)
    if len(t) < 2:
        raise ValueError(f"{file} holds no flight")
    reasons: list[str] = []

    def tried(look_for: Callable[..., Any], *arguments: Floats) -> Any:
        try:
            return look_for(*arguments)
        except ValueError as error:
            reasons.append(str(error))
            return None

    sigma, rate = tried(range_noise, t, ranges) or (None, None)
    lag = tried(turn_lag, t, sent, flown)
    wind = tried(wind_in_speed, t[np.isfinite(sent)], flown[np.isfinite(sent)], speed[np.isfinite(sent)])
    return Seen(sigma, rate, lag, wind, tuple(reasons))


def range_noise(t: Floats, ranges: Floats) -> tuple[float, float]:
    """Return (standard deviation [m], rate [Hz]) of the ranges, each of which stands until the next one.

    Third differences take any smooth motion out and leave 20 times the variance. Echoes, ranges far off the running
    median, are set aside until nothing changes; a median stands against the few that are not seen.
    """
    fresh = np.flatnonzero(np.diff(ranges, prepend=np.nan) != 0.0)
    fresh = fresh[np.isfinite(ranges[fresh])]
    if len(fresh) < LEAST_RANGES:
        raise ValueError(f"range noise: only {len(fresh)} ranges in the record, {LEAST_RANGES} are needed")
    period = float(np.median(np.diff(t[fresh])))
    off = np.abs(ranges[fresh] - median_filter(ranges[fresh], 9, mode="nearest"))
    close = t[fresh][3:] - t[fresh][:-3] < 4.0 * period
    rough = np.abs(np.diff(ranges[fresh], 3)) / NORMAL_MEDIAN / np.sqrt(20.0)
    sigma = inf
    for _ in range(10):
        # Only four ranges in a row, none missing or set aside among them.
        in_a_row = close & sliding_window_view(off <= 4.0 * sigma, 4).all(axis=1)
        if in_a_row.sum() < LEAST_RANGES // 4:
            raise ValueError("range noise: too few ranges in a row without a gap or an echo")
        sigma = float(np.median(rough[in_a_row]))
    return sigma, 1.0 / period


def turn_lag(t: Floats, sent: Floats, flown: Floats) -> float:
    """Return the lag [s] by which the turn rate flown best follows the one sent: dead time and first order together."""
    both = np.isfinite(sent) & np.isfinite(flown)
    t, sent, flown = t[both], sent[both], flown[both]
    if len(t) < LEAST_RANGES or float(np.std(sent)) < LEAST_TURNING_RAD_S:
        raise ValueError("turn-rate lag: the turns sent hardly change in this record")
    even = np.arange(t[0], t[-1], STEP_S)
    flown = np.interp(even, t, flown)
    best, found = inf, 0.0
    for dead_s in np.arange(0.0, 1.01, STEP_S):
        late = np.interp(even - dead_s, t, sent)
        fit = minimize_scalar(_misfit, bounds=(1e-3, MOST_LAG_S), method="bounded", args=(late, flown))
        if fit.fun < best:
            best, found = float(fit.fun), float(dead_s + fit.x)
    if best > 0.5 * float(np.var(flown)):
        raise ValueError("turn-rate lag: the turns flown do not follow those sent in this record")
    return found


def _misfit(lag_s: float, sent: Floats, flown: Floats) -> float:
    """Return the variance of what a first-order lag of `sent` leaves of `flown`; a constant offset is free."""
    keep = np.exp(-STEP_S / lag_s)
    follows, _ = lfilter([0.0, 1.0 - keep], [1.0, -keep], sent, zi=[flown[0]])
    return float(np.var(flown - follows))


def wind_in_speed(t: Floats, flown: Floats, speed: Floats) -> float:
    """Return the wind [m/s] that makes the speed over the ground swing once a turn: over the last whole turns.

    Nothing shows, and nothing matters, where the autopilot holds the speed over the ground.
    """
    both = np.isfinite(flown) & np.isfinite(speed)
    t, flown, speed = t[both], flown[both], speed[both]
    if len(t) < LEAST_RANGES:
        raise ValueError("wind: the record holds less than one whole turn")
    left = np.concatenate([[0.0], np.cumsum(0.5 * (flown[1:] + flown[:-1]) * np.diff(t))])
    turned = np.abs(left[-1] - left) / (2.0 * np.pi)
    late = t >= t[0] + 0.5 * (t[-1] - t[0])
    turns = int(turned[late].max())
    if turns < 1:
        raise ValueError("wind: the second half of the record holds less than one whole turn")
    use = late & (turned <= turns)
    shape = np.column_stack([np.ones(int(use.sum())), np.cos(left[use]), np.sin(left[use])])
    _, east, north = np.linalg.lstsq(shape, speed[use], rcond=None)[0]
    return hypot(float(east), float(north))
