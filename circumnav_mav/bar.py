"""The progress bar of the offline commands, and lines that are printed while it is shown."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import typer
from rich.console import Console
from rich.progress import Progress


class Bar:
    """A progress bar on standard error; called with (done, of how many)."""

    def __init__(self, title: str) -> None:
        console = Console(stderr=True)
        self._shown = console.is_terminal
        # what is printed stays on standard output: rich would lead it to the console of the bar
        self.progress = Progress(console=console, transient=True, disable=not self._shown, redirect_stdout=False)
        self._task = self.progress.add_task(title, total=None)

    def __call__(self, done: int, whole: int) -> None:
        self.progress.update(self._task, completed=done, total=whole)

    def echo(self, text: str) -> None:
        """Print a line on standard output; the bar makes room for it."""
        if self._shown:
            self.progress.stop()
        typer.echo(text)
        if self._shown:
            self.progress.start()


@contextmanager
def shown(title: str) -> Iterator[Bar]:
    """Show a progress bar as long as this lasts."""
    bar = Bar(title)
    bar.progress.start()
    try:
        yield bar
    finally:
        with suppress(IndexError):  # rich, where Ctrl-C came while it was about to show itself again
            bar.progress.stop()
