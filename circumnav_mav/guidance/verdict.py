"""Whether a gain suits an aircraft, in plain words: the theory of feasibility.py against what the vehicle can fly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, inf, isfinite, nan, pi, sqrt, tan
from typing import Literal

from circumnav_mav.guidance import feasibility as theory
from circumnav_mav.guidance.laws.hashemi2013 import inner_radius

Severity = Literal["info", "warning", "error"]

LOSES_IN = 0.2
"""Wind over speed from where the paper's law is known to lose flights (docs/estimation.md, docs/tuning.md)."""
RESERVE = 0.2
"""Wind over speed that a circle should bear where nobody says how much it blows."""
MOST_LAPS = 100.0
"""A bound on the mean time above this many laps is not worth a line."""


@dataclass(frozen=True, slots=True)
class Finding:
    severity: Severity  # error: the orbit cannot be held so; warning: it suffers; info: what to expect
    topic: str  # one word, stable: for tests and for --json
    text: str


@dataclass(frozen=True, slots=True)
class Flight:
    """What is asked of which aircraft. NaN where nothing is known: what depends on it is then left out."""

    r_a: float  # orbit radius, m
    kappa: float  # gain k r_a
    V: float  # speed, m/s
    turn_rate_limit: float = nan  # rad/s
    bank_limit: float = nan  # rad; NaN for a multirotor that turns without banking
    lag_s: float = nan  # of turn rate, velocity and filters together
    update_s: float = nan  # how long one command is held
    wind: float = nan  # greatest steady wind expected, m/s
    over_ground: bool = False  # V is held over the ground, whatever the wind


def report_plain(flight: Flight) -> list[Finding]:
    """Return what holds for any law: lap time, what the circle itself asks of the vehicle, its bank, and wind."""
    found = [*_circle(flight), *_bank(flight), *_wind_plain(flight)]
    return sorted(found, key=lambda finding: ("error", "warning", "info").index(finding.severity))


def _circle(f: Flight) -> Iterator[Finding]:
    text = f"one lap takes {theory.lap_time_s(f.r_a, f.V):.4g} s and turns at {f.V / f.r_a:.3g} rad/s"
    if isfinite(f.turn_rate_limit):
        text += f"; at the limit of {f.turn_rate_limit:.3g} rad/s it turns on {f.V / f.turn_rate_limit:.4g} m"
    yield Finding("info", "circle", text)


def report(flight: Flight) -> list[Finding]:
    """Return what the theory of the paper's law says of this flight, gravest first.

    Raises ValueError where no orbit exists at all.
    """
    theory.gain_per_m(flight.r_a, flight.kappa)
    parts = (_orbit, _turn_rate, _bank, _timing, _wind, _recurrence)
    found = [finding for part in parts for finding in part(flight)]
    return sorted(found, key=lambda finding: ("error", "warning", "info").index(finding.severity))


def verdict(findings: list[Finding]) -> str:
    """Return one plain sentence for the whole list."""
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = sum(finding.severity == "warning" for finding in findings)
    if errors:
        return f"This will not hold the orbit: {errors} thing{'s' * (errors > 1)} to mend first."
    if warnings:
        return f"This flies, with {warnings} thing{'s' * (warnings > 1)} to know."
    return "This gain suits the aircraft."


def _orbit(f: Flight) -> Iterator[Finding]:
    text = (
        f"kappa {f.kappa:.3g} on {f.r_a:.4g} m is k = {f.kappa / f.r_a:.4g} rad/m and steers to the tangent of "
        f"r_s = {inner_radius(f.r_a, f.kappa):.4g} m; one lap takes {theory.lap_time_s(f.r_a, f.V):.4g} s"
    )
    yield Finding("info", "gain", text)


