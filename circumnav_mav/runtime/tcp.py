"""TCP links: a client that calls again with back-off, and a server for one caller.

What is written to TCP is delivered however late: a link that stalls is cut rather than left to deliver old setpoints.
"""

from __future__ import annotations

import errno
import os
import socket

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.runtime.stream import READ_BYTES, Steps, StreamLink, Understood, unsent
from circumnav_mav.runtime.transport import LinkError, Loop, OnChange, OnData
from circumnav_mav.runtime.udp import why

CONNECT_WITHIN_S = 3.0
MOST_QUEUED = 2048
STALLED_MS = 3000
"""A peer that has not acknowledged for so long is gone."""


class TcpChannel:
    """A connected socket."""

    most_queued = MOST_QUEUED

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for option, value in (("TCP_USER_TIMEOUT", STALLED_MS), ("TCP_KEEPIDLE", 2), ("TCP_KEEPINTVL", 1)):
            if hasattr(socket, option):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = sock

    def fileno(self) -> int:
        """The file descriptor."""
        return self._socket.fileno()

    def read(self) -> bytes:
        """Return what has arrived; b"" when the other end has closed."""
        return self._socket.recv(READ_BYTES)

    def write(self, data: bytes) -> int:
        """Return how many bytes were taken."""
        return self._socket.send(data)

    def queued(self) -> int:
        """Return how many written bytes are not acknowledged yet."""
        return unsent(self.fileno())

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class TcpClient(StreamLink):
    """Calls one address. Raises LinkError, in words, where nobody answers at the start."""

    def __init__(self, endpoint: Endpoint, steps: Steps = (), understood: Understood = lambda: 0) -> None:
        try:
            # Resolved once: a look-up may block, and later there are ticks to keep.
            self._address = (socket.gethostbyname(endpoint.host), endpoint.port)
            sock = socket.create_connection(self._address, CONNECT_WITHIN_S)
        except OSError as error:
            raise LinkError(_why(endpoint, error)) from error
        if sock.getsockname() == sock.getpeername():
            sock.close()
            raise LinkError(_why(endpoint, ConnectionRefusedError()))
        super().__init__(endpoint, TcpChannel(sock), steps, understood)
        self._calling: socket.socket | None = None

    def _try(self) -> None:
        if self._loop is None:
            return
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        if sock.connect_ex(self._address) not in (0, errno.EINPROGRESS):
            sock.close()
            self._retry()
            return
        self._calling = sock
        self._loop.add_writer(sock.fileno(), self._answered)
        self._timers = [self._loop.call_later(CONNECT_WITHIN_S, self._unanswered)]

    def _answered(self) -> None:
        sock = self._stop_calling()
        if sock is None:
            return
        # A call to a free port of this machine may, rarely, be answered by the calling socket itself.
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) or sock.getsockname() == sock.getpeername():
            sock.close()
            self._retry()
            return
        self._up(TcpChannel(sock), f"{self.endpoint} answers again")

    def _unanswered(self) -> None:
        sock = self._stop_calling()
        if sock is not None:
            sock.close()
        self._retry()

    def _stop_calling(self) -> socket.socket | None:
        sock, self._calling = self._calling, None
        if sock is not None and self._loop is not None:
            self._loop.remove_writer(sock.fileno())
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        return sock

    def close(self) -> None:
        """Hang up, and stop calling."""
        if (sock := self._stop_calling()) is not None:
            sock.close()
        super().close()


class TcpServer(StreamLink):
    """Waits for one caller; while it is there, others are turned away."""

    after_loss = "waiting for another call"

    def __init__(self, endpoint: Endpoint, steps: Steps = (), understood: Understood = lambda: 0) -> None:
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((endpoint.host, endpoint.port))
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise LinkError(why(endpoint, error)) from error
        super().__init__(endpoint, None, steps, understood)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._listener.getsockname()[1])

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Wait for a caller, and read."""
        super().start(loop, on_data, on_change)
        loop.add_reader(self._listener.fileno(), self._called)

    def _called(self) -> None:
        try:
            sock, peer = self._listener.accept()
        except OSError:
            return
        if self._channel is not None:
            sock.close()
            return
        self._up(TcpChannel(sock), f"{self.endpoint}: {peer[0]} has called")

    def _retry(self) -> None:
        """The caller calls again, or does not."""

    def close(self) -> None:
        """Hang up, and take no more calls."""
        if self._listener.fileno() >= 0:
            if self._loop is not None:
                self._loop.remove_reader(self._listener.fileno())
            self._listener.close()
        super().close()


def _why(endpoint: Endpoint, error: OSError) -> str:
    if isinstance(error, ConnectionRefusedError):
        return f"{endpoint}: nobody answers there: is the other program running, and is it the right port?"
    if isinstance(error, TimeoutError):
        return f"{endpoint}: no answer within {CONNECT_WITHIN_S:g} s: check the address and the network"
    if error.errno in (errno.EHOSTUNREACH, errno.ENETUNREACH):
        return f"{endpoint}: {os.strerror(error.errno).lower()}: check the address and the network"
    return why(endpoint, error)
