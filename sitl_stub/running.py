"""A stub that runs beside your test: sockets and clock in a thread, the truth at hand."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from sitl_stub.config import StubConfig
from sitl_stub.server import Endpoint, Server
from sitl_stub.stub import Stub
from sitl_stub.truth import Truth

HOST = "127.0.0.1"


class Vehicle:
    """A running vehicle. Listen on UDP `port` as a companion does on 14540, on `gcs_port` as a GCS does on 14550."""

    def __init__(self, config: StubConfig, speed: float = 1.0) -> None:
        self.port, self.gcs_port, self.ranging_port = free_port(), free_port(), 0
        if config.unix_start_s is None:  # real peers look at the time of day in signatures
            config = replace(config, unix_start_s=time.time())
        self.stub, self.speed = Stub(config), speed
        endpoints = {"offboard": Endpoint(0, self.port), "gcs": Endpoint(0, self.gcs_port)}
        for link, wanted in (("ranging", config.range_link == "ranging"), ("device", bool(config.device))):
            if wanted:
                self.ranging_port = free_port()
                endpoints[link] = Endpoint(0, self.ranging_port)
        self._server = Server(self.stub, endpoints, speed)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sitl_stub", daemon=True)
        self._error: Exception | None = None
        self._thread.start()

    @property
    def url(self) -> str:
        """The connection string of an app: udpin://127.0.0.1:PORT."""
        return f"udpin://{HOST}:{self.port}"

    def truth(self) -> Truth:
        """Return where everything really is. Raises what the vehicle died of, if it did."""
        self._raise()
        with self._server.lock:
            return self.stub.truth()

    def wait_until(self, what: Callable[[Truth], bool], within_s: float) -> Truth:
        """Return the truth as soon as `what` holds. TimeoutError after within_s of flight time."""
        began_s = self.truth().t_s
        while True:
            truth = self.truth()
            if what(truth):
                return truth
            if truth.t_s - began_s > within_s:
                raise TimeoutError(f"not within {within_s} s of flight; the vehicle: {truth}")
            time.sleep(0.01)

    def stop(self) -> None:
        """Stop flying and close the ports; once more is no harm."""
        if not self._stopping.is_set():
            self._stopping.set()
            self._thread.join()
            self._server.close()
        self._raise()

    def _run(self) -> None:
        try:
            self._server.run(stop=self._stopping.is_set)
        except Exception as error:  # noqa: BLE001 - handed to the test's thread
            self._error = error

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error


@contextlib.contextmanager
def running(config: StubConfig | None = None, speed: float = 1.0) -> Iterator[Vehicle]:
    """Run a vehicle for the length of a with block."""
    vehicle = Vehicle(config or StubConfig(), speed)
    try:
        yield vehicle
    finally:
        vehicle.stop()


def free_port() -> int:
    """Return a UDP port of this machine that nobody listens on now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
