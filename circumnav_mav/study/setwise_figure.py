"""The set-wise stability study as one figure of four panels, and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from circumnav_mav.study.setwise import BIN_S, Outcome, Trial, mean_length, recurrence_ratio, spread_starts, study

KAPPAS = (2.5, 3.0, 5.0, 10.0, 20.0)
SIGMAS = (0.1, 0.2, 0.35, 0.5, 1.0)
SHOWN_SIGMA, SHOWN_KAPPA = 0.35, 5.0
"""The paper's plant, 0.5 m/s held for 0.5 s, is the SDE of 0.35 m/sqrt(s)."""


def trials() -> list[Trial]:
    """Return the grid of gains and noises that the page reports."""
    pairs = [(kappa, sigma) for kappa in KAPPAS for sigma in SIGMAS]
    return [Trial(kappa, sigma, stream=stream) for stream, (kappa, sigma) in enumerate(pairs)]


def table(outcomes: Sequence[Outcome], runs: int, seed: int) -> list[list[str]]:
    """Return one row a trial, a header row first."""
    starts = spread_starts(runs, seed)
    head = ["kappa", "sigma", "r_i+,eps ... r_a,eps m", "longest wait s", "wait / bound", "in U", "stay s", "away s"]
    rows = [[*head, "longest away s", "E d² m²", "furthest m"]]
    for outcome in outcomes:
        trial, visits = outcome.trial, outcome.visits
        rows.append(
            [
                f"{trial.kappa:g}",
                f"{trial.sigma:g}",
                f"{trial.target.inside_m:.2f} ... {trial.target.outside_m:.2f}",
                f"{visits['hit_s'].max():.0f}",
                f"{recurrence_ratio(outcome, starts):.3f}",
                f"{visits['inside'].mean():.3f}",
                _length(outcome, "in_s", "exits"),
                _length(outcome, "out_s", "returns"),
                f"{visits['longest_s'].max():.0f}",
                f"{visits['d2'].mean():.2g}",
                f"{visits['furthest_m'].max():.2f}",
            ]
        )
    return rows


def _length(outcome: Outcome, time: str, ends: str) -> str:
    """Return a mean length [s] in words, "> x" where too few stays or excursions ended to tell it."""
    length_s, bound = mean_length(outcome, time, ends)
    return ("> " if bound else "") + (f"{length_s:.1f}" if length_s < 99.95 else f"{length_s:.0f}")


def draw(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Write the figure as PNG and SVG and return the files."""
    figure = Figure(figsize=(9.0, 7.2), layout="constrained")
    share, times, survival, moment = figure.subplots(2, 2).ravel()
    for kappa in KAPPAS:
        row = [outcome for outcome in outcomes if outcome.trial.kappa == kappa]
        sigmas = [outcome.trial.sigma for outcome in row]
        label = f"κ = {kappa:g}"
        share.plot(sigmas, [outcome.visits["inside"].mean() for outcome in row], "o-", ms=3, lw=1, label=label)
        shown = next(outcome for outcome in row if outcome.trial.sigma == SHOWN_SIGMA)
        left = shown.lengths.sum() - np.cumsum(shown.lengths)
        survival.plot(BIN_S * np.arange(1, len(left) + 1), left / shown.lengths.sum(), lw=1, label=label)
    for time, ends, label in (("in_s", "exits", "a stay in U"), ("out_s", "returns", "an excursion")):
        row = [outcome for outcome in outcomes if outcome.trial.sigma == SHOWN_SIGMA]
        means = [mean_length(outcome, time, ends) for outcome in row]
        kappas = [outcome.trial.kappa for outcome in row]
        [line] = times.plot(kappas, [length_s for length_s, _ in means], "o-", ms=3, lw=1, label=label)
        for kappa, (length_s, bound) in zip(kappas, means, strict=True):
            if bound:  # an arrow: the true one lies above
                times.plot([kappa], [length_s], "^", ms=8, color=line.get_color())
    for outcome in outcomes:
        if outcome.trial.kappa == SHOWN_KAPPA:
            t = outcome.trial.hold_s * np.arange(len(outcome.d2))
            moment.plot(t[::50], outcome.d2[::50], lw=1, label=f"σ = {outcome.trial.sigma:g}")
    share.set(xlabel="σ [m/√s]", ylabel="share of the second half in U", ylim=(0, 1), title="where it is")
    times.set_xscale("log")
    times.set_xticks(KAPPAS, labels=[f"{kappa:g}" for kappa in KAPPAS])
    times.xaxis.set_minor_locator(NullLocator())
    times.set(xlabel="κ", ylabel="mean length [s]", yscale="log", title=f"how long, σ = {SHOWN_SIGMA:g}")
    survival.set(xlabel="t [s]", ylabel="share of excursions longer than t", yscale="log", ylim=(1e-4, 1), xlim=(0, 60))
    survival.set_title(f"how excursions end, σ = {SHOWN_SIGMA:g}")
    moment.set(
        xlabel="t [s]", ylabel="E d² [m²]", yscale="log", ylim=(1e-5, 500), title=f"how far, κ = {SHOWN_KAPPA:g}"
    )
    folder.mkdir(exist_ok=True)
    files = [folder / f"setwise.{kind}" for kind in ("png", "svg")]
    for axes in (share, times, survival, moment):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    for file in files:
        figure.savefig(file, dpi=80)
    return files


def run(folder: Path, runs: int = 200, seed: int = 1) -> list[list[str]]:
    """Fly the grid, draw it into the folder, and return its table."""
    outcomes = study(trials(), runs, seed)
    draw(outcomes, folder)
    return table(outcomes, runs, seed)
