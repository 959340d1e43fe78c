"""systemd's Type=notify and watchdog, without a library: datagrams to $NOTIFY_SOCKET, nothing where there is none."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from math import inf


def as_a_service(environment: Mapping[str, str]) -> bool:
    """Return whether systemd started this process and waits for its word. environment: os.environ."""
    return bool(environment.get("NOTIFY_SOCKET"))


class Notifier:
    """Never blocks and never raises: systemd must not matter to a flight. environment: os.environ."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if path else None
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        timeout_us = environment.get("WATCHDOG_USEC", "")
        self._period_s = int(timeout_us) / 2e6 if ours and timeout_us.isdigit() and int(timeout_us) else inf
        self._next_s = -inf

    def tell(self, *lines: str) -> None:
        """Send READY=1, STOPPING=1, STATUS=..."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)

    def beat(self, wall_s: float) -> None:
        """Send WATCHDOG=1, twice in the time that the unit allows. To be called by the tick itself, and by nobody else:
        a loop that does not tick must look dead. wall_s: monotonic.
        """
        if wall_s >= self._next_s and self._period_s < inf:
            self._next_s = wall_s + self._period_s
            self.tell("WATCHDOG=1")

    def close(self) -> None:
        """Say that the service stops."""
        self.tell("STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None
