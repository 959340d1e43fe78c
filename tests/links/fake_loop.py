"""An event loop whose time is set by the test, on real file descriptors; and what a link told on it."""

from __future__ import annotations

import heapq
import itertools
import os
import select
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE_S = 5.0
"""How long the kernel is given to hand over what is under way; a test that needs it all has failed."""


class FakeTimer:
    def __init__(self) -> None:
        self.cancelled = False

    def cancel(self) -> None:
        self.cancelled = True


class FakeLoop:
    def __init__(self) -> None:
        self.now_s = 0.0
        self.readers: dict[int, Callable[[], Any]] = {}
        self.writers: dict[int, Callable[[], Any]] = {}
        self._timers: list[tuple[float, int, FakeTimer, Callable[[], Any]]] = []
        self._count = itertools.count()

    def time(self) -> float:
        return self.now_s

    def add_reader(self, fd: int, callback: Callable[[], Any]) -> None:
        self.readers[fd] = callback

    def remove_reader(self, fd: int) -> bool:
        assert fd >= 0, "a closed file is removed from no loop"
        return self.readers.pop(fd, None) is not None

    def add_writer(self, fd: int, callback: Callable[[], Any]) -> None:
        self.writers[fd] = callback

    def remove_writer(self, fd: int) -> bool:
        assert fd >= 0, "a closed file is removed from no loop"
        return self.writers.pop(fd, None) is not None

    def call_later(self, delay: float, callback: Callable[[], Any]) -> FakeTimer:
        timer = FakeTimer()
        heapq.heappush(self._timers, (self.now_s + delay, next(self._count), timer, callback))
        return timer

    @property
    def due_s(self) -> list[float]:
        """When the waiting timers are due."""
        return sorted(at_s for at_s, _, timer, _ in self._timers if not timer.cancelled)

    def advance(self, for_s: float) -> None:
        """Let time pass, timers and files in between."""
        end_s = self.now_s + for_s
        while self._timers and self._timers[0][0] <= end_s:
            self.now_s, _, timer, callback = heapq.heappop(self._timers)
            if not timer.cancelled:
                callback()
                self.turn()
        self.now_s = end_s
        self.turn()

    def turn(self, wait_s: float = 0.0) -> bool:
        """Call back for every file that is ready; return whether one was."""
        ready_r, ready_w, _ = select.select(list(self.readers), list(self.writers), [], wait_s)
        for fd in ready_r:
            if fd in self.readers:
                self.readers[fd]()
        for fd in ready_w:
            if fd in self.writers:
                self.writers[fd]()
        return bool(ready_r or ready_w)

    def until(self, holds: Callable[[], bool]) -> None:
        """Turn until something holds."""
        while not holds():
            assert self.turn(PATIENCE_S), "nothing came"


class Wire:
    """A started link and what it told."""

    def __init__(self, link: Any, hear: Callable[[bytes], Any] = lambda data: None) -> None:
        self.link, self.loop, self._hear = link, FakeLoop(), hear
        self.data = b""
        self.changes: list[tuple[bool, str]] = []
        link.start(self.loop, self._on_data, lambda up, words: self.changes.append((up, words)))

    def _on_data(self, data: bytes) -> None:
        self.data += data
        self._hear(data)

    @property
    def ups(self) -> list[bool]:
        return [up for up, _ in self.changes]


class Cable:
    """A pseudo-terminal behind a path that stays the same, as in /dev/serial/by-id: unplug and replug it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = -1
        self.plug()

    def plug(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)
        os.set_blocking(self.master, False)

    def unplug(self) -> None:
        os.close(self.master)
        self.path.unlink()
        self.master = -1

    def say(self, data: bytes) -> None:
        os.write(self.master, data)

    def heard(self, count: int | None = None) -> bytes:
        """Return what the app wrote: everything there is, or wait until there are `count` bytes."""
        data = b""
        while count is None or len(data) < count:
            if not select.select([self.master], [], [], 0.0 if count is None else PATIENCE_S)[0]:
                break
            try:
                data += os.read(self.master, 65536)
            except OSError:  # nobody has the other end open
                break
        return data
