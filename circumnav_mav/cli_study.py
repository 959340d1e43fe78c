"""The offline commands: study, compare, tune. Their libraries are imported when they run, not when one flies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from circumnav_mav.writable import refusal, refusal_of_folder, takes_once, write_anew

Seed = Annotated[int, typer.Option(help="of every random draw", min=0, max=2**63 - 1)]
JsonFile = Annotated[Path | None, typer.Option("--json", help="write the figures to this file")]
Workers = Annotated[int | None, typer.Option(help="threads; default one a core", min=1)]
Scheduler = Annotated[str | None, typer.Option(help="a Dask scheduler, tcp://HOST:PORT, instead of threads")]
Several = list[str] | None
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130


def study(
    context: typer.Context,
    json: JsonFile = None,
    runs: Annotated[int, typer.Option(help="trajectories for each gain and wind", min=2)] = 500,
    seed: Seed = 1,
    start: Annotated[str, typer.Option(help="first place of every run, X,Y in metres")] = "-20,0",
    window: Annotated[
        float, typer.Option(help="share of the run, at its end, that counts as its tail", min=0.01, max=1)
    ] = 0.5,
    gains: Annotated[
        str | None, typer.Option(help="gains k in rad/m, such as 0.2,0.5,1; default the paper's 20")
    ] = None,
    law: Annotated[str, typer.Option(help="a law with a gain: the paper's, or one to set beside it")] = "hashemi2013",
    estimator: Annotated[
        str | None, typer.Option(help="fly on this estimator; default none: true range, noisy range rate, as the paper")
    ] = None,
    figures: Annotated[Path | None, typer.Option(help="draw the twelve figures into this folder (PNG and SVG)")] = None,
    save: Annotated[Path | None, typer.Option(help="keep every run's statistics in this file (.npz)")] = None,
    load: Annotated[Path | None, typer.Option(help="show what --save kept instead of flying")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Reproduce the paper's simulations: mean squares against the gain, calm and in wind, with confidence intervals."""
    if load is not None:
        _nothing_but_kept(context)
    before_the_work([json, save], figures)
    with _extras(), _in_words():
        from circumnav_mav import bar
        from circumnav_mav.study import paper, paper_figures
        from circumnav_mav.study.scheduler import executor

        if load is not None:
            result = paper.load(load)
        else:
            options = paper.Options(
                runs=runs,
                seed=seed,
                start_m=_pair(start),
                window=window,
                gains_rad_m=paper.GAINS if gains is None else _numbers("--gains", gains),
                workers=workers,
                law=law,
                estimator=estimator,
            )
            with executor(scheduler) as pool, bar.shown("flying") as tell:
                result = paper.run(options, tell, pool)
        typer.echo(f"{result.steps} trajectory-steps in {result.elapsed_s:.2f} s: {result.rate_hz:.3g} a second")
        for air in paper.AIRS:
            typer.echo(f"\n{air}: {result.options.flown()}, {result.options.runs} runs for each gain")
            _print_table(result.table(air))
        if save is not None:
            paper.save(result, save)
            typer.echo(f"\nkept       {save}")
        if figures is not None:
            with bar.shown("drawing") as tell:
                files = paper_figures.draw(result, figures, tell)
            typer.echo(f"\n{len(files)} figures in {figures}/")
        if json is not None:
            paper.write_json(result, json)


def _each_once(names: list[str]) -> list[str]:
    """Return the names in order, one given twice once: it would be flown twice for the same row."""
    return list(dict.fromkeys(names))


