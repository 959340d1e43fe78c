"""What `circumnav tune` hands over: a configuration that `fly` takes as it is, a Pareto plot, and the gain in words."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import yaml
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.study.aircraft import Aircraft, Gains
from circumnav_mav.study.tune import Score, Tuned, most_effort, pareto
from circumnav_mav.study.tune_spaces import MEANINGS
from circumnav_mav.yaml_line import with_value


def section(kind: str, name: str, options: Mapping[str, float]) -> str:
    """Return a section of the file with a comment on every line that has a known meaning."""
    rows = [f"{kind}:", f"  name: {name}"]
    for option, value in options.items():
        note = f"  # {MEANINGS[option]}" if option in MEANINGS else ""
        rows.append(f"  {f'{option}: {value:g}':<28}{note}".rstrip())
    return "\n".join(rows) + "\n"


def replaced(text: str, kind: str, name: str, options: Mapping[str, float]) -> str:
    """Return a configuration with one top-level section replaced, or added at its end; the rest stays as it is.

    Comments inside the old section go with it, for they speak of the old gains. Raises ValueError, in words, where
    the form of the file (an alias for the section, say) does not let that be done safely.
    """
    text = text.removeprefix(BYTE_ORDER_MARK)
    try:
        new = _replaced(text, kind, name, options)
        whole, got = yaml.safe_load(text) or {}, yaml.safe_load(new)
    except yaml.YAMLError as error:
        raise ValueError(_BY_HAND.format(kind)) from error
    # Values as the new section's own text gives them.
    if got != {**whole, **yaml.safe_load(section(kind, name, options))}:
        raise ValueError(_BY_HAND.format(kind))
    return new


BYTE_ORDER_MARK = "\ufeff"
"""May stand nowhere but first, and a heading is put there."""

_BY_HAND = "the form of the file is too intricate to put gains into (an anchor or alias?): write {} out plainly in it"


def _replaced(text: str, kind: str, name: str, options: Mapping[str, float]) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    block = section(kind, name, options)
    if not isinstance(root, yaml.MappingNode):
        return f"{text.rstrip()}\n\n{block}" if text.strip() else block
    found = next(((key, value) for key, value in root.value if key.value == kind), None)
    if root.flow_style:
        pairs = ", ".join(f"{option}: {value:g}" for option, value in options.items())
        flow = f"{kind}: {{name: {name}{', ' if pairs else ''}{pairs}}}"
        if found is None:
            at = root.start_mark.index + 1
            return f"{text[:at]}{flow}{', ' if root.value else ''}{text[at:]}"
        return text[: found[0].start_mark.index] + flow + text[_end(*found) :]
    block = block.replace("\n", "\n" + " " * root.start_mark.column).rstrip()
    if found is None:
        before, after = text[: root.end_mark.index].rstrip(), text[root.end_mark.index :]
        return f"{before}\n\n{' ' * root.start_mark.column}{block}\n{after}"
    _, _, after = text[_end(*found) :].partition("\n")
    return f"{text[: found[0].start_mark.index]}{block}\n{after}"


def _end(key: yaml.Node, value: yaml.Node) -> int:
    """Return where the text of a key and its value ends; PyYAML has a block end where the next thing begins."""
    if isinstance(value, yaml.MappingNode) and value.value and not value.flow_style:
        return _end(*value.value[-1])
    return max(int(key.end_mark.index), int(value.end_mark.index))


TUNED_FOR = (
    ("ranging", "sigma_m", "sigma_r_m"),
    ("study", "wind_m_s", "wind_m_s"),
    ("study", "range_rate_hz", "range_rate_hz"),
    ("study", "turn_lag_s", "lag_s"),
)
"""Section and key of the file, and attribute of the aircraft, of what the command line or a record may say instead."""


def configured(original: str, gains: Gains | None, aircraft: Aircraft) -> str:
    """Return the configuration with these gains (None: its own), and with what it does not say of their aircraft.

    Raises ValueError, in one line, where it would not load.
    """
    text = original.removeprefix(BYTE_ORDER_MARK)
    if gains is not None:
        text = replaced(text, "law", gains.law, gains.law_options)
        text = replaced(text, "estimator", gains.estimator, gains.estimator_options)
    try:
        said = Aircraft.of(parse(text, "the configuration with its gains"))
        for section_name, key, name in TUNED_FOR:
            if getattr(said, name) != getattr(aircraft, name):
                text = with_value(text, section_name, key, repr(getattr(aircraft, name)))
        parse(text, "the configuration with its gains")
    except ConfigError as error:
        raise ValueError(next(error.lines())) from error
    return text


def yaml_text(original: str, tuned: Tuned, seed: int) -> str:
    """Return the configuration with the gains to fly, and a heading that says what they were tuned for."""
    a, how = tuned.aircraft, "found" if tuned.won else "not bettered"
    text = configured(original, tuned.best if tuned.won else None, a)
    heading = (
        f"# Gains {how} by `circumnav tune` (seed {seed}) for {a.V_m_s:g} m/s on {a.r_a_m:g} m: turn rate up to "
        f"{a.turn_rate_limit_rad_s:.3g} rad/s with {a.lag_s:.3g} s of lag,\n"
        f"# range noise {a.sigma_r_m:.3g} m at {a.range_rate_hz:.3g} Hz, wind up to {a.wind_m_s:.3g} m/s.\n"
        f"# On {tuned.fresh_runs} fresh runs each in calm, in half the wind with the speed believed 5 % high, and in "
        "all of the wind:\n"
    )
    return heading + "".join(f"#   {line}\n" for line in lines(tuned)) + "\n" + text


def lines(tuned: Tuned) -> Iterator[str]:
    """Yield what the tuning gained, on fresh noise."""
    before, after = tuned.before, tuned.after
    yield f"before  {_told(tuned.present, before)}"
    if tuned.best == tuned.present:
        yield "the present gains are the best that were found, and stay"
        return
    yield f"{'after ' if tuned.won else 'found '}  {_told(tuned.best, after)}"
    if not tuned.won:
        yield "what was found loses to the present gains on these runs: the present gains stay"
        return
    yield (
        f"the worst error is {_times(after.rms_worst_m / before.rms_worst_m)}, that in calm "
        f"{_times(after.rms_calm_m / before.rms_calm_m)}, at {after.effort / before.effort - 1.0:+.1%} of effort"
    )


def _times(ratio: float) -> str:
    """Return a ratio of errors, after over before, in words."""
    if f"{ratio:.3g}" == "1":
        return "as it was"
    return f"{1.0 / ratio:.3g} times smaller" if ratio < 1.0 else f"{ratio:.3g} times larger"


def _told(gains: Gains, score: Score) -> str:
    return (
        f"{gains.pair}: rms {score.rms_worst_m:.3g} m at worst, {score.rms_calm_m:.3g} m in calm, "
        f"effort {score.effort:.3g}, settled after {score.settle_s:.0f} s, {score.lost:.1%} lost"
    )


COLUMNS = ("effort", "rms calm m", "rms worst m", "settled s", "lost", "gains")
SHOWN = 12


def table(tuned: Tuned) -> list[list[str]]:
    """Return what else could be flown as text, a header row first: what the preference likes of the Pareto set."""
    rows, limit = [list(COLUMNS)], most_effort(tuned.flown)
    liked = sorted(pareto(tuned.flown), key=lambda one: one[1].value(limit))[:SHOWN]
    for gains, score in sorted(liked, key=lambda one: one[1].effort):
        options = {**gains.law_options, **gains.estimator_options}
        what = f"{gains.pair}: " + ", ".join(f"{name} {value:g}" for name, value in options.items())
        figures = (score.effort, score.rms_calm_m, score.rms_worst_m, score.settle_s)
        rows.append([*(f"{figure:.3g}" for figure in figures), f"{score.lost:.1%}", what])
    return rows


def to_json(tuned: Tuned, seed: int) -> str:
    """Return the aircraft, the present and the best gains on fresh noise, and the Pareto set of the search."""

    def told(gains: Gains, score: Score) -> dict[str, object]:
        law = {"name": gains.law, **gains.law_options}
        return {"law": law, "estimator": {"name": gains.estimator, **gains.estimator_options}, **score._asdict()}

    about = {name: getattr(tuned.aircraft, name) for name in tuned.aircraft.__slots__}
    return json.dumps(
        {
            "seed": seed,
            "aircraft": about,
            "fresh_runs": tuned.fresh_runs,
            "before": told(tuned.present, tuned.before),
            "after": told(tuned.best, tuned.after),
            "written": "after" if tuned.won else "before",
            "pareto": [told(*one) for one in pareto(tuned.flown)],
        },
        indent=1,
    )


Axis = tuple[str, Callable[[Score], float]]

CALM: Axis = ("rms error in calm air [m]", lambda score: score.rms_calm_m)
WORST: Axis = ("rms error in the worst situation [m]", lambda score: score.rms_worst_m)
EFFORT: Axis = ("effort: mean u² over (V / r_a)²", lambda score: score.effort)
SETTLED: Axis = ("time to settle [s]", lambda score: score.settle_s)

PANELS: tuple[tuple[Axis, Axis], ...] = ((EFFORT, WORST), (SETTLED, WORST), (EFFORT, CALM))
"""What is drawn against what: the four objectives, each at least once."""


def draw(tuned: Tuned, file: Path) -> None:
    """Write the Pareto plot: every candidate that was flown, the set that none beats, and the present gains."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    front = [score for _, score in pareto(tuned.flown)]
    pairs = list(dict.fromkeys(gains.pair for gains, _ in tuned.flown))
    panels = figure.subplots(1, len(PANELS))
    for axes, ((x_label, x), (y_label, y)) in zip(panels, PANELS, strict=True):
        for pair, colour in zip(pairs, ("tab:blue", "tab:orange"), strict=False):
            kept = [score for gains, score in tuned.flown if gains.pair == pair]
            axes.plot([x(s) for s in kept], [y(s) for s in kept], "o", color=colour, ms=3, alpha=0.4, label=pair)
        axes.plot([x(s) for s in front], [y(s) for s in front], "ko", ms=5, mfc="none", label="Pareto set of all four")
        for label, score, marker in (
            ("present", tuned.before, "rs"),
            ("tuned" if tuned.won else "found", tuned.after, "g*"),
        ):
            axes.plot([x(score)], [y(score)], marker, ms=9, label=f"{label}, on fresh noise")
        axes.set(xscale="log", yscale="log", xlabel=x_label, ylabel=y_label)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if high > 4.0 * low else MaxNLocator(6))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    panels[-1].legend(fontsize=7)
    figure.suptitle(
        f"{len(tuned.flown)} candidates for {tuned.aircraft.V_m_s:g} m/s on {tuned.aircraft.r_a_m:g} m", fontsize=10
    )
    figure.savefig(file, dpi=110)
