"""Recorded ranges as a link: each line of the file arrives when it is due."""

from __future__ import annotations

from pathlib import Path

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.ranging.replay import Recording, read
from circumnav_mav.runtime.transport import LinkError, Loop, OnChange, OnData, Timer


def recording(endpoint: Endpoint) -> Recording:
    """Return what the file of an endpoint holds. Raises LinkError, in words, where it cannot be read."""
    path = Path(endpoint.path)
    try:
        if path.exists() and not path.is_file():  # a pipe or a device may never end
            raise LinkError(f"{endpoint}: cannot read it: it is not a file")
        return read(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LinkError(f"{endpoint}: cannot read it: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise LinkError(f"{endpoint}: cannot read it: it is not UTF-8 text") from error


class ReplayLink:
    """Plays a file once, from the start of the flight, and then is lost. Nothing can be sent to it."""

    whole = False
    port = 0

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.send_errors = 0
        found = recording(endpoint)
        if not found.ranges:
            raise LinkError(f"{endpoint}: {found.complaint()}")
        self._due = found.due
        self._start_s = 0.0
        self._next = 0
        self._timer: Timer | None = None

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Play from now on."""
        self._loop, self._on_data, self._on_change = loop, on_data, on_change
        self._start_s = loop.time()
        self._play()

    def _play(self) -> None:
        while self._next < len(self._due):
            due_s, line = self._due[self._next]
            wait_s = self._start_s + due_s - self._loop.time()
            if wait_s > 0.0:
                self._timer = self._loop.call_later(wait_s, self._play)
                return
            self._next += 1
            self._on_data(line)
        self._on_change(False, f"{self.endpoint}: the recording is over")

    def drain(self) -> int:
        """Nothing waits: lines come when they are due."""
        return 0

    def send(self, data: bytes) -> None:
        """Nobody listens."""

    def close(self) -> None:
        """Stop playing."""
        if self._timer is not None:
            self._timer.cancel()
