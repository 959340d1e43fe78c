"""What is around the vehicle: the beacon, the air, the globe."""

from __future__ import annotations

import math
import random
from typing import Protocol

from sitl_stub.config import StubConfig

EARTH_RADIUS_M = 6371000.0
HOME_LAT_DEG, HOME_LON_DEG, HOME_AMSL_M = 47.397742, 8.545594, 489.4  # where PX4's simulation stands
_M_PER_DEG_LAT = math.radians(EARTH_RADIUS_M)
_M_PER_DEG_LON = _M_PER_DEG_LAT * math.cos(math.radians(HOME_LAT_DEG))


def pressure_hpa(height_m: float) -> float:
    """Return the air's pressure at a height above the ground; it has 15 degrees Celsius everywhere, as in PX4's SIH."""
    return 955.8 * math.exp(-height_m / 8434.0)


def calibrated_per_true(height_m: float) -> float:
    """Return calibrated / true airspeed: the root of the air's density over that of the standard at sea level."""
    return math.sqrt(pressure_hpa(height_m) / 1013.25)


class Mover(Protocol):
    """Something with a place and a velocity: north, east, up [m, m/s]."""

    n: float
    e: float
    h: float
    vn: float
    ve: float
    vu: float


class World:
    """Beacon and wind as functions of time; gusts are stepped with the flight."""

    def __init__(self, config: StubConfig, dt_s: float) -> None:
        self._config = config
        self._random = random.Random(f"{config.seed}:gusts")
        self._gust_keep = math.exp(-dt_s / config.gust_tau_s)
        self._gust_kick = config.gust_sigma_m_s * math.sqrt(1.0 - self._gust_keep**2)
        self._gust_n = self._gust_e = 0.0
        self.gusty = self._gust_kick > 0.0  # whether there is anything to step
        self._steady_n, self._steady_e = config.wind_north_m_s, config.wind_east_m_s
        self.wind_n, self.wind_e = self._steady_n, self._steady_e
        self._beacon_n, self._beacon_e, self._beacon_s = config.beacon_north_m, config.beacon_east_m, 0.0

    def step(self) -> None:
        """Carry the gusts (a first-order process in each axis) over one step."""
        gauss = self._random.gauss
        self._gust_n = self._gust_n * self._gust_keep + self._gust_kick * gauss(0.0, 1.0)
        self._gust_e = self._gust_e * self._gust_keep + self._gust_kick * gauss(0.0, 1.0)
        self.wind_n = self._steady_n + self._gust_n
        self.wind_e = self._steady_e + self._gust_e

    def set_wind(self, east_m_s: float, north_m_s: float) -> None:
        """Change the steady wind; gusts go on around it."""
        self._steady_n, self._steady_e = north_m_s, east_m_s
        self.wind_n, self.wind_e = north_m_s + self._gust_n, east_m_s + self._gust_e

    def put_beacon(self, east_m: float, north_m: float, t_s: float) -> None:
        """Put the beacon somewhere else; it moves on from there."""
        self._beacon_n, self._beacon_e, self._beacon_s = north_m, east_m, t_s

    def beacon(self, t_s: float) -> tuple[float, float, float]:
        """Return the beacon's north, east, height [m]."""
        c, moved_s = self._config, t_s - self._beacon_s
        north, east = self._beacon_n + c.beacon_north_m_s * moved_s, self._beacon_e + c.beacon_east_m_s * moved_s
        return north, east, c.beacon_height_m

    def range_and_rate(self, t_s: float, v: Mover) -> tuple[float, float]:
        """Return slant range [m] and its rate [m/s, + opening] for a vehicle that moves."""
        n, e, h = self.beacon(t_s)
        c = self._config
        dn, de, dh = v.n - n, v.e - e, v.h - h
        distance = math.sqrt(dn * dn + de * de + dh * dh)
        along = dn * (v.vn - c.beacon_north_m_s) + de * (v.ve - c.beacon_east_m_s) + dh * v.vu
        return distance, along / distance if distance > 0.0 else 0.0


def lat_lon_deg(north_m: float, east_m: float) -> tuple[float, float]:
    """Return latitude and longitude of a place in the world (flat around the origin)."""
    return HOME_LAT_DEG + north_m / _M_PER_DEG_LAT, HOME_LON_DEG + east_m / _M_PER_DEG_LON


def north_east_m(lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Return the place [m] of a latitude and longitude: the inverse of lat_lon_deg."""
    return (lat_deg - HOME_LAT_DEG) * _M_PER_DEG_LAT, (lon_deg - HOME_LON_DEG) * _M_PER_DEG_LON
