"""Where the estimate puts the target: for the map, the record and the ground station. Pure."""

from __future__ import annotations

from math import cos, degrees, hypot, isfinite, nan, radians, remainder, sqrt
from typing import NamedTuple

from circumnav_mav.guidance.kernel import Estimate

EARTH_RADIUS_M = 6371000.0
POLAR, DRIFT = 3, 7
"""Lengths of the estimators' covariances: (rr, r theta, theta theta) and (rr, xx, xy, yy, uu, vv, ss)."""


class Target(NamedTuple):
    """The target beside the vehicle. NaN where the estimator cannot tell."""

    east_m: float = nan
    north_m: float = nan
    sigma_m: float = nan  # root of the sum of both variances
    drift_east_m_s: float = nan  # wind minus the target's own velocity
    drift_north_m_s: float = nan
    drift_sigma_m_s: float = nan  # root of the sum of both variances

    @property
    def known(self) -> bool:
        """Whether there is a place to show."""
        return isfinite(self.east_m) and isfinite(self.north_m)


def locate(estimate: Estimate | None, covariance: tuple[float, ...], spread_m: float, age_s: float) -> Target:
    """Return the target of an estimate with its uncertainty.

    covariance: of the estimator that made it, as of its last range; spread_m: how far its other hypotheses lie from
    the one flown on; age_s: how old that range is. A drift that is not known exactly blurs the place as long as no
    range comes.
    """
    if estimate is None or not (isfinite(estimate.px) and isfinite(estimate.py)):
        return Target()
    sigma = drift_sigma = nan
    if len(covariance) == DRIFT:
        drift_sigma = _root(covariance[4] + covariance[5])
        sigma = hypot(_root(covariance[1] + covariance[3]), spread_m, drift_sigma * max(0.0, age_s))
    elif len(covariance) == POLAR:
        sigma = hypot(_root(covariance[0] + estimate.r**2 * covariance[2]), spread_m)
    return Target(estimate.px, estimate.py, sigma, estimate.wx, estimate.wy, drift_sigma)


def _root(variance: float) -> float:
    """Return the standard deviation; NaN stays NaN, and what rounding brings below 0 is 0."""
    return 0.0 if variance < 0.0 else sqrt(variance)


def latitude_longitude(lat_deg: float, lon_deg: float, target: Target) -> tuple[float, float]:
    """Return the target's latitude and longitude [deg] from the vehicle's (flat Earth: good to a metre at 10 km).

    The longitude is within [-180, 180), also where the date line lies between the two.
    """
    lat = lat_deg + degrees(target.north_m / EARTH_RADIUS_M)
    lon = lon_deg + degrees(target.east_m / (EARTH_RADIUS_M * cos(radians(lat_deg))))
    lon = remainder(lon, 360.0)  # exact, unlike %, which rounds what is just below -180 to 180
    return lat, -180.0 if lon == 180.0 else lon


def describe(target: Target, place: tuple[float, float] | None) -> str:
    """Return where the target is, for people; empty while that is not known."""
    if not target.known:
        return ""
    words = f"{target.east_m:+.0f} m east, {target.north_m:+.0f} m north"
    if isfinite(target.sigma_m):
        words += f" ± {target.sigma_m:.1f} m"
    return words if place is None else f"{words} ({place[0]:.6f}, {place[1]:.6f})"


def describe_drift(target: Target) -> str:
    """Return the drift, for people; empty while it is not known."""
    if not (isfinite(target.drift_east_m_s) and isfinite(target.drift_north_m_s)):
        return ""
    words = f"{target.drift_east_m_s:+.1f} m/s east, {target.drift_north_m_s:+.1f} m/s north"
    return f"{words} ± {target.drift_sigma_m_s:.1f} m/s" if isfinite(target.drift_sigma_m_s) else words
