"""The `circumnav` command.

Exit codes: 0 done as asked; 1 the flight ended another way (released, range lost, refused, nothing heard, hung), or
`check` found what stops one; 2 bad configuration or usage; 3 a link cannot be opened; 4 `check --live` found warnings
only; 70 a fault of the app itself.
"""

from __future__ import annotations

import os
import sys
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from circumnav_mav import __version__, cli_study
from circumnav_mav.cli_study import before_the_work
from circumnav_mav.config import Config
from circumnav_mav.config_file import ConfigError, load
from circumnav_mav.runtime.app import Options
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.runtime.demo import demo_config, demo_note, demo_speed, run_demo
from circumnav_mav.runtime.session import Crash, Outcome, fly
from circumnav_mav.runtime.systemd import as_a_service
from circumnav_mav.runtime.transport import LinkError
from circumnav_mav.runtime.view import open_view

EXIT_FLIGHT, EXIT_USAGE, EXIT_LINK, EXIT_WARNINGS, EXIT_CRASH = 1, 2, 3, 4, 70
DONE = ("completed",)

app = typer.Typer(
    help="Circle a target whose place nobody knows, from range alone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ConfigPath = Annotated[Path, typer.Argument(help="configuration file, see configs/", show_default=False)]
JsonPath = Annotated[Path | None, typer.Option("--json", help="write the figures of the flight to this file")]
Duration = Annotated[
    float | None, typer.Option(help="end politely (Hold, then silence) after so many flight seconds", min=0.1)
]


def _version(value: bool) -> None:
    if value:
        typer.echo(f"circumnav_mav {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="show the version")
    ] = False,
) -> None:
    """Circle a target whose place nobody knows, from range alone."""


@app.command()
def demo(
    config: Annotated[Path | None, typer.Option(help="fly this configuration instead of the defaults")] = None,
    json: JsonPath = None,
    speed: Annotated[
        float | None,
        typer.Option(help="flight seconds a wall second; 1 to watch; left out: 5, through MAVSDK 1", min=0.1, max=50),
    ] = None,
    seed: Annotated[int, typer.Option(help="of every random draw: beacon bearing, noise", min=0)] = 1,
    duration: Duration = None,
    stub_arg: Annotated[
        list[str] | None, typer.Option(help="hand this on to the stub, e.g. --stub-arg=--wind=2,0")
    ] = None,
) -> None:
    """Watch a vehicle find and circle a beacon: app and vehicle stub as two processes, MAVLink over loopback."""
    given = load(config) if config else None
    settings = demo_config(given)
    before_the_work([json])
    speed = demo_speed(settings) if speed is None else speed
    outcome = run_demo(settings, speed=speed, seed=seed, duration_s=duration, stub_args=stub_arg or [])
    if note := demo_note(given):
        outcome.notes.append(note)
    _finish(outcome, json)


@app.command(name="fly")
def fly_command(
    config: ConfigPath,
    json: JsonPath = None,
    duration: Duration = None,
    wait: Annotated[
        float,
        typer.Option(
            help="give up if autopilot or range is not heard by then [s] (fit to fly: three times that); 0: never",
            min=0,
        ),
    ] = 60.0,
) -> None:
    """Fly a real autopilot (or a simulator) with a configuration."""
    settings = load(config)
    if settings.engage == "auto" and as_a_service(os.environ):
        _complain(f"{config}: engage: auto is not for a service, which would take off again after a restart: pilot")
        raise typer.Exit(EXIT_USAGE)
    before_the_work([json])
    options = Options(duration_s=inf if duration is None else duration, wait_s=wait or inf)
    title = f"circumnav fly  {config.name}  {settings.vehicle.link}"
    outcome = fly(settings, Clock(), open_view(title), options, title=f"circumnav fly: {config.name}")
    _finish(outcome, json)


