"""What `circumnav tune` hands over: a configuration that `fly` takes as it is, a Pareto plot, and the gain in words."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from circumnav_mav.study.tune import Gains, Score, Tuned, pareto

MEANINGS: Mapping[str, str] = {
    "kappa": "gain x radius, at least 1; larger is tighter and busier",
    "reach_s": "the course bends towards the circle within speed x reach_s of it",
    "gain_per_s": "how fast a heading error is turned away",
    "accel_m_s2": "how fast the range rate is believed to change",
    "drift_share": "unknown motion along the line of sight, as a share of the speed",
    "turn_share": "unknown turning, as a share of the orbit's own",
    "wander_share": "unknown motion of the position, as a share of the speed",
    "gust_share": "how fast wind and target are believed to change",
}


def section(kind: str, name: str, options: Mapping[str, float]) -> str:
    """Return a section of the file with a comment on every line that has a known meaning."""
    rows = [f"{kind}:", f"  name: {name}"]
    for option, value in options.items():
        note = f"  # {MEANINGS[option]}" if option in MEANINGS else ""
        rows.append(f"  {f'{option}: {value:g}':<28}{note}".rstrip())
    return "\n".join(rows) + "\n"


def replaced(text: str, kind: str, block: str) -> str:
    """Return a configuration with one top-level section replaced, or added at its end; the rest stays as it is."""
    found = re.search(rf"^{kind}:.*\n?(?:[ \t].*\n?|[ \t]*\n|[}}\]].*\n?)*", text, re.MULTILINE)
    if found is None:
        return f"{text.rstrip()}\n\n{block}" if text.strip() else block
    old = found.group()
    gap = "\n" * (len(old) - len(old.rstrip("\n")) - 1)
    return text[: found.start()] + block + gap + text[found.end() :]


def yaml_text(original: str, tuned: Tuned, seed: int) -> str:
    """Return the configuration with the best gains, and a heading that says what they were tuned for."""
    a, best = tuned.aircraft, tuned.best
    text = replaced(original, "law", section("law", best.law, best.law_options))
    text = replaced(text, "estimator", section("estimator", best.estimator, best.estimator_options))
    heading = (
        f"# Gains found by `circumnav tune` (seed {seed}) for {a.V_m_s:g} m/s on {a.r_a_m:g} m: turn rate up to "
        f"{a.turn_rate_limit_rad_s:.3g} rad/s with {a.lag_s:.3g} s of lag,\n"
        f"# range noise {a.sigma_r_m:.3g} m at {a.range_rate_hz:.3g} Hz, wind up to {a.wind_m_s:.3g} m/s.\n"
        f"# On {tuned.fresh_runs} fresh runs each in calm, in half the wind with the speed believed 5 % high, and in "
        "all of the wind:\n"
    )
    return heading + "".join(f"#   {line}\n" for line in lines(tuned)) + "\n" + text


def lines(tuned: Tuned) -> Iterator[str]:
    """Yield what the tuning gained, on fresh noise."""
    yield f"before  {_told(tuned.present, tuned.before)}"
    yield f"after   {_told(tuned.best, tuned.after)}"
    if tuned.best == tuned.present:
        yield "the present gains are the best that were found"
        return
    ratio = tuned.before.rms_worst_m / tuned.after.rms_worst_m
    effort = tuned.after.effort / tuned.before.effort - 1.0
    yield f"the worst error is {ratio:.3g} times smaller, at {effort:+.1%} of effort"


def _told(gains: Gains, score: Score) -> str:
    return (
        f"{gains.pair}: rms {score.rms_worst_m:.3g} m at worst, {score.rms_calm_m:.3g} m in calm, "
        f"effort {score.effort:.3g}, settled after {score.settle_s:.0f} s, {score.lost:.1%} lost"
    )


def draw(tuned: Tuned, file: Path) -> None:
    """Write the Pareto plot: every candidate that was flown, the front, and where the present gains stand."""
    figure = Figure(figsize=(6.4, 4.6))
    axes = figure.add_axes((0.12, 0.12, 0.85, 0.8))
    for pair in dict.fromkeys(gains.pair for gains, _ in tuned.flown):
        kept = [score for gains, score in tuned.flown if gains.pair == pair]
        axes.plot([s.effort for s in kept], [s.rms_worst_m for s in kept], "o", ms=3, alpha=0.5, label=pair)
    front = pareto(tuned.flown)
    axes.plot([s.effort for _, s in front], [s.rms_worst_m for _, s in front], "k-", lw=1, label="Pareto front")
    for label, score, marker in (("present", tuned.before, "rs"), ("tuned", tuned.after, "g*")):
        axes.plot([score.effort], [score.rms_worst_m], marker, ms=9, label=f"{label}, on fresh noise")
    axes.set(
        xscale="log", yscale="log", xlabel="mean u² over (V / r_a)²", ylabel="rms error in the worst situation [m]"
    )
    axes.set_title(f"{len(tuned.flown)} candidates for {tuned.aircraft.V_m_s:g} m/s on {tuned.aircraft.r_a_m:g} m")
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(ScalarFormatter())
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7)
    figure.savefig(file, dpi=120)
