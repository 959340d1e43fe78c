"""The paper's simulated figures, 1 to 12 in the order of its text, as PNG and SVG."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from circumnav_mav.guidance import feasibility
from circumnav_mav.guidance.laws.hashemi2013 import inner_radius
from circumnav_mav.study import paper_run
from circumnav_mav.study.paper import LAW, Options, StudyResult
from circumnav_mav.study.paper_run import Plant, Progress

OUTER_ALONE = "hashemi2013_outer"
"""The registered law of eq. (u_o-defn): zero control inside r_s."""

WITH_R_S = (LAW, OUTER_ALONE)
"""The laws whose radius r_s and whose bound 2 k V are the paper's."""

PATH, ORBIT, TANGENT, TAIL = "tab:blue", "tab:red", "black", "tab:orange"


@dataclass(frozen=True, slots=True)
class Picture:
    number: int
    stem: str
    title: str
    paint: Callable[[Axes, StudyResult], None]
    law: str | None = None  # the law it shows whatever was swept
    title_of_another: str = ""  # where a law is flown for which the title makes no sense


def draw(result: StudyResult, folder: Path, progress: Progress | None = None) -> list[Path]:
    """Write every figure as PNG and SVG into the folder, and return the files."""
    folder.mkdir(exist_ok=True)
    files = []
    for done, picture in enumerate(PICTURES, start=1):
        figure = painted(picture, result)
        for kind in ("png", "svg"):
            files.append(folder / f"figure_{picture.number:02d}_{picture.stem}.{kind}")
            figure.savefig(files[-1], dpi=110)
        if progress is not None:
            progress(done, len(PICTURES))
    return files


def painted(picture: Picture, result: StudyResult) -> Figure:
    """Return one figure. Its title says so where it shows another law, or another estimator, than the paper's does."""
    figure, options = Figure(figsize=(5.0, 4.4)), result.options
    axes = figure.add_axes((0.13, 0.11, 0.84, 0.82))
    picture.paint(axes, result)
    if options.as_the_paper or (picture.law is not None and options.estimator is None):
        title = f"Figure {picture.number}: {picture.title}"
    else:
        own = picture.law is not None or options.law == LAW
        title = f"{picture.title if own else picture.title_of_another or picture.title}\n{options.flown(picture.law)}"
    axes.set_title(title, fontsize=9)
    return figure


def _path(
    axes: Axes, options: Options, law: str | None, k: float, air: str = "calm", noise_run: int = 0, **change: float
) -> None:
    plant = replace(options.plant(air), **change)
    name = law or options.law
    try:
        one = options.case(name, k, plant)
    except ValueError as error:  # a law that takes no gain as small as this picture's: the picture says so
        axes.text(0.5, 0.5, str(error), ha="center", va="center", fontsize=8, wrap=True, transform=axes.transAxes)
        return
    rows = paper_run.trace(one, options.seed, noise_run)
    _scene(axes, plant, inner_radius(plant.r_a_m, k * plant.r_a_m) if name in WITH_R_S else 0.0)
    axes.plot(rows["x_m"], rows["y_m"], color=PATH, linewidth=0.8, label="path")
    axes.plot(rows["x_m"][:1], rows["y_m"][:1], "o", color="tab:green", markersize=5, label="start")
    axes.legend(loc="lower left", fontsize=7)


def _circle(axes: Axes, radius_m: float, label: str, **style: Any) -> None:
    angle = np.linspace(0.0, math.tau, 181)
    axes.plot(radius_m * np.cos(angle), radius_m * np.sin(angle), label=label, **style)


def _scene(axes: Axes, plant: Plant, r_s: float) -> None:
    _circle(axes, plant.r_a_m, "$r_a$", color=ORBIT, linestyle="--", linewidth=1.4)
    if r_s > 0.0:
        _circle(axes, r_s, "$r_s$", color=TANGENT, linestyle=":", linewidth=1.0)
    axes.plot([0], [0], "k+", markersize=9, label="target")
    speed = math.hypot(plant.wind_x_m_s, plant.wind_y_m_s)
    if speed > 0.0:
        tip = 0.98 - 0.1 * plant.wind_x_m_s / speed, 0.12 - 0.1 * plant.wind_y_m_s / speed
        axes.annotate(
            "", xy=(0.98, 0.12), xytext=tip, xycoords="axes fraction", arrowprops={"arrowstyle": "->", "lw": 1.5}
        )
        axes.text(*tip, "wind ", transform=axes.transAxes, ha="right", va="top", fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)


