"""The airspeed that is believed, against closed forms of a mass with linear drag."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.vehicles.believed import BelievedSpeed

G, V0, PITCH0 = 9.80665, 5.0, math.radians(-4.37)
DRAG_PER_S = G * math.tan(-PITCH0) / V0


def flown(pitch: float, roll: float, yaw_rate: float, for_s: float, believed: BelievedSpeed | None = None):
    believed = believed or BelievedSpeed(V0, PITCH0)
    state = VehicleState(roll_rad=roll, pitch_rad=pitch, yaw_rad=0.0, yaw_rate_rad_s=yaw_rate)
    for n in range(round(for_s / 0.02) + 1):
        believed.advance(100.0 + 0.02 * n, state)
    return believed


def test_it_gathers_speed_as_a_mass_with_drag_does_and_reaches_what_is_configured():
    for t_s in (2.0, 6.0, 20.0):
        assert flown(PITCH0, 0.0, 0.0, t_s).speed_m_s == pytest.approx(V0 * -math.expm1(-DRAG_PER_S * t_s), abs=0.02)
    assert flown(PITCH0, 0.0, 0.0, 90.0).speed_m_s == pytest.approx(V0, abs=1e-3)


def test_hovering_it_has_none():
    assert flown(0.0, 0.0, 0.3, 20.0).speed_m_s == 0.0


@pytest.mark.parametrize("yaw_rate", [0.1, -0.3])
def test_a_coordinated_turn_does_not_slip_and_another_does(yaw_rate):
    """Steady: V0 ahead, and the roll's pull is what the turn takes. Without roll it slides outwards."""
    there = flown(PITCH0, 0.0, 0.0, 90.0)
    roll = math.atan(V0 * yaw_rate / G)
    turning = flown(PITCH0, roll, yaw_rate, 30.0, there)
    assert turning.slip_rad == pytest.approx(0.0, abs=0.01)
    assert turning.speed_m_s == pytest.approx(V0, abs=0.05)
    level = flown(PITCH0, 0.0, yaw_rate, 60.0)
    assert math.copysign(1.0, level.slip_rad) == -math.copysign(1.0, yaw_rate)
    assert math.tan(level.slip_rad) == pytest.approx(-yaw_rate / DRAG_PER_S, rel=0.02)


def test_what_is_not_heard_changes_nothing():
    there = flown(PITCH0, 0.0, 0.0, 90.0)
    before = there.speed_m_s
    there.advance(300.0, VehicleState())
    assert there.speed_m_s == before


def test_on_the_ground_it_has_none_however_the_ground_slopes():
    believed = flown(PITCH0, 0.0, 0.0, 20.0)
    slope = VehicleState(roll_rad=0.1, pitch_rad=-0.1, yaw_rad=0.0, yaw_rate_rad_s=0.0)
    for n in range(100):
        believed.advance(200.0 + 0.02 * n, slope, on_ground=True)
    assert believed.speed_m_s == 0.0