def _turn_rate(f: Flight) -> Iterator[Finding]:
    greatest, limit = theory.greatest_turn_rate(f.r_a, f.kappa, f.V), f.turn_rate_limit
    if not isfinite(limit):
        return
    if f.V / f.r_a > limit:
        text = (
            f"the orbit itself needs {f.V / f.r_a:.3g} rad/s, more than the limit of {limit:.3g}: "
            f"fly slower or on {f.V / limit:.4g} m or more"
        )
        yield Finding("error", "turn_rate", text)
    elif greatest > limit:
        free = theory.unsaturated_kappa(f.r_a, f.V, limit)
        cure = f"kappa {free:.3g} or less never does" if free >= 1.0 else "here every kappa can"
        text = (
            f"the law asks for up to 2 k V = {greatest:.3g} rad/s, the limit is {limit:.3g}: "
            f"entries from far or head-on will saturate ({cure}), and then turn on V / limit = {f.V / limit:.4g} m"
        )
        yield Finding("warning", "saturation", text)
    else:
        text = (
            f"the law asks for at most 2 k V = {greatest:.3g} rad/s, a turn on "
            f"{theory.least_turn_radius(f.r_a, f.kappa):.4g} m; the limit is {limit:.3g}"
        )
        yield Finding("info", "turn_rate", text)


def _bank(f: Flight) -> Iterator[Finding]:
    limit = theory.GRAVITY_M_S2 * tan(f.bank_limit) / f.V if isfinite(f.bank_limit) else inf
    by = f"a bank of {degrees(f.bank_limit):.3g} deg at {f.V:.3g} m/s"
    if f.V / limit > f.r_a:
        text = f"{by} holds no circle below {f.V / limit:.4g} m; the orbit is {f.r_a:.4g} m"
        yield Finding("error", "bank", text)
        return
    if f.turn_rate_limit < limit * (1.0 - 1e-9):
        limit = f.turn_rate_limit
        by = f"a turn rate of {limit:.3g} rad/s at {f.V:.3g} m/s"
    if isfinite(limit) and f.V / limit <= f.r_a and not f.over_ground:
        yield from _circle_in_wind(f, limit, by)


def _circle_in_wind(f: Flight, limit: float, by: str) -> Iterator[Finding]:
    """Yield what the turn-rate limit [rad/s], words: `by`, leaves for wind: the sharpest place is downwind."""
    most = sqrt(limit * f.V * f.r_a) - f.V
    if f.wind > most:
        needed = (f.V + f.wind) ** 2 / (f.V * limit)
        text = f"{by} holds no circle below {needed:.4g} m downwind in {f.wind:.3g} m/s; the orbit is {f.r_a:.4g} m"
        yield Finding("error", "bank", text)
    elif most >= f.V:
        yield Finding("info", "bank", f"{by} holds this circle in any wind that the vehicle can fly against")
    else:
        text = f"{by} holds this circle in wind up to {most:.3g} m/s"
        scant = most < RESERVE * f.V and not isfinite(f.wind)
        if scant:
            least_m = (1.0 + RESERVE) ** 2 * f.V / limit
            text += f"; for a fifth of the speed fly {least_m:.4g} m or wider, or say the strongest: study.wind_m_s"
        yield Finding("warning" if scant else "info", "bank", text)


def _timing(f: Flight) -> Iterator[Finding]:
    hold = f.update_s if isfinite(f.update_s) else 0.0
    if isfinite(f.lag_s) or hold > 0.0:
        lag = (f.lag_s if isfinite(f.lag_s) else 0.0) + 0.5 * hold
        number = theory.lag_number(f.r_a, f.kappa, f.V, lag)
        calm_kappa = theory.LAG_WARNING * f.r_a / (f.V * lag) if lag > 0.0 else nan
        words = f"a total lag of {lag:.3g} s (half the hold counted) gives k V T = {number:.2g}"
        cure = f"kappa {calm_kappa:.3g} gives {theory.LAG_WARNING:g}" if calm_kappa >= 1.0 else "lower the lag or speed"
        if number >= theory.LAG_UNSTABLE:
            yield Finding("error", "lag", f"{words}: from about 0.7 the vehicle weaves about the circle ({cure})")
        elif number > theory.LAG_WARNING:
            yield Finding("warning", "lag", f"{words}: above {theory.LAG_WARNING:g} the circle swings ({cure})")
        else:
            yield Finding("info", "lag", f"{words}, well inside the 0.7 that the loop bears")
    turn = theory.greatest_turn_rate(f.r_a, f.kappa, f.V) * hold
    if turn > pi:
        text = (
            f"one command held for {hold:.3g} s can turn the vehicle by {turn:.3g} rad, more than half round: it can "
            "spin out; send commands faster or lower kappa"
        )
        yield Finding("warning", "spin", text)


