"""What the paper claims, measured: the tables of docs/paper_study.md that `circumnav study` does not print.

    python -m circumnav_mav.study.paper_claims [FOLDER]

Prints Markdown; with a folder, draws the set-wise figure there.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from circumnav_mav.guidance import feasibility
from circumnav_mav.guidance.kernel import Estimate
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.laws.hashemi2013 import inner_radius, parameters
from circumnav_mav.study import paper_core, paper_run, setwise
from circumnav_mav.study.paper import LAW, Options
from circumnav_mav.study.paper_figures import OUTER_ALONE
from circumnav_mav.study.paper_run import Plant, Table
from circumnav_mav.writable import refusal_of_folder

RUNS, SEED, R_A = 400, 1, 10.0
VALLEY_RUNS = 2000
"""For each gain of a valley that is flat within a few percent."""

Row = Sequence[str]


def fitted_centre(x: paper_core.Floats, y: paper_core.Floats) -> tuple[float, float]:
    """Return the centre [m] of the circle fitted over angle: the first harmonic of r, each bearing weighing the same.

    A fit over time would favour the slow, upwind side.
    """
    sectors = 72
    where = (np.arctan2(y, x) % math.tau / math.tau * sectors).astype(int)
    counts = np.bincount(where, minlength=sectors)
    r = np.bincount(where, np.hypot(x, y), minlength=sectors)[counts > 0] / counts[counts > 0]
    angle = ((np.arange(sectors) + 0.5) * math.tau / sectors)[counts > 0]
    shape = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    _, east, north = np.linalg.lstsq(shape, r, rcond=None)[0]
    return float(east), float(north)


def tail_mse(k: float, plant: Plant, law: str = LAW, runs: int = RUNS) -> float:
    return float(paper_run.sweep([paper_run.case(law, {"k": k}, plant)], runs, SEED)["mse_tail"].mean())


def linear_prediction() -> Iterator[Row]:
    """The loop linearised at the orbit, rho'' + k V rho' + (k V)^2 rho = - k V nu, has variance sigma^2 T / (2 k V)."""
    yield "k", "r_a - r_s m", "linear theory m²", "flown m²"
    plant = Plant()
    for k in (0.1, 0.175, 0.25, 0.4, 1.0):
        predicted = plant.sigma_m_s**2 * plant.hold_s / (2.0 * k * plant.V_m_s)
        gap = R_A - inner_radius(R_A, k * R_A)
        yield f"{k:g}", f"{gap:.3f}", f"{predicted:.3f}", f"{tail_mse(k, plant):.3f}"


def spinning_out() -> Iterator[Row]:
    """Where the error turns up again, for several holds: the paper puts it at 2 k V = pi, k = 1.57."""
    head = ["hold s", "least m²", "k within 2 % of it", "their k V T", "m² at k 1.6", "m² at k 2.95"]
    yield *head, "k of twice the least", "its k V T"
    for hold_s in (0.25, 0.5, 1.0, 2.0):
        gains = np.geomspace(0.15, 4.5 / hold_s, 50)
        errors = errors_in_one_noise([*gains.tolist(), 1.6, 2.95], Plant(hold_s=hold_s))
        least, low, high, double = valley(gains, errors[:-2])
        at = [f"{error:.3f}" for error in errors[-2:]]
        span, scaled = f"{low:.2f} ... {high:.2f}", f"{low * hold_s:.2f} ... {high * hold_s:.2f}"
        yield f"{hold_s:g}", f"{least:.4f}", span, scaled, *at, f"{double:.2f}", f"{double * hold_s:.2f}"


def errors_in_one_noise(gains: Sequence[float], plant: Plant, runs: int = VALLEY_RUNS) -> paper_core.Floats:
    """Return the tail's mean square [m^2] at each gain, all in the same noise: only the gain differs."""
    cases = [paper_run.case(LAW, {"k": k}, plant) for k in gains]
    errors: paper_core.Floats = paper_run.sweep(cases, runs, SEED)["mse_tail"].mean(axis=1)
    return errors


