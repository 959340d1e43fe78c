"""A watchdog outside the loop. It can do one thing only: close the link, for good. It never sends anything.

A loop that hangs sends nothing anyway. What the watchdog adds is that a loop which comes back after the autopilot has
long taken over stays silent, whatever state it is in, and that the app then ends with an error that systemd sees.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

NAP_S = 0.1
WITHIN_S = 2.0
"""Without a tick for so long the loop counts as hung: twice PX4's COM_OF_LOSS_T as it is by default."""


class Watchdog:
    """Counts its own naps, not seconds: while the whole process is stopped or starved, it is too, and blames nobody."""

    def __init__(self, close_link: Callable[[], None], within_s: float = WITHIN_S) -> None:
        self._close_link = close_link
        self._naps = round(within_s / NAP_S)
        self._beats = 0
        self._end = threading.Event()
        self.fired = False
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def start(self) -> None:
        """Watch from now on."""
        self._thread.start()

    def beat(self) -> None:
        """The loop has ticked."""
        self._beats += 1

    def stop(self) -> None:
        """Stop watching; safe before `start` too."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        seen, naps = -1, 0
        while not self._end.wait(NAP_S):
            naps = naps + 1 if self._beats == seen else 0
            seen = self._beats
            if naps >= self._naps:
                self.fired = True
                self._close_link()
                return
