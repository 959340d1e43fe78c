"""What a flight was: figures and a picture, read back from its record (and, in the demo, from the stub's truth)."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circumnav_mav.config import Config
from circumnav_mav.guidance.computer import BAND_SHARE, Limits
from circumnav_mav.guidance.phases import ENGAGED
from circumnav_mav.guidance.target import Target, describe, describe_drift
from circumnav_mav.runtime.app import Result

TARGET_COLUMNS = (
    *("t_s", "target_lat_deg", "target_lon_deg", "target_east_m", "target_north_m", "target_sigma_m"),
    *("drift_east_m_s", "drift_north_m_s", "drift_sigma_m_s"),
)

Floats = NDArray[np.float64]
ENGAGED_NAMES = frozenset(str(p) for p in ENGAGED)


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of one flight. Seconds are flight seconds, only tick_lateness_p99_s is on the wall.

    error_from: truth (the stub's, in the demo) or estimate (the app's own, in a real flight). settle_time_s: from
    engagement until the error stays within max(5 % of the radius, 3 sigma_r) for good; None if it never does. tail: the
    last half of the time from settling to the end of the orbit. limited: shares of the engaged ticks in which the law's
    turn rate was saturated, slewed, changed by the barrier at r_min and r_max, or gave way to a way out. target: the
    columns of ticks.csv that tell it, when it was last known while engaged. Figures that do not exist are None.
    """

    outcome: str
    text: str
    phase: str
    error_from: str
    orbit_radius_m: float
    settle_time_s: float | None
    tail_rms_error_m: float | None
    tail_max_error_m: float | None
    ticks: int
    missed_ticks: int
    tick_lateness_p99_s: float | None
    sample_age_p99_s: float | None
    limited: dict[str, float]
    rejected: dict[str, int]
    duration_s: float
    target: dict[str, float | None] | None

    def write(self, path: Path) -> None:
        """Write the figures as JSON. Raises OSError."""
        path.write_text(json.dumps(_known(asdict(self)), indent=2) + "\n", encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Track:
    """The error against time while engaged, from whatever knows it best."""

    source: str
    t_s: Floats
    error_m: Floats


def read_columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a CSV file; a last line that was cut off by a kill is left out."""
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.reader(file)
        header = next(reader, [])
        columns: dict[str, list[str]] = {name: [] for name in header}
        for row in reader:
            if len(row) == len(header):
                for name, value in zip(header, row, strict=True):
                    columns[name].append(value)
    return columns


def numbers(column: list[str]) -> Floats:
    """Return a column as floats; an empty cell is NaN."""
    return np.array([float(v) if v else math.nan for v in column], dtype=np.float64)


def summarise(
    config: Config, result: Result, ticks: dict[str, list[str]], truth: dict[str, list[str]] | None
) -> Summary:
    """Return the figures of a flight from its record and, where there is one, the truth."""
    track = track_of(config, ticks, truth)
    settle_s, rms_m, worst_m = settling(config, track)
    late = numbers(ticks.get("lateness_s", []))
    engaged = np.array([phase in ENGAGED_NAMES for phase in ticks.get("phase", [])], dtype=bool)
    ages = numbers(ticks.get("sample_age_s", []))[engaged]
    flags = [name for name in Limits._fields if engaged.any() and name in ticks]
    limited = {name: share(numbers(ticks[name])[engaged]) for name in flags}
    return Summary(
        outcome=result.outcome,
        text=result.text,
        phase=result.phase,
        error_from=track.source,
        orbit_radius_m=config.orbit.radius_m,
        settle_time_s=settle_s,
        tail_rms_error_m=rms_m,
        tail_max_error_m=worst_m,
        ticks=result.ticks,
        missed_ticks=result.missed_ticks,
        tick_lateness_p99_s=percentile(late, 99),
        sample_age_p99_s=percentile(ages, 99),
        limited=limited,
        rejected=result.rejected,
        duration_s=round(result.duration_s, 3),
        target=last_target(ticks),
    )


def last_target(ticks: dict[str, list[str]]) -> dict[str, float | None] | None:
    """Return where the target was and how it drifted by the last engaged tick that knew it; None where none did."""
    known = [
        phase in ENGAGED_NAMES and math.isfinite(float(east))
        for phase, east in zip(ticks.get("phase", []), ticks.get("target_east_m", []), strict=False)
    ]
    if not any(known):
        return None
    last = len(known) - 1 - known[::-1].index(True)
    values = {name: float(ticks[name][last]) for name in TARGET_COLUMNS}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def track_of(config: Config, ticks: dict[str, list[str]], truth: dict[str, list[str]] | None) -> Track:
    """Return the orbit error while the app held the aircraft."""
    radius = config.orbit.radius_m
    if truth and truth.get("t_s"):
        held = np.array([mode.upper() == "OFFBOARD" for mode in truth["mode"]], dtype=bool)
        return Track("truth", numbers(truth["t_s"])[held], numbers(truth["horizontal_range_m"])[held] - radius)
    held = np.array([phase in ENGAGED_NAMES for phase in ticks.get("phase", [])], dtype=bool)
    return Track("estimate", numbers(ticks.get("t_s", []))[held], numbers(ticks.get("r_m", []))[held] - radius)


def settling(config: Config, track: Track) -> tuple[float | None, float | None, float | None]:
    """Return (settle time, rms and greatest error of the tail); None where there is none."""
    if track.t_s.size == 0:
        return None, None, None
    band_m = max(BAND_SHARE * config.orbit.radius_m, 3.0 * config.ranging.sigma_m)
    outside = np.flatnonzero(~(np.abs(track.error_m) <= band_m))  # NaN counts as outside
    first = 0 if outside.size == 0 else int(outside[-1]) + 1
    if first >= track.t_s.size:
        return None, None, None
    settled_s = track.t_s[first]
    tail = track.error_m[track.t_s >= (settled_s + track.t_s[-1]) / 2]
    settle_s = float(settled_s - track.t_s[0])
    return round(settle_s, 3), _rounded(np.sqrt(np.mean(tail**2))), _rounded(np.max(np.abs(tail)))


def percentile(values: Floats, q: float) -> float | None:
    """Return a percentile of the finite values, None where there are none."""
    finite = values[np.isfinite(values)]
    return _rounded(np.percentile(finite, q), 6) if finite.size else None


def share(flags: Floats) -> float:
    """Return the share of the flags that are set."""
    return _rounded(np.mean(flags))


def _rounded(value: Any, digits: int = 4) -> float:
    return round(float(value), digits)


def lines(summary: Summary) -> list[str]:
    """Return the summary for the terminal."""
    s = summary

    def metres(value: float | None) -> str:
        return "-" if value is None else f"{value:.2f} m"

    settled = "never settled" if s.settle_time_s is None else f"settled {s.settle_time_s:.1f} s after engagement"
    late = "-" if s.tick_lateness_p99_s is None else f"{s.tick_lateness_p99_s * 1e3:.2f} ms"
    age = "-" if s.sample_age_p99_s is None else f"{s.sample_age_p99_s:.2f} s"
    rejected = ", ".join(f"{reason} {count}" for reason, count in sorted(s.rejected.items())) or "none"
    limited = ", ".join(f"{name} {part:.1%}" for name, part in s.limited.items()) or "-"
    return [
        f"outcome    {s.outcome}: {s.text}",
        f"orbit      {s.orbit_radius_m:g} m; {settled}",
        f"error      rms {metres(s.tail_rms_error_m)}, at most {metres(s.tail_max_error_m)} "
        f"(last half, from {s.error_from})",
        f"timing     {s.ticks} ticks, {s.missed_ticks} missed; late by {late} (p99); range age {age} (p99)",
        f"limited    {limited} of the engaged ticks",
        f"rejected   {rejected}",
        *([f"target     {target_words(s.target)}"] if s.target else []),
        f"duration   {s.duration_s:.1f} s",
    ]


def target_words(known: dict[str, float | None]) -> str:
    """Return where the target was found, for people."""
    t = {name: math.nan if value is None else value for name, value in known.items()}
    target = Target(
        t["target_east_m"],
        t["target_north_m"],
        t["target_sigma_m"],
        t["drift_east_m_s"],
        t["drift_north_m_s"],
        t["drift_sigma_m_s"],
    )
    place = None if math.isnan(t["target_lat_deg"]) else (t["target_lat_deg"], t["target_lon_deg"])
    drift = describe_drift(target)
    return f"{describe(target, place)} of the aircraft at {t['t_s']:.1f} s" + (f"; drift {drift}" if drift else "")


def draw(
    path: Path, config: Config, ticks: dict[str, list[str]], truth: dict[str, list[str]] | None, title: str
) -> None:
    """Draw the flight as a PNG. Raises ImportError where matplotlib is not installed, OSError where it cannot write."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    with_track = bool(truth and truth.get("t_s"))
    figure = plt.figure(figsize=(12, 6) if with_track else (10, 6), constrained_layout=True)
    grid = figure.add_gridspec(2, 2 if with_track else 1)
    if with_track and truth:
        _draw_track(figure.add_subplot(grid[:, 0]), config, truth)
    _draw_range(figure.add_subplot(grid[0, -1]), config, ticks)
    _draw_turn_rate(figure.add_subplot(grid[1, -1]), config, ticks)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_track(axes: Any, config: Config, truth: dict[str, list[str]]) -> None:
    beacon_east, beacon_north = numbers(truth["beacon_east_m"]), numbers(truth["beacon_north_m"])
    east, north = numbers(truth["east_m"]) - beacon_east, numbers(truth["north_m"]) - beacon_north
    held = np.array([mode.upper() == "OFFBOARD" for mode in truth["mode"]], dtype=bool)
    axes.plot(east, north, color="0.7", lw=1, label="before and after")
    axes.plot(
        np.where(held, east, np.nan), np.where(held, north, np.nan), color="tab:blue", lw=1.2, label="circumnav flies"
    )
    axes.add_patch(_circle(config.orbit.radius_m))
    axes.plot(0, 0, "k*", ms=10, label="beacon (unknown to the app)")
    axes.plot(east[0], north[0], "o", color="tab:green", label="start")
    axes.set(xlabel="east of the beacon [m]", ylabel="north of the beacon [m]", title="track (truth)", aspect="equal")
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)