def valley(gains: paper_core.Floats, errors: paper_core.Floats) -> tuple[float, float, float, float]:
    """Return the least error, the gains between which it is within 2 % of that, and the gain beyond of twice it."""
    best = int(np.argmin(errors))
    floor = np.flatnonzero(errors <= 1.02 * errors[best])
    beyond = np.flatnonzero(errors[best:] > 2.0 * errors[best])
    double = float(gains[best + beyond[0]]) if len(beyond) else math.nan
    return float(errors[best]), float(gains[floor[0]]), float(gains[floor[-1]]), double


def shift_in_wind() -> Iterator[Row]:
    """The centre of the circle in the paper's wind: predicted to the first order, and fitted to flights in noise."""
    yield "k", "predicted (downwind, to the left) m", "fitted m", "fitted without noise, W/V = 0.02, scaled m"
    options = Options()
    windy, towards = options.plant("wind"), math.pi / 4
    for k in (0.1, 0.175, 0.25, 0.4, 1.0):
        shift = feasibility.orbit_shift(R_A, k * R_A, 0.25)
        small = replace(windy, wind_x_m_s=windy.wind_x_m_s * 0.08, wind_y_m_s=windy.wind_y_m_s * 0.08, sigma_m_s=0.0)
        found = [_turned(_centre(k, windy, 20), -towards), _turned(_centre(k, small, 1), -towards)]
        exact = tuple(value / 0.08 for value in found[1])
        yield f"{k:g}", _pair(shift.centre(0.0)), _pair(found[0]), _pair(exact)


