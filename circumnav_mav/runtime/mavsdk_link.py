"""`library: mavsdk`: the vehicle's link through MAVSDK, in a process of its own (mavsdk_child.py). Frames in and out.

MAVSDK has threads of its own, which go on while Python hangs, and native code, which may take its process with it: so
it lives in a child. Setpoints are the app's alone, and none is ever sent twice (mavsdk_child.py). Nothing that MAVSDK
says about modes is believed: the mode messages themselves come through, and the same authority reads them.
"""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.runtime.tcp import TcpServer
from circumnav_mav.runtime.transport import LinkError, Loop, OnChange, OnData
from circumnav_mav.runtime.udp import UdpLink

STAMP = struct.Struct("d")
"""Before each frame: when it was given, s, on the monotonic clock, which is the same one in both processes."""
FRAME = 4096
STOP_S = 3.0


class MavsdkLink:
    """A Transport whose other end is the child. Datagrams on a socket pair, one frame each. Raises LinkError, in words,
    where the endpoint cannot be opened.
    """

    whole = True

    def __init__(self, endpoint: Endpoint, system_id: int | None = None) -> None:
        self.endpoint = endpoint
        _look(endpoint)
        self._port = _free_port() if endpoint.kind == "udpin" and endpoint.port == 0 else endpoint.port
        url = str(replace(endpoint, port=self._port))
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        command = [sys.executable, "-m", "circumnav_mav.runtime.mavsdk_child", url, str(theirs.fileno())]
        command.append(str(system_id or 0))
        try:
            # A session of its own: Ctrl-C is for the app, which ends politely and then closes the pair.
            self._child = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], stdout=subprocess.DEVNULL, start_new_session=True
            )
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{endpoint}: the MAVSDK process does not start: {error.strerror or error}") from error
        finally:
            theirs.close()
        self._loop: Loop | None = None
        self.send_errors = 0

    @property
    def port(self) -> int:
        """The local port that MAVSDK listens on."""
        return self._port

    def start(self, loop: Loop, on_data: OnData, on_change: OnChange) -> None:
        """Read from now on."""
        self._loop, self._on_data, self._on_change = loop, on_data, on_change
        loop.add_reader(self._socket.fileno(), self.drain)

    def drain(self) -> int:
        """Hand on everything that has arrived; return how many frames there were."""
        count = 0
        while self._loop is not None:
            try:
                data = self._socket.recv(FRAME)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                data = b""
            if not data:
                self._loop.remove_reader(self._socket.fileno())
                self._loop = None
                self._on_change(False, "the MAVSDK process has ended")
                break
            count += 1
            self._on_data(data)
        return count

    def send(self, data: bytes) -> None:
        """Hand a frame to MAVSDK; dropped where it does not keep up."""
        try:
            self._socket.send(STAMP.pack(time.monotonic()) + data)
        except OSError:
            self.send_errors += 1

    def close(self) -> None:
        """End the child: it sees the closed pair."""
        if self._loop is not None:
            self._loop.remove_reader(self._socket.fileno())
            self._loop = None
        self._socket.close()
        with suppress(subprocess.TimeoutExpired):
            self._child.wait(STOP_S)
            return
        self._child.kill()
        self._child.wait()


def _look(endpoint: Endpoint) -> None:
    """Open and close what can be opened without anybody noticing: the app's own words, before MAVSDK has its say."""
    if endpoint.kind in ("udpin", "udpout"):
        UdpLink(endpoint).close()
    elif endpoint.kind == "tcpin":
        TcpServer(endpoint).close()


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