@app.command()
def check(
    config: ConfigPath,
    live: Annotated[
        bool, typer.Option("--live", help="also listen to the vehicle and the radio: what would stop a flight")
    ] = False,
    seconds: Annotated[float, typer.Option(help="listen for so long, with --live", min=5.0)] = 10.0,
) -> None:
    """Check a configuration: every fault at once, and what follows from it for the flight. Moves nothing.

    Exit code 1: it will not hold the orbit. With --live also 4 for warnings, 1 for errors that stop a flight.
    """
    from circumnav_mav.check import consequences, findings, holds
    from circumnav_mav.runtime.named_files import LOOKS

    settings = load(config, LOOKS)
    found = findings(settings)
    for line in consequences(settings, found):
        typer.echo(line)
    code = _check_live(settings, seconds) if live else 0
    if not holds(found):
        code = EXIT_FLIGHT
    if code:
        raise typer.Exit(code)


def _check_live(settings: Config, seconds: float) -> int:
    from circumnav_mav.runtime.live_check import listen, table
    from circumnav_mav.settings_check import Severity

    typer.echo(f"listening on {settings.vehicle.link} for {seconds:g} s")
    findings = listen(settings, seconds)
    for line in table(findings):
        typer.echo(line)
    worst = max(finding.severity for finding in findings)
    return {Severity.OK: 0, Severity.WARNING: EXIT_WARNINGS, Severity.ERROR: EXIT_FLIGHT}[worst]


@app.command()
def ranging(
    config: ConfigPath,
    duration: Annotated[float | None, typer.Option(help="stop after so many seconds", min=0.1)] = None,
    calibrate: Annotated[
        float | None,
        typer.Option(help="true distance to the beacon [m]: measure the bias, and write it into the file", min=0.1),
    ] = None,
    record: Annotated[Path | None, typer.Option(help="keep the ranges in this file, for the source replay")] = None,
) -> None:
    """Show live what the ranging sensor says: ranges, rejections by reason, rate, age, jitter. Moves nothing."""
    from circumnav_mav.runtime.ranging_session import run_ranging
    from circumnav_mav.runtime.ranging_view import open_ranging_view

    settings = load(config)
    before_the_work([record], config.resolve().parent if calibrate is not None else None)
    view = open_ranging_view(f"circumnav ranging  {settings.ranging.source}")
    problem = run_ranging(settings, config, view, typer.echo, duration_s=duration, distance_m=calibrate, record=record)
    if problem:
        _complain(problem)
        raise typer.Exit(EXIT_FLIGHT)


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []})
def stub(context: typer.Context) -> None:
    """Run the vehicle stub alone; `circumnav stub --help` lists its options."""
    os.execv(sys.executable, [sys.executable, "-m", "sitl_stub", *context.args])  # a kill must reach it


cli_study.register(app)


def _finish(outcome: Outcome, json: Path | None) -> None:
    """Print and write the figures; leave with the exit code: the flight's, where that is not 0."""
    from circumnav_mav.report import lines

    for line in lines(outcome.summary):
        typer.echo(line)
    if outcome.directory is not None:
        typer.echo(f"record     {outcome.directory}/")
    if outcome.picture is not None:
        typer.echo(f"picture    {outcome.picture}")
    for note in outcome.notes:
        typer.echo(f"note       {note}", err=True)
    code = 0
    if json is not None:
        try:
            outcome.summary.write(json)
        except OSError as error:
            _complain(f"cannot write {json}: {error.strerror or error}")
            code = EXIT_USAGE
    if outcome.result.outcome not in DONE:
        _complain(f"{outcome.result.outcome}: {outcome.result.text}")
        code = EXIT_FLIGHT
    if code:
        raise typer.Exit(code)


def _complain(text: str) -> None:
    typer.echo(f"circumnav: {text}", err=True)


def main() -> None:
    """Run the command line; every known fault is one line and an exit code."""
    try:
        app()
    except ConfigError as error:
        for line in error.lines():
            _complain(line)
        sys.exit(EXIT_USAGE)
    except LinkError as error:
        _complain(str(error))
        sys.exit(EXIT_LINK)
    except Crash as error:
        _complain(str(error))
        sys.exit(EXIT_CRASH)


if __name__ == "__main__":
    main()
