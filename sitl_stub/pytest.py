"""A pytest plugin: `pytest_plugins = ["sitl_stub.pytest"]`, and every test may ask for vehicles.

def test_my_app(sitl):
    vehicle = sitl(start_height_m=30.0, speed=5.0)      # any field of StubConfig, and the clock's speed
    ...                                                 # connect an app to vehicle.url
    assert vehicle.truth().mode == "OFFBOARD"

def test_my_app_without_sockets(sitl_lockstep):
    stub = sitl_lockstep(start_height_m=30.0)           # receive / advance / take, on simulated time
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from sitl_stub.config import StubConfig
from sitl_stub.running import Vehicle
from sitl_stub.stub import Stub


@pytest.fixture
def sitl() -> Iterator[Callable[..., Vehicle]]:
    """Start vehicles on UDP ports; they stop when the test is over."""
    started: list[Vehicle] = []

    def start(*, speed: float = 1.0, **fields: Any) -> Vehicle:
        started.append(Vehicle(StubConfig(**fields), speed))
        return started[-1]

    yield start
    for vehicle in started:
        vehicle.stop()


@pytest.fixture
def sitl_lockstep() -> Callable[..., Stub]:
    """Make vehicles that the test itself carries through time."""
    return lambda **fields: Stub(StubConfig(**fields))