def _centre(k: float, plant: Plant, runs: int) -> tuple[float, float]:
    case = paper_run.case(LAW, {"k": k}, plant)
    tails = [paper_run.trace(case, SEED, run)[plant.steps // 2 :] for run in range(runs)]
    return fitted_centre(*(np.concatenate([tail[axis] for tail in tails]) for axis in ("x_m", "y_m")))


def _turned(point: tuple[float, float], by: float) -> tuple[float, float]:
    x, y = point
    return x * math.cos(by) - y * math.sin(by), x * math.sin(by) + y * math.cos(by)


def _pair(values: Sequence[float]) -> str:
    return f"{values[0]:.2f}, {values[1]:.2f}"


def outer_law_alone() -> Iterator[Row]:
    """The reason for the inner law: u_o alone flies straight on inside r_s."""
    yield "k", "u_o alone: tail m²", "u: tail m²"
    for k in (0.2, 1.0):
        yield f"{k:g}", f"{tail_mse(k, Plant(), OUTER_ALONE):.3f}", f"{tail_mse(k, Plant()):.3f}"


def leaving_the_inner_orbit() -> Iterator[Row]:
    """How long a start on the inner equilibrium itself takes to get outside r_s: with noise, and with rounding only."""
    yield "k", "r_i- m", "noise of the paper: median s", "no noise: s"
    for k in (0.3, 0.5, 1.0, 2.0):
        orbits = feasibility.inner_orbits(R_A, k * R_A)
        if orbits is None:
            continue
        plant = Plant(x_m=-orbits[0], heading_rad=1.5 * math.pi)
        noisy = [_time_out(paper_run.trace(paper_run.case(LAW, {"k": k}, plant), SEED, run), k) for run in range(60)]
        quiet = paper_run.case(LAW, {"k": k}, replace(plant, sigma_m_s=0.0, duration_s=2000.0))
        yield (
            f"{k:g}",
            f"{orbits[0]:.2f}",
            f"{np.median(noisy):.1f}",
            f"{_time_out(paper_run.trace(quiet, SEED), k):.0f}",
        )


def _time_out(rows: Table, k: float) -> float:
    out = np.flatnonzero(rows["r_m"] > inner_radius(R_A, k * R_A))
    return float(rows["t_s"][out[0]]) if len(out) else math.inf


def starts() -> Iterator[Row]:
    """The start decides the mean over the whole run, not that over the tail."""
    yield "start (x, y, heading)", "k", "whole run m²", "tail m²"
    for x, heading, words in ((-20.0, 0.0, "(-20, 0), inwards"), (-10.0, math.pi / 2, "(-10, 0), on the circle")):
        for k in (0.1, 0.4, 1.0, 1.6, 2.95):
            case = paper_run.case(LAW, {"k": k}, Plant(x_m=x, heading_rad=heading))
            [rows] = paper_run.sweep([case], RUNS, SEED)
            yield words, f"{k:g}", f"{rows['mse_all'].mean():.3f}", f"{rows['mse_tail'].mean():.3f}"


def effort_beyond_the_bound() -> Iterator[Row]:
    """The bound 2 k V on u holds for the true range rate; noise on it goes past."""
    yield "k", "share of control instants beyond 2 k V", "greatest u, in k V"
    for k in (0.1, 1.0, 2.95):
        case = paper_run.case(LAW, {"k": k}, Plant())
        u = np.abs(np.concatenate([paper_run.trace(case, SEED, run)["u_rad_s"] for run in range(60)]))
        yield f"{k:g}", f"{np.mean(u > 2.0 * k):.4f}", f"{u.max() / k:.2f}"


def slope_at_r_s() -> Iterator[Row]:
    """The law is called smooth, and Lipschitz even at r_s; its slope there grows without bound, as a square root's."""
    yield "distance outside r_s m", "(u(r_s + h) - u(r_s)) / h, k = 1"
    par = parameters({"k": 1.0}, paper_run.law_context(Plant()))
    for h in (1e-1, 1e-3, 1e-5, 1e-7):
        u = [LAWS[LAW].turn_rate(Estimate(r=par.r_s + step, r_dot=0.0, V=1.0), par) for step in (0.0, h)]
        yield f"{h:g}", f"{(u[1] - u[0]) / h:.1f}"


def set_slips() -> Iterator[Row]:
    """The two slips of the recurrent set at kappa = 5: the quartic's sign, and theta in (0, pi) only."""
    yield "quantity", "as printed", "corrected"
    k, r_s, eps = 0.5, inner_radius(R_A, 5.0), 0.05
    c = (r_s / k) ** 2
    roots = np.roots([1.0, 0.0, c * (eps**2 - k**2), -2.0 * eps * c, c])
    printed = sorted(float(z.real) for z in roots if abs(z.imag) < 1e-9 and 0.0 < z.real < r_s)
    right, orbits = feasibility.inner_edges(R_A, 5.0, eps), feasibility.inner_orbits(R_A, 5.0)
    assert right is not None and orbits is not None  # kappa is 5
    yield "r_i-,eps and r_i+,eps m (eps 0.05)", f"{printed[0]:.3f}, {printed[1]:.3f}", f"{right[0]:.3f}, {right[1]:.3f}"
    drift = max(
        feasibility.lyapunov_drift(float(r), 1.5 * math.pi, R_A, 5.0) for r in np.linspace(orbits[1], r_s, 2000)
    )
    printed_words = f"{drift:+.3f} (supremum 1 / r_s = {1.0 / r_s:.3f})"
    yield "L V outside the set, eps = 0: greatest on a grid of 2,000 r, 1/m", printed_words, "0"


PARTS = (
    ("Linear theory", linear_prediction),
    ("Spinning out", spinning_out),
    ("Shift in wind", shift_in_wind),
    ("The outer law alone", outer_law_alone),
    ("Leaving the inner orbit", leaving_the_inner_orbit),
    ("Starts", starts),
    ("Effort beyond the bound", effort_beyond_the_bound),
    ("Slope at r_s", slope_at_r_s),
    ("The recurrent set", set_slips),
)


def markdown(rows: Sequence[Row]) -> str:
    """Return rows, a header row first, as a Markdown table."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def main(arguments: Sequence[str]) -> int:
    folder = Path(arguments[0]) if arguments else None
    if trouble := refusal_of_folder(folder):
        print(f"paper_claims: {trouble}", file=sys.stderr)
        return 2
    for title, part in PARTS:
        print(f"### {title}\n\n{' '.join((part.__doc__ or '').split())}\n\n{markdown(list(part()))}\n", flush=True)
    if folder is not None:
        from circumnav_mav.study import setwise_figure

        outcomes = setwise.study(setwise_figure.trials(), 200, SEED)
        setwise_figure.draw(outcomes, folder)
        print(f"### Sojourns\n\n{markdown(setwise_figure.table(outcomes, 200, SEED))}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