def _wind_plain(f: Flight) -> Iterator[Finding]:
    if not isfinite(f.wind) or f.wind <= 0.0:
        return
    if f.over_ground:
        text = (
            f"a steady wind of {f.wind:.3g} m/s moves nothing here, if the autopilot can hold the speed over the "
            f"ground: against the wind that is {f.V + f.wind:.3g} m/s through the air"
        )
        yield Finding("warning" if f.wind >= f.V else "info", "wind", text)
    elif f.wind >= f.V:
        text = f"a wind of {f.wind:.3g} m/s is as fast as the vehicle ({f.V:.3g}): no orbit over the ground can be held"
        yield Finding("error", "wind", text)
    else:
        text = f"in a wind of {f.wind:.3g} m/s it does {f.V - f.wind:.3g} to {f.V + f.wind:.3g} m/s over the ground"
        yield Finding("info", "wind", text)


def _wind(f: Flight) -> Iterator[Finding]:
    if not 0.0 < f.wind < f.V or (f.over_ground and f.wind > LOSES_IN * f.V):
        yield from _wind_plain(f)
        return
    if f.wind > LOSES_IN * f.V:
        [plain] = _wind_plain(f)
        text = (
            f"{plain.text}: above {LOSES_IN:g} of the speed this law loses some flights downwind, whatever the gain; "
            "law tangent on estimator drift does not up to 0.8"
        )
        yield Finding("warning", "wind", text)
        return
    shift = theory.orbit_shift(f.r_a, f.kappa, f.wind / f.V)
    moved = f"moves the circle by about {shift.size_m:.3g} m with this law"
    if f.over_ground:
        [plain] = _wind_plain(f)
        yield Finding("info", "wind", f"{plain.text}; a target that moves so fast {moved}")
        return
    text = (
        f"a steady wind of {f.wind:.3g} m/s {moved} "
        "(first order in wind / speed; less with a larger kappa, none with law tangent on estimator drift)"
    )
    yield Finding("warning" if shift.size_m > 0.1 * f.r_a else "info", "wind", text)


def _recurrence(f: Flight) -> Iterator[Finding]:
    if f.wind > 0.0 and not f.over_ground:
        return  # proven in calm air only
    orbits, eps = theory.inner_orbits(f.r_a, f.kappa), 0.5 * (theory.eps_max(f.r_a, f.kappa) or 0.0)
    target = theory.recurrent_set(f.r_a, f.kappa, eps)
    bound = theory.recurrence_bound_s(3.0 * f.r_a, pi, f.r_a, f.kappa, f.V, eps)
    if orbits is None or target is None or bound is None:
        text = "kappa is at or below sqrt(5) = 2.24: the paper proves no return to the circle there (it still flies)"
        yield Finding("info", "recurrence", text)
        return
    if bound > MOST_LAPS * theory.lap_time_s(f.r_a, f.V):
        return  # just above sqrt(5) it is astronomical, and says nothing
    text = (
        f"from three radii out and flying away, noise on the range rate or not, in calm air, without lag and where the "
        f"turn-rate limit is not met, the mean time into "
        f"{target.inside_m:.4g} ... {target.outside_m:.4g} m is below {bound:.3g} s by the paper's bound; circles of "
        f"{orbits[0]:.3g} and {orbits[1]:.4g} m the wrong way round are unstable equilibria"
    )
    yield Finding("info", "recurrence", text)
