"""The ranging radio: true ranges in, what a real radio would report out, as messages or as bytes of a device."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from sitl_stub import wire
from sitl_stub.config import StubConfig

DISTANCE_SENSOR, LANDING_TARGET, RANGING_BEACON = 132, 149, 513
RANGE_MIN_M = 0.1
QUALITY_UNKNOWN, QUALITY_INVALID = 0, 1
COVARIANCE_UNKNOWN = 255
ZERO4 = (0.0, 0.0, 0.0, 0.0)


class Measurement(NamedTuple):
    """One range: when it was measured [s], range [m], range rate [m/s, + opening]."""

    t_s: float
    range_m: float
    rate_m_s: float


@dataclass(slots=True)
class RadioFaults:
    """What is wrong with the radio now; None or 0 where nothing is."""

    stopped: bool = False
    stuck: bool = False
    add_m: float = 0.0
    value_m: float | None = None
    invalid: bool = False
    sensor_id: int | None = None
    orientation: int | None = None


class Radio:
    """Measures the range at a fixed rate with noise, bias, detours, dropouts and latency."""

    def __init__(self, config: StubConfig) -> None:
        self._config = config
        self.faults = RadioFaults()
        self._random = random.Random(f"{config.seed}:radio")
        self._index = 0  # of the next measurement; an index, so that the grid never drifts
        self._under_way: deque[tuple[float, Measurement]] = deque()
        self.due_s = 0.0  # when there is something to do
        self._last: Measurement | None = None
        self._sequence = 0

    def step(self, t_s: float, truth: Callable[[], tuple[float, float]]) -> list[Measurement]:
        """Return what arrives by t_s; `truth` gives the slant range [m] and its rate [m/s]."""
        c = self._config
        while self._index / c.range_rate_hz <= t_s + 1e-9:
            taken_s = self._index / c.range_rate_hz
            self._index += 1
            measured = self._measure(taken_s, *truth())
            if measured is not None:
                self._under_way.append((taken_s + c.range_latency_s, measured))
        arrived: list[Measurement] = []
        while self._under_way and self._under_way[0][0] <= t_s + 1e-9:
            arrived.append(self._under_way.popleft()[1])
        self.due_s = self._index / c.range_rate_hz - 1e-9
        if self._under_way:
            self.due_s = min(self.due_s, self._under_way[0][0] - 1e-9)
        return arrived

    def _measure(self, t_s: float, true_m: float, rate_m_s: float) -> Measurement | None:
        c, faults, gauss = self._config, self.faults, self._random.gauss
        # Drawn always and in the same order: a dropout must not change the noise of the rest of the flight.
        noise, rate_noise, lot, detour = gauss(), gauss(), self._random.random(), self._random.expovariate(1.0)
        if faults.stopped or true_m > c.range_max_m or any(a <= t_s < b for a, b in c.range_dropouts_s):
            return None
        if faults.stuck and self._last is not None:
            return self._last._replace(t_s=t_s)
        measured = true_m + c.range_bias_m + c.range_sigma_m * noise
        if lot < c.outlier_share:
            measured += c.outlier_mean_m * detour
        if c.range_step_m > 0.0:
            measured = c.range_step_m * round(measured / c.range_step_m)
        if faults.value_m is not None:
            measured = faults.value_m
        measured += faults.add_m
        measured = 0.0 if measured < 0.0 else measured  # NaN, which a fault may ask for, stays
        self._last = Measurement(t_s, measured, rate_m_s + c.range_rate_sigma_m_s * rate_noise)
        return self._last

    def message(self, m: Measurement) -> tuple[int, tuple[Any, ...]]:
        """Return message id and fields of the configured range message."""
        self._sequence += 1
        if self._config.range_message == "ranging_beacon":
            return RANGING_BEACON, self._ranging_beacon(m)
        if self._config.range_message == "landing_target":
            return LANDING_TARGET, self._landing_target(m)
        return DISTANCE_SENSOR, self._distance_sensor(m)

    def _distance_sensor(self, m: Measurement) -> tuple[Any, ...]:
        c, faults = self._config, self.faults
        variance = round((c.range_sigma_m * 100.0) ** 2)
        limits = (round(RANGE_MIN_M * 100.0), min(65535, round(c.range_max_m * 100.0)))
        cm = 0 if faults.invalid else min(65535, round(m.range_m * 100.0))
        return (
            round(m.t_s * 1000.0), *limits, cm, 0,
            c.range_sensor_id if faults.sensor_id is None else faults.sensor_id,
            c.range_orientation if faults.orientation is None else faults.orientation,
            variance if 0 < variance < COVARIANCE_UNKNOWN else COVARIANCE_UNKNOWN, 0.0, 0.0, ZERO4,
            QUALITY_INVALID if faults.invalid else QUALITY_UNKNOWN,
        )  # fmt: skip

    def _ranging_beacon(self, m: Measurement) -> tuple[Any, ...]:
        c, faults = self._config, self.faults
        beacon_id = c.range_beacon_id if faults.sensor_id is None else faults.sensor_id
        mm = 0 if faults.invalid else min(2**32 - 1, round(m.range_m * 1000.0))
        accuracy = min(65535, round(c.range_sigma_m * 1000.0))
        unknown = 2**31 - 1  # nobody knows where the beacon is
        stamp = round(m.t_s * 1e6)
        return (
            stamp, 0, 0, beacon_id, mm, unknown, unknown, math.nan, 0, 2**32 - 1, 2**32 - 1, 0, accuracy,
            self._sequence & 0xFF, 0,
        )  # fmt: skip

    def _landing_target(self, m: Measurement) -> tuple[Any, ...]:
        number = self._config.range_beacon_id if self.faults.sensor_id is None else self.faults.sensor_id
        distance = 0.0 if self.faults.invalid else m.range_m
        # Frame 12 (BODY_FRD), type 1 (a radio beacon); angles are not measured.
        return round(m.t_s * 1e6), number, 12, 0.0, 0.0, distance, 0.0, 0.0, 0.0, 0.0, 0.0, ZERO4, 1, 0


def distance_fields(values: tuple[Any, ...]) -> Any:
    """Return DISTANCE_SENSOR's fields by name."""
    spec = wire.spec(DISTANCE_SENSOR)
    assert spec is not None
    return spec.tuple_type._make(values)
