"""Serial links: /dev/ttyACM0, /dev/serial/by-id/..., with hot unplug and replug. The one door to pyserial."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from circumnav_mav.endpoint import Endpoint
from circumnav_mav.runtime.stream import READ_BYTES, Steps, StreamLink, Understood, unsent
from circumnav_mav.runtime.transport import LinkError

QUEUED_S = 0.1
"""What would leave later than this is dropped: a setpoint behind it would be old."""
LEAST_QUEUE = 512
BY_ID = Path("/dev/serial/by-id")


class SerialChannel:
    """An open port."""

    def __init__(self, port: Any, baud: int) -> None:
        self._port = port
        self.most_queued = max(LEAST_QUEUE, round(baud / 10 * QUEUED_S))

    def fileno(self) -> int:
        """The file descriptor."""
        return int(self._port.fileno())

    def read(self) -> bytes:
        """Return what has arrived; b"" when the device is gone."""
        return os.read(self.fileno(), READ_BYTES)

    def write(self, data: bytes) -> int:
        """Return how many bytes were taken."""
        return os.write(self.fileno(), data)

    def queued(self) -> int:
        """Return how many written bytes have not left yet."""
        return unsent(self.fileno())

    def close(self) -> None:
        """Close the port; one that was unplugged complains, to nobody."""
        try:
            self._port.close()
        except OSError:
            return


class SerialLink(StreamLink):
    """A serial port. Raises LinkError, in words, where it cannot be opened at the start."""

    def __init__(
        self, endpoint: Endpoint, default_baud: int, steps: Steps = (), understood: Understood = lambda: 0
    ) -> None:
        baud = endpoint.baud or default_baud
        self._baud = baud
        super().__init__(Endpoint("serial", path=endpoint.path, baud=baud), None, steps, understood)
        self._channel = self._open()

    def _open(self) -> SerialChannel:
        try:
            import serial
        except ImportError:
            raise LinkError(
                f"{self.endpoint}: serial ports need pyserial: pip install 'circumnav-mav[serial]'"
            ) from None
        try:
            # inter_byte_timeout 0: a read with nothing there is an error, and only a lost device reads as empty.
            port = serial.Serial(
                self.endpoint.path, self._baud, timeout=0, write_timeout=0, inter_byte_timeout=0, exclusive=True
            )
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(f"{self.endpoint}: {_why(self.endpoint, error)}") from error
        with suppress(ValueError, NotImplementedError):  # FTDI adapters hold bytes back for 16 ms unless told not to
            port.set_low_latency_mode(True)
        return SerialChannel(port, self._baud)

    def _try(self) -> None:
        try:
            channel = self._open()
        except LinkError:
            self._retry()
            return
        self._up(channel, f"{self.endpoint} is open again")


def _why(endpoint: Endpoint, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if isinstance(error, ValueError):
        return f"the port does not do {endpoint.baud} baud"
    if code == errno.EACCES:
        return "permission denied: add yourself to the group dialout (sudo usermod -aG dialout $USER) and log in again"
    if code == errno.ENOENT:
        there = sorted(str(path) for path in BY_ID.glob("*")) if BY_ID.is_dir() else []
        return f"no such device: is it plugged in? There {_listed(there)}"
    if code in (errno.EAGAIN, errno.EBUSY):
        return "another program has it open (ModemManager, mavlink-router, another circumnav?)"
    if code in (errno.ENXIO, errno.EIO):
        return "the device does not answer: plug it in again"
    if code in (errno.ENOTTY, errno.EINVAL, errno.EISDIR, None):
        return "this is no serial port"
    return getattr(error, "strerror", None) or str(error)


def _listed(there: list[str]) -> str:
    return f"is: {', '.join(there)}" if there else "is no serial device in /dev/serial/by-id"
