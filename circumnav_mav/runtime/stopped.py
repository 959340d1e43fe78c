"""A process that was stopped (SIGSTOP, a debugger, a suspended machine) learns of it before it does anything else."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def on_continue(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` on SIGCONT, between two steps of the interpreter. It must do no more than set a flag.

    A handler of the event loop would run as a callback, after those that are already due: behind a tick that sends.
    """
    before = signal.signal(signal.SIGCONT, lambda signum, frame: tell())
    try:
        yield
    finally:
        signal.signal(signal.SIGCONT, before)