def _circle(radius_m: float) -> Any:
    from matplotlib.patches import Circle

    return Circle((0, 0), radius_m, fill=False, ls="--", color="tab:orange", lw=1.5, zorder=3, label="orbit wanted")


def _draw_range(axes: Any, config: Config, ticks: dict[str, list[str]]) -> None:
    t_s, radius = numbers(ticks["t_s"]), config.orbit.radius_m
    band_m = max(BAND_SHARE * radius, 3.0 * config.ranging.sigma_m)
    axes.axhspan(radius - band_m, radius + band_m, color="tab:orange", alpha=0.25, label="orbit band")
    axes.plot(t_s, numbers(ticks["range_m"]), ".", ms=1.5, color="0.6", label="measured")
    axes.plot(t_s, numbers(ticks["r_m"]), color="tab:blue", lw=1, label="horizontal range, estimated")
    axes.set(ylabel="range [m]")
    axes.set_ylim(bottom=0)
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)


def _draw_turn_rate(axes: Any, config: Config, ticks: dict[str, list[str]]) -> None:
    t_s = numbers(ticks["t_s"])
    nominal = config.orbit.speed_m_s / config.orbit.radius_m * (-1 if config.orbit.direction == "clockwise" else 1)
    axes.axhline(nominal, color="tab:orange", ls="--", lw=1, label="of the orbit")
    axes.plot(t_s, numbers(ticks["turn_rate_flown_rad_s"]), color="0.6", lw=0.8, label="flown")
    axes.plot(t_s, numbers(ticks["turn_rate_sent_rad_s"]), color="tab:blue", lw=1, label="asked")
    axes.set(xlabel="flight time [s]", ylabel="turn rate u [rad/s], + left")
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)


def _known(value: Any) -> Any:
    """Return the value with null for every number that is not one: JSON has none."""
    if isinstance(value, dict):
        return {key: _known(one) for key, one in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
