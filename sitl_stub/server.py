"""The stub on the wall clock: UDP sockets, a speed factor, the truth file. The only module with sockets and a clock.

Flight time follows the wall clock times the speed, in single steps with the sockets read between them. After a stall
it catches up at no more than twice the pace: a burst of flight time would starve the vehicle of setpoints that the
app had no chance to send.
"""

from __future__ import annotations

import contextlib
import math
import os
import selectors
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TextIO

from sitl_stub.devices import console_of
from sitl_stub.pace import Pace
from sitl_stub.stub import Stub
from sitl_stub.truth import Truth

CATCH_UP = 2.0
SLICE_S = 0.02  # wall time that one round of the loop may make up for
LONGEST_NAP_S = 0.05


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a link listens and where it sends before anybody has spoken to it (port 0: any free one, or nobody)."""

    listen_port: int
    peer_port: int
    host: str = "127.0.0.1"


class Pty:
    """A pseudo-terminal that a device's bytes come out of; `name` is what an app opens as its serial port."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.name = os.ttyname(self._theirs)

    def write(self, data: bytes) -> None:
        """Write a report; with nobody reading, a full line loses it as a UART would."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._ours, data)

    def typed(self) -> bytes:
        """Return what the app wrote to the device."""
        with contextlib.suppress(BlockingIOError, OSError):
            return os.read(self._ours, 4096)
        return b""

    def close(self) -> None:
        """Close both ends."""
        os.close(self._ours)
        os.close(self._theirs)


class PortBusy(OSError):
    """A UDP port that something else holds."""


class Server:
    """Flies a Stub on the wall clock."""

    def __init__(
        self,
        stub: Stub,
        endpoints: Mapping[str, Endpoint],
        speed: float = 1.0,
        truth: TruthLog | None = None,
        pty: Pty | None = None,
        pace: Pace | None = None,
    ) -> None:
        """`endpoints`: UDP ports by link; `pty`: where the bytes of the link "device" go if it has no UDP port."""
        self.stub, self.speed, self._pty = stub, speed, pty
        self._console = console_of(stub.config.device)
        self._truth, self._pace = truth, pace
        self.lock = threading.Lock()  # held while the stub changes; for truth() from another thread
        self._selector = selectors.SelectSelector()  # epoll would wake up to a millisecond late
        self._sockets: dict[str, socket.socket] = {}
        self._peers: dict[str, tuple[str, int] | None] = {}
        try:
            for link, endpoint in endpoints.items():
                self._open(link, endpoint)
        except OSError:
            self.close()
            raise

    def port(self, link: str) -> int:
        """Return the port that a link listens on."""
        return int(self._sockets[link].getsockname()[1])

    def run(self, duration_s: float | None = None, stop: Callable[[], bool] = lambda: False) -> None:
        """Fly until `stop` says so or duration_s of flight time are over."""
        stub, step_s, end_s = self.stub, self.stub.config.step_s, math.inf
        if duration_s is not None:
            end_s = stub.now_s + duration_s - 0.5 * step_s
        aim_s, last_wall_s = stub.now_s, time.monotonic()
        owed_s = 0.0  # flight time that the wall clock is ahead of aim_s
        while stub.now_s < end_s and not stop():
            wall_s = time.monotonic()
            owed_s += (wall_s - last_wall_s) * self.speed
            pace_s = min(owed_s, CATCH_UP * self.speed * min(wall_s - last_wall_s, SLICE_S))
            last_wall_s, aim_s, owed_s = wall_s, aim_s + pace_s, owed_s - pace_s
            if self._pace is not None and aim_s > (limit_s := self._pace.limit_s(stub.now_s, wall_s)):
                aim_s, owed_s = max(aim_s - pace_s, limit_s), 0.0  # what was waited for is not made up for
            while stub.now_s + step_s <= aim_s and stub.now_s < end_s:
                with self.lock:
                    stub.advance(stub.now_s + step_s)
                    self._write()
                    if self._truth is not None:
                        self._truth.note(stub)
                    self._read(0.0)
            nap_s = (stub.now_s + step_s - aim_s) / self.speed if owed_s < step_s else step_s / self.speed / CATCH_UP
            self._read(max(nap_s, 0.0))

    def close(self) -> None:
        """Close sockets and the truth file."""
        for opened in self._sockets.values():
            with contextlib.suppress(KeyError):
                self._selector.unregister(opened)
            opened.close()
        self._selector.close()
        if self._pty is not None:
            self._pty.close()
        if self._truth is not None:
            self._truth.close()

    def _open(self, link: str, endpoint: Endpoint) -> None:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setblocking(False)
        self._sockets[link] = opened
        try:
            opened.bind((endpoint.host, endpoint.listen_port))
        except OSError as error:
            raise PortBusy(
                f"UDP port {endpoint.listen_port} ({link} link) cannot be used: {error.strerror}; "
                f"is another vehicle running? choose another port with --{link}-listen (0: any free one)"
            ) from error
        self._peers[link] = (endpoint.host, endpoint.peer_port) if endpoint.peer_port else None
        self._selector.register(opened, selectors.EVENT_READ, link)

    def _read(self, timeout_s: float) -> None:
        ready = self._selector.select(timeout_s)
        for key, _ in ready:
            opened, link = self._sockets[key.data], key.data
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    data, peer = opened.recvfrom(65535)
                    self._peers[link] = peer  # like PX4, answer whoever spoke last
                    self.stub.receive(link, data)

    def _write(self) -> None:
        if self._pty is not None:
            self._pty.write(self._console.hear(self._pty.typed(), self.stub.now_s))
            for report in self.stub.take("device"):
                self._pty.write(self._console.says(report))
        for link, opened in self._sockets.items():
            datagrams = self.stub.take(link)
            peer = self._peers[link]
            if peer is None:
                continue
            for datagram in datagrams:
                # Nobody listening, or a full buffer: a radio link would not know either.
                with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
                    opened.sendto(datagram, peer)


class TruthLog:
    """Writes the ground truth as CSV, one row every period_s of flight time. Columns: the fields of Truth.

    A file that cannot be written (a full disk) is an OSError that names it: at a row, or only when it is closed.
    """

    def __init__(self, path: Path, period_s: float = 0.05) -> None:
        self._file: TextIO = path.open("w", encoding="utf-8", newline="")
        self._path = path
        self._names = [field.name for field in fields(Truth)]
        self._period_s, self._next_s = period_s, 0.0
        self._write(self._names)

    def note(self, stub: Stub) -> None:
        """Write a row if one is due."""
        if stub.now_s + 1e-9 >= self._next_s:
            self._next_s += self._period_s
            truth = stub.truth()
            self._write([_cell(getattr(truth, name)) for name in self._names])

    def close(self) -> None:
        """Close the file."""
        with self._naming_the_file():
            self._file.close()

    def _write(self, cells: list[str]) -> None:
        with self._naming_the_file():
            self._file.write(",".join(cells) + "\n")

    @contextlib.contextmanager
    def _naming_the_file(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.5f}" if isinstance(value, float) else str(value)
