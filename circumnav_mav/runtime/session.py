"""A whole run as a user starts it: open the links, fly, and leave figures, a picture and a record behind."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from circumnav_mav import report
from circumnav_mav.config import Config
from circumnav_mav.flight_record import TickRecord
from circumnav_mav.runtime.app import App, Options, Result
from circumnav_mav.runtime.clock import Clock, new_event_loop
from circumnav_mav.runtime.recorder import Recorder
from circumnav_mav.runtime.view import View


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run leaves: how it ended, its figures, where its files are, and what went wrong with them."""

    result: Result
    summary: report.Summary
    directory: Path | None
    picture: Path | None
    notes: list[str]


HELD_UP = 0.1
"""The share of the time that the clock of a simulation may stand still before a person is told."""


class Crash(Exception):
    """A bug ended the flight; the text says where the traceback is."""


def fly(
    config: Config,
    clock: Clock,
    view: View,
    options: Options,
    *,
    title: str,
    truth_file: Path | None = None,
    on_open: Callable[[int], None] | None = None,
    before_report: Callable[[], None] | None = None,
) -> Outcome:
    """Fly to the end. on_open gets the local port of the vehicle's link; before_report runs when the flight is over.

    Raises LinkError where a link or the signing key cannot be opened, Crash where the app itself is at fault.
    """
    recorder = Recorder(Path(config.record.directory), tlog=config.record.tlog, header=TickRecord._fields)
    app: App | None = None
    try:
        app = App(config, clock, recorder, view, options)
        app.open_links()
        if on_open is not None:
            on_open(app.vehicle_port)
        result = _run(app, recorder)
    finally:
        if app is not None:
            app.close_links()
        view.close()
        recorder.close()
        if before_report is not None:
            before_report()
    result.record_problem = recorder.problem
    return _report(config, result, recorder.directory, truth_file, title, clock)


def _run(app: App, recorder: Recorder) -> Result:
    loop = new_event_loop()
    try:
        return loop.run_until_complete(app.run())
    except Exception as error:
        # Setpoints have stopped with the loop: the autopilot's own failsafe flies now. Keep what a developer needs.
        recorder.event(0.0, "".join(traceback.format_exception(error)))
        where = f" (details: {recorder.directory}/events.log)" if recorder.directory else ""
        raise Crash(f"the app failed, and setpoints have stopped: {type(error).__name__}: {error}{where}") from error
    finally:
        loop.close()


def _report(
    config: Config, result: Result, directory: Path | None, truth_file: Path | None, title: str, clock: Clock
) -> Outcome:
    notes = [result.record_problem] if result.record_problem else []
    ticks: dict[str, list[str]] = {}
    if directory is not None and (directory / "ticks.csv").exists():
        ticks = report.read_columns(directory / "ticks.csv")
    truth = report.read_columns(truth_file) if truth_file is not None and truth_file.exists() else None
    if held := held_note(clock.held_s, result.duration_s, clock.speed):
        notes.append(held)
    summary = report.summarise(config, result, ticks, truth)
    picture = None
    if directory is not None and ticks.get("t_s"):
        try:
            picture = directory / "flight.png"
            report.draw(picture, config, ticks, truth, title)
        except ImportError:
            picture = None
            notes.append("no picture: it needs matplotlib (pip install 'circumnav-mav[plot]')")
        except OSError as error:
            picture = None
            notes.append(f"no picture: {error.strerror or error}")
    return Outcome(result, summary, directory, picture, notes)


def held_note(held_s: float, duration_s: float, speed: float) -> str:
    """Return a note where a simulation's clock stood still for held_s of wall time; empty where it hardly did."""
    share = held_s / (held_s + duration_s / speed) if held_s > 0.0 else 0.0
    if share < HELD_UP:
        return ""
    stood = f"the clock stood still for {100.0 * share:.0f} % of the time"
    return f"this machine does not keep up with {speed:g} x real time: {stood}"