def _from_inside(axes: Axes, result: StudyResult) -> None:
    """Start on the inner equilibrium itself, flown the wrong way round: r = r_i-, theta = 3 pi/2."""
    k, r_a = 1.0, Plant().r_a_m
    orbits = feasibility.inner_orbits(r_a, k * r_a)
    assert orbits is not None  # kappa is 10
    _path(axes, result.options, None, k, x_m=-orbits[0], y_m=0.0, heading_rad=1.5 * math.pi)
    if result.options.law == LAW:
        _circle(axes, orbits[0], "$r_{i-}$", color="tab:gray", linewidth=1.0)
    axes.legend(loc="lower left", fontsize=7)


def _against_gain(axes: Axes, result: StudyResult, air: str, what: str, label: str) -> None:
    k = np.array(result.options.gains_rad_m)
    for when, color, words in (("all", PATH, "whole run"), ("tail", TAIL, f"last {result.options.window:.0%}")):
        field = f"{what}_{when}"
        axes.errorbar(
            k,
            result.mean(air, field),
            result.ci95(air, field),
            color=color,
            marker="o",
            markersize=3,
            lw=1,
            label=words,
        )
    if result.options.law in WITH_R_S:
        axes.axvline(math.pi / 2, color="gray", linestyle=":", linewidth=1, label="2 k V = π")
    if what == "mse":
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("gain k [rad/m]")
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)


def _flight(law: str | None, k: float, air: str = "calm", noise_run: int = 0) -> Callable[[Axes, StudyResult], None]:
    return lambda axes, result: _path(axes, result.options, law, k, air, noise_run)


def _means(air: str, what: str) -> Callable[[Axes, StudyResult], None]:
    label: dict[str, str] = {"mse": r"mean $(r-r_a)^2$ [m²]", "rdot2": r"mean $\dot r^2$ [m²/s²]"}
    return lambda axes, result: _against_gain(axes, result, air, what, label[what])


PICTURES = (
    Picture(1, "outer_law_small_gain", "$u_o$ alone, k = 0.2", _flight(OUTER_ALONE, 0.2), OUTER_ALONE),
    Picture(
        2,
        "outer_law_large_gain",
        "$u_o$ alone, k = 1, cuts across the circle",
        _flight(OUTER_ALONE, 1.0),
        OUTER_ALONE,
    ),
    Picture(3, "law_from_outside", "u from outside, k = 1", _flight(None, 1.0)),
    Picture(
        4,
        "law_from_inside",
        r"u from $r_{i-}$, $\theta = 3\pi/2$, k = 1",
        _from_inside,
        title_of_another=r"u from 1.01 m, $\theta = 3\pi/2$, k = 1",
    ),
    Picture(5, "noisy_small_gain", "measurement error, k = 0.1", _flight(None, 0.1, noise_run=1)),
    Picture(6, "noisy_large_gain", "measurement error, k = 1", _flight(None, 1.0, noise_run=1)),
    Picture(7, "error_against_gain", "radial error, no wind", _means("calm", "mse")),
    Picture(8, "range_rate_against_gain", "range rate, no wind", _means("calm", "rdot2")),
    Picture(9, "wind_small_gain", "measurement error and wind, k = 0.1", _flight(None, 0.1, "wind")),
    Picture(10, "wind_large_gain", "measurement error and wind, k = 1", _flight(None, 1.0, "wind")),
    Picture(11, "wind_error_against_gain", "radial error in wind", _means("wind", "mse")),
    Picture(12, "wind_range_rate_against_gain", "range rate in wind", _means("wind", "rdot2")),
)