def compare(
    scenario: Annotated[Several, typer.Option(help="by name; may be given again (default: all)")] = None,
    law: Annotated[Several, typer.Option(help="by name; may be given again (default: our best)")] = None,
    estimator: Annotated[Several, typer.Option(help="by name; may be given again (default: our best)")] = None,
    everything: Annotated[bool, typer.Option("--all", help="every law on every estimator it can fly on")] = False,
    runs: Annotated[int, typer.Option(help="flights a row", min=1, max=1_000_000)] = 1000,
    seed: Seed = 1,
    json: JsonFile = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Fly laws and estimators over the named scenarios, many seeds each, and print a row for each."""
    before_the_work([json])
    with _extras(), _in_words():
        from circumnav_mav import bar
        from circumnav_mav.guidance.estimators import ESTIMATORS
        from circumnav_mav.guidance.laws import LAWS
        from circumnav_mav.study import compare as study_compare
        from circumnav_mav.study.scenarios import SCENARIOS
        from circumnav_mav.study.scheduler import executor

        best_law, best_estimator = study_compare.BEST
        laws = _each_once(law or (list(LAWS) if everything else [best_law]))
        estimators = _each_once(estimator or (list(ESTIMATORS) if everything else [best_estimator]))
        for line in [] if everything else study_compare.left_out(laws, estimators):
            typer.echo(line, err=True)
        rows: list[study_compare.Row] = []
        with executor(scheduler) as pool, bar.shown("flying") as above:

            def keep(row: study_compare.Row) -> None:
                rows.append(row)
                if json is not None and not takes_once(json):
                    write_anew(json, study_compare.to_json(rows))
                if len(rows) == 1:
                    above.echo(study_compare.header())
                above.echo(study_compare.line(row))

            try:
                study_compare.compare(
                    _each_once(scenario or list(SCENARIOS)),
                    laws,
                    estimators,
                    runs,
                    seed,
                    lambda title, done, whole: above(done, whole),
                    workers,
                    pool,
                    keep,
                )
            finally:
                if json is not None and rows and takes_once(json):
                    json.write_text(study_compare.to_json(rows), encoding="utf-8")


def tune(
    config: Annotated[Path, typer.Argument(help="configuration of the aircraft", show_default=False)],
    out: Annotated[Path, typer.Option(help="write the configuration with the gains found here")] = Path("tuned.yaml"),
    wind: Annotated[
        float | None,
        typer.Option(
            help="strongest wind [m/s], up to 0.8 of the speed; default study.wind_m_s, or else a fifth", min=0
        ),
    ] = None,
    range_rate: Annotated[
        float | None, typer.Option(help="ranges a second; default study.range_rate_hz", min=0.1)
    ] = None,
    from_log: Annotated[
        Path | None, typer.Option(help="read noise, lag and wind out of this flight's directory")
    ] = None,
    evaluations: Annotated[int, typer.Option(help="candidates flown for each pair", min=4)] = 96,
    keep: Annotated[bool, typer.Option("--keep-pair", help="keep law and estimator, tune their gains only")] = False,
    seed: Seed = 1,
    plot: Annotated[
        Path | None, typer.Option(help="draw the Pareto set to this PNG; default beside --out", show_default=False)
    ] = None,
    no_plot: Annotated[bool, typer.Option("--no-plot", help="draw nothing")] = False,
    json: Annotated[Path | None, typer.Option("--json", help="write the Pareto set and the verdict here")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Find gains for your aircraft by flying it in simulation; write a configuration that `fly` takes as it is."""
    plot = None if no_plot else plot or out.with_suffix(".png")
    before_the_work([out, plot, json])
    with _extras(), _in_words():
        from circumnav_mav import bar
        from circumnav_mav.config_file import load
        from circumnav_mav.study import tune as search
        from circumnav_mav.study import tune_report
        from circumnav_mav.study.aircraft import Aircraft, gains_of
        from circumnav_mav.study.from_log import look
        from circumnav_mav.study.scheduler import executor

        settings = load(config)
        aircraft = Aircraft.of(settings, wind, range_rate)
        if from_log is not None:
            seen = look(from_log)
            aircraft = aircraft.as_seen(seen)
            typer.echo(f"from the log: {seen}")
        original = config.read_text(encoding="utf-8")
        tune_report.configured(original, gains_of(settings, aircraft), aircraft)  # what cannot be written: refused now
        with executor(scheduler) as pool, bar.shown("searching") as tell:
            tuned = search.tune(
                settings,
                aircraft,
                seed=seed,
                evaluations=evaluations,
                keep_pair=keep,
                workers=workers,
                executor=pool,
                progress=tell,
            )
        rows, whole = tune_report.table(tuned), len(search.pareto(tuned.flown))
        typer.echo(
            f"{len(rows) - 1} of {whole} that none beats in effort, both errors and settling, as the search saw:"
        )
        _print_table(rows, left=1)
        typer.echo(f"\non {tuned.fresh_runs} fresh runs in each of three situations:")
        for line in tune_report.lines(tuned):
            typer.echo(line)
        out.write_text(tune_report.yaml_text(original, tuned, seed), encoding="utf-8")
        typer.echo(f"written    {out}")
        if json is not None:
            json.write_text(tune_report.to_json(tuned, seed), encoding="utf-8")
        if plot is not None:
            tune_report.draw(tuned, plot)
            typer.echo(f"picture    {plot}")


def register(app: typer.Typer) -> None:
    """Add the offline commands to the command line."""
    for command in (study, compare, tune):
        app.command()(command)


def before_the_work(files: list[Path | None], folder: Path | None = None) -> None:
    """Leave with one line where something could not be written in the end."""
    for trouble in (*map(refusal, files), refusal_of_folder(folder)):
        if trouble:
            _fail(trouble)


@contextmanager
def _extras() -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        _fail(f"this command needs {error.name or error}: pip install 'circumnav-mav[study]'")


@contextmanager
def _in_words() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        _fail("interrupted", EXIT_INTERRUPTED)
    except BrokenPipeError:
        raise  # who reads has had enough: `circumnav study | head`
    except OSError as error:
        _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))


def _nothing_but_kept(context: typer.Context) -> None:
    """Leave with one line where --load stands beside options of a flight that it would pass over."""
    given = [
        f"--{name}"
        for name in context.params
        if name not in ("json", "figures", "save", "load")
        and (source := context.get_parameter_source(name)) is not None
        and source.name != "DEFAULT"
    ]
    if given:
        _fail(f"--load shows runs as they were kept: leave out {', '.join(given)}, or leave out --load to fly anew")


def _fail(text: str, code: int = EXIT_USAGE) -> NoReturn:
    typer.echo(f"circumnav: {text}", err=True)
    raise typer.Exit(code)


def _pair(text: str) -> tuple[float, float]:
    numbers = _numbers("--start", text)
    if len(numbers) != 2:
        raise ValueError(f"--start wants two numbers such as -20,0, not '{text}'")
    return numbers[0], numbers[1]


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{option} wants numbers with commas between them, not '{text}'") from None
    if not all(map(isfinite, numbers)):
        raise ValueError(f"{option} wants finite numbers, not '{text}'")
    return numbers


def _print_table(rows: list[list[str]], left: int = 0) -> None:
    """Print columns, figures to the right; the last `left` ones are words, to the left."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    words = len(widths) - left
    for row in rows:
        cells = [
            cell.rjust(width) if n < words else cell for n, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        typer.echo("  ".join(cells))
