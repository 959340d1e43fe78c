"""UDP links: non-blocking sockets that the loop reads dry."""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable
from functools import partial
from math import inf

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.runtime.transport import LinkError, Loop, OnChange, OnData

DATAGRAM = 65535
RECEIVE_BUFFER = 1 << 20
STAYS_S = 1.0
"""So long another sender is not taken for the one that moved to a new port."""
MOST_DATAGRAMS_A_TURN = 1
"""One, so that a burst, or a flood, never stands between the loop and its tick: timers get their turn in between."""


class UdpLink:
    """One UDP endpoint. udpin binds, and speaks to whom on_data last said to; udpout speaks to one address.

    A radio, or a ground station, may send to the very port of the autopilot: setpoints must not go to it.
    """

    whole = True

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self.send_errors = 0
        self.now_s: Callable[[], float] = time.monotonic
        self._heard_s = -inf
        """When the one that is spoken to was last heard as the one to speak to."""
        self._loop: Loop | None = None
        try:
            if endpoint.kind == "udpin":
                self._socket.bind((endpoint.host, endpoint.port))
            else:
                self._peer = (socket.gethostbyname(endpoint.host), endpoint.port)
        except OSError as error:
            self._socket.close()
            raise LinkError(why(endpoint, error)) from error

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Read from now on, in the running event loop; a socket without connection is never lost."""
        self._on_data = on_data
        self._loop = loop
        loop.add_reader(self._socket.fileno(), partial(self.drain, MOST_DATAGRAMS_A_TURN))

    def drain(self, most: int | None = None) -> int:
        """Hand on everything that has arrived (at most `most` datagrams); return how many there were."""
        count = 0
        while most is None or count < most:
            try:
                data, peer = self._socket.recvfrom(DATAGRAM)
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionError:
                continue  # an ICMP refusal of something sent earlier: the peer is not there (yet)
            count += 1
            wanted = self._on_data(data)
            if self.endpoint.kind == "udpin":
                self._choose(peer, wanted=wanted)
        return count

    def _choose(self, peer: tuple[str, int], *, wanted: bool) -> None:
        """Speak to `peer` if it is the one, and no other has been lately: two that forward the same must not share."""
        now_s = self.now_s()
        if wanted and (peer == self._peer or now_s - self._heard_s > STAYS_S):
            self._peer, self._heard_s = peer, now_s
        elif self._peer is None:
            self._peer = peer

    def send(self, data: bytes) -> None:
        """Send a datagram; with nobody to send to it is dropped. A full buffer drops too: old setpoints help nobody."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            self.send_errors += 1

    def close(self) -> None:
        """Stop reading and close; a closed link sends nothing."""
        if self._socket.fileno() < 0:
            return
        if self._loop is not None:
            self._loop.remove_reader(self._socket.fileno())
        self._peer = None
        self._socket.close()


def why(endpoint: Endpoint, error: OSError) -> str:
    """Return in words why a network endpoint does not open."""
    if isinstance(error, socket.gaierror):
        return f"{endpoint}: the host name '{endpoint.host}' is not known"
    if error.errno == errno.EADDRINUSE:
        return f"{endpoint}: the port is in use; stop the other program (another circumnav?) or choose another port"
    if error.errno == errno.EACCES:
        return f"{endpoint}: ports below 1024 are for root only; choose another port"
    return f"{endpoint}: {error.strerror or error}"
