"""A link over a stream that can break: it is opened again with back-off, and says so.

Opening it again is all that it does: whether anything may be sent is decided by the flight, which believes nothing
older than the break.
"""

from __future__ import annotations

import fcntl
import struct
import termios
from collections.abc import Callable
from functools import partial
from typing import Protocol

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.runtime.transport import Backoff, Loop, OnChange, OnData, Timer

READ_BYTES = 4096
MOST_READS_A_TURN = 16
"""So that a flood cannot keep the loop from its ticks."""
MOST_READS = 1024

AGAIN_S = 10.0
"""How long a device may take to say something after the last step, before they are gone through again."""

Steps = tuple[tuple[float, bytes], ...]
"""(wait s, send) steps that make a silent device talk."""
Understood = Callable[[], int]
"""How much of what a device said was understood so far: a device that talks is not told to."""


class Channel(Protocol):
    """An open, non-blocking stream. read: b"" = the other end is gone; BlockingIOError = nothing there now."""

    most_queued: int

    def fileno(self) -> int:
        """The file descriptor."""

    def read(self) -> bytes:
        """Return what has arrived."""

    def write(self, data: bytes) -> int:
        """Return how many bytes were taken."""

    def queued(self) -> int:
        """Return how many written bytes have not left yet."""

    def close(self) -> None:
        """Close it."""


class StreamLink:
    """What serial and TCP links share; a subclass opens channels in `_try`, which calls `_up` or `_retry`."""

    whole = False
    after_loss = "trying to open it again"

    def __init__(
        self, endpoint: Endpoint, channel: Channel | None, steps: Steps = (), understood: Understood = lambda: 0
    ) -> None:
        self.endpoint = endpoint
        self.send_errors = 0
        self._channel = channel
        self._steps, self._understood = steps, understood
        self._rest = b""  # of a frame that was taken in part: it must be ended before the next one
        self._backoff = Backoff()
        self._timers: list[Timer] = []
        self._loop: Loop | None = None

    @property
    def port(self) -> int:
        """The local port; 0 where there is none."""
        return 0

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Read from now on, in the running event loop."""
        self._loop, self._on_data, self._on_change = loop, on_data, on_change
        if self._channel is not None:
            self._watch(loop, self._channel)

    def drain(self, most: int = MOST_READS) -> int:
        """Hand on what has arrived, in at most `most` pieces; return how many there were."""
        count = 0
        while count < most and self._channel is not None:
            try:
                data = self._channel.read()
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._lost(error.strerror or str(error))
                break
            if not data:
                self._lost("the other end is gone")
                break
            count += 1
            self._backoff.reset()
            self._on_data(data)
        return count

    def send(self, data: bytes) -> None:
        """Send now or never: what would wait behind too much is dropped, and counted."""
        channel = self._channel
        if channel is None:
            return  # the loss was told; what is lost meanwhile needs no count
        try:
            if self._rest:
                self._rest = self._rest[channel.write(self._rest) :]
            if self._rest or channel.queued() > channel.most_queued:
                self.send_errors += 1
                return
            self._rest = data[channel.write(data) :]
        except (BlockingIOError, InterruptedError):
            self.send_errors += 1
        except OSError as error:
            self._lost(error.strerror or str(error))

    def close(self) -> None:
        """Stop reading and close; a closed link sends nothing and is not opened again."""
        self._shut()
        self._loop = None

    # -- for subclasses ---------------------------------------------------------------------------------------------

    def _try(self) -> None:
        """Open a channel, at once or later."""
        raise NotImplementedError

    def _up(self, channel: Channel, words: str) -> None:
        if self._loop is None:
            channel.close()
            return
        self._channel = channel
        self._watch(self._loop, channel)
        self._on_change(True, words)

    def _retry(self) -> None:
        if self._loop is not None:
            self._timers = [self._loop.call_later(self._backoff.next(), self._try)]

    # -- the works --------------------------------------------------------------------------------------------------

    def _watch(self, loop: Loop, channel: Channel) -> None:
        loop.add_reader(channel.fileno(), self._readable)
        if self._steps:
            self._wake(loop, 0, self._understood())

    def _wake(self, loop: Loop, n: int, before: int, rest_s: float = 0.0) -> None:
        """Wait for step n and do it, unless more was understood by then than before the first: then all is well."""
        after_s, data = self._steps[n]
        self._timers = [loop.call_later(rest_s + after_s, partial(self._step, loop, n, before, data))]

    def _step(self, loop: Loop, n: int, before: int, data: bytes) -> None:
        if self._understood() > before:
            return
        self.send(data)
        if self._channel is None:
            return  # sending it showed that the line is gone
        last = n + 1 == len(self._steps)
        self._wake(loop, 0 if last else n + 1, before, AGAIN_S if last else 0.0)

    def _readable(self) -> None:
        self.drain(MOST_READS_A_TURN)

    def _lost(self, why: str) -> None:
        self._shut()
        if self._loop is not None:
            self._on_change(False, f"{self.endpoint}: {why}; {self.after_loss}")
            self._retry()

    def _shut(self) -> None:
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        self._rest = b""
        channel, self._channel = self._channel, None
        if channel is not None:
            if self._loop is not None:
                self._loop.remove_reader(channel.fileno())
            channel.close()


def unsent(fd: int) -> int:
    """Return how many bytes written to a tty or socket have not left it."""
    try:
        (count,) = struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0" * 4))
    except OSError:
        return 0
    return int(count)
