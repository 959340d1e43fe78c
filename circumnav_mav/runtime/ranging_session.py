"""A run of `circumnav ranging` as a user starts it: listen, sum up, and with a known distance measure the bias."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from pathlib import Path

from circumnav_mav.config import Config
from circumnav_mav.ranging import replay
from circumnav_mav.ranging.calibrate import Calibration, calibrate
from circumnav_mav.runtime.clock import Clock, new_event_loop
from circumnav_mav.runtime.config_file import why_not, write_value
from circumnav_mav.runtime.ranging_app import RangingApp, summary
from circumnav_mav.runtime.ranging_view import RangingView
from circumnav_mav.types import RangeSample

CALIBRATE_S = 30.0


def run_ranging(
    config: Config,
    file: Path,
    view: RangingView,
    say: Callable[[str], None],
    *,
    duration_s: float | None,
    distance_m: float | None,
    record: Path | None,
) -> str:
    """Listen and say what came; `record`: keep the ranges there, as the source replay reads them.

    With `distance_m` [m], write the bias that is found into the configuration, `file`. Return what went wrong, or "".
    Raises LinkError where the link cannot be opened.
    """
    if distance_m is not None and (reason := why_not(file, "ranging", "bias_m")):
        view.close()
        return f"cannot write ranging.bias_m to {file}: {reason}"
    clock = Clock()
    if duration_s is None:
        duration_s = CALIBRATE_S if distance_m is not None else inf
    loop = new_event_loop()
    try:
        app = RangingApp(config, clock, view, duration_s)
        status = loop.run_until_complete(app.run())
    finally:
        view.close()
        loop.close()
    for line in summary(status, clock.now(), app.hint(), app.heard()):
        say(line)
    if record is not None and (problem := _record(app.samples, record, say)):
        return problem
    if not status.accepted:
        return "no range could be used" + (f": nothing is written to {file}" if distance_m is not None else "")
    if distance_m is None:
        return ""
    found = calibrate(
        [sample.range_m for sample in app.samples],
        distance_m,
        resolution_m=app.feed.source.resolution_m,
        current_bias_m=config.ranging.bias_m,
    )
    say(f"calibrated {found.verdict()}")
    return _write(found, file, say)


def _record(samples: list[RangeSample], path: Path, say: Callable[[str], None]) -> str:
    lines = [replay.HEADER, *(replay.row(sample) for sample in samples)]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        return f"cannot write {path}: {error.strerror or error}"
    say(f"recorded   {len(samples)} ranges in {path}")
    return ""


def _write(found: Calibration, file: Path, say: Callable[[str], None]) -> str:
    if not found.ok:
        return f"the bias is not written to {file}: {'; '.join(found.problems)}"
    value = f"{found.bias_m + 0.0:.3f}".replace("-0.000", "0.000")
    try:
        write_value(file, "ranging", "bias_m", value)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        return f"cannot write ranging.bias_m: {value} to {file}: {reason}"
    say(f"written    ranging.bias_m: {value} in {file}")
    return ""
