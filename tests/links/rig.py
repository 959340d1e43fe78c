"""A lockstep rig whose ranges come from a real device's bytes, or from any other message, not from the stub's radio."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

from circumnav_mav.config import Config
from circumnav_mav.flight import RANGING
from circumnav_mav.flight_record import TickRecord
from sitl_stub import StubConfig
from tests.lockstep import Rig, airborne

Encode = Callable[[float, float, float], bytes]
"""(range [m], range rate [m/s, + opening], time [s]) -> what the device sends."""


class DeviceRig(Rig):
    """The device measures the stub's true range at `rate_hz` with noise `sigma_m`, and its rate with `rate_sigma_m_s`.

    `link`: where its bytes arrive. On a serial line they come in pieces that know nothing of frames.
    """

    def __init__(
        self,
        config: Config,
        encode: Encode,
        *,
        link: str = RANGING,
        rate_hz: float = 10.0,
        sigma_m: float = 0.3,
        rate_sigma_m_s: float = 0.2,
        seed: int = 11,
        world: dict[str, Any] | None = None,
    ) -> None:
        stub_config: StubConfig = airborne(**{"radio": False, "seed": seed, **(world or {})})
        super().__init__(config, stub_config)
        self._encode, self._link, self._rate_hz = encode, link, rate_hz
        self._sigma_m, self._rate_sigma_m_s = sigma_m, rate_sigma_m_s
        self._draw = random.Random(f"{seed}:device")
        self._measured = 0
        self.silent = False

    def step(self) -> TickRecord | None:
        now_s = (self._n + 1) * self.tick_s
        while self._measured / self._rate_hz <= now_s:
            self._measured += 1
            if not self.silent:
                self._measure(now_s)
        return super().step()

    def _measure(self, now_s: float) -> None:
        t = self.stub.truth()
        east, north, up = t.beacon_east_m - t.east_m, t.beacon_north_m - t.north_m, t.beacon_height_m - t.height_m
        range_m = math.sqrt(east**2 + north**2 + up**2)
        velocity = (t.speed_m_s * math.cos(t.course_rad), t.speed_m_s * math.sin(t.course_rad), t.climb_m_s)
        rate_m_s = -(east * velocity[0] + north * velocity[1] + up * velocity[2]) / range_m
        noisy_m = range_m + self._draw.gauss(0.0, self._sigma_m)
        data = self._encode(noisy_m, rate_m_s + self._draw.gauss(0.0, self._rate_sigma_m_s), now_s)
        if self._link != RANGING:
            self.flight.receive(data, now_s, self._link)
            return
        cut = self._draw.randrange(len(data) + 1)
        for piece in (data[:cut], data[cut:]):
            self.flight.receive(piece, now_s, self._link, whole=False)
