"""The target on the map."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.guidance.target import EARTH_RADIUS_M, Target, latitude_longitude

DEGREE_M = EARTH_RADIUS_M * 3.141592653589793 / 180.0


@pytest.mark.parametrize(
    ("lon_deg", "east_deg", "wanted_deg"),
    [
        (8.5, 0.01, 8.51),
        (-0.005, 0.01, 0.005),
        (179.995, 0.01, -179.995),
        (-179.995, -0.01, 179.995),
        (180.0, 0.0, -180.0),
        (-180.0, 0.0, -180.0),
        (179.99, 0.01, -180.0),
        (math.nextafter(-180.0, -math.inf), 0.0, 180.0),
    ],
)
def test_the_longitude_goes_on_across_the_date_line(lon_deg, east_deg, wanted_deg):
    """At 60 degrees north a degree of longitude is half as long as at the equator."""
    place = latitude_longitude(60.0, lon_deg, Target(0.5 * east_deg * DEGREE_M, 0.001 * DEGREE_M))
    assert -180.0 <= place[1] < 180.0
    assert (place[1] - wanted_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
    assert place[0] == pytest.approx(60.001, abs=1e-9)
