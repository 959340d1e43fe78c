"""What every link is to the app: bytes in, bytes out, and word of it when the other end goes or comes back.

A link reads itself dry, so that nothing old is ever mistaken for new, and never waits: what cannot be sent now is
dropped, because an old setpoint helps nobody.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from circumnav_mav.endpoint import Endpoint

OnData = Callable[[bytes], bool]
"""Takes what arrived; returns whether its sender is the one to speak to, where several share a port."""
OnChange = Callable[[bool, str], None]
"""(True: the link is up again, False: it is lost; in words)."""


class LinkError(Exception):
    """A link that cannot be opened; the text says what to do."""


class Timer(Protocol):
    """What call_later returns."""

    def cancel(self) -> None:
        """Forget the call."""


class Loop(Protocol):
    """The part of asyncio's event loop that links live on."""

    def time(self) -> float:
        """Return the loop's own time, s."""

    def add_reader(self, fd: int, callback: Callable[[], Any], /) -> None:
        """Call when there is something to read."""

    def remove_reader(self, fd: int, /) -> bool:
        """Stop that."""

    def add_writer(self, fd: int, callback: Callable[[], Any], /) -> None:
        """Call when there is room to write."""

    def remove_writer(self, fd: int, /) -> bool:
        """Stop that."""

    def call_later(self, delay: float, callback: Callable[[], Any], /) -> Timer:
        """Call after a delay, s."""


class Transport(Protocol):
    """One open link. `whole`: each piece of data is a datagram, which no frame outlives."""

    endpoint: Endpoint
    whole: bool
    send_errors: int

    @property
    def port(self) -> int:
        """The local port; 0 where there is none."""

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Read from now on, in the running event loop."""

    def drain(self) -> int:
        """Hand on everything that has arrived; return how many pieces there were."""

    def send(self, data: bytes) -> None:
        """Send now or never."""

    def close(self) -> None:
        """Stop reading and close; a closed link sends nothing."""


class Backoff:
    """How long to wait before the next attempt: 0.2 s, doubled up to 5 s, and anew once the other end has spoken."""

    FIRST_S, MOST_S = 0.2, 5.0

    def __init__(self) -> None:
        self._next_s = self.FIRST_S

    def next(self) -> float:
        """Return the wait before the next attempt, s."""
        wait_s, self._next_s = self._next_s, min(2.0 * self._next_s, self.MOST_S)
        return wait_s

    def reset(self) -> None:
        """The other end is there."""
        self._next_s = self.FIRST_S
