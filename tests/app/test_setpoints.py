"""The encoder: THE sign flip, the mask and frame that PX4 takes, and what must never leave."""

from __future__ import annotations

import math

import pytest

from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.setpoints import SetpointError, SetpointLimits
from circumnav_mav.mavlink.vehicles.plug import Options
from circumnav_mav.mavlink.vehicles.velocity import Velocity
from circumnav_mav.types import TurnRateSetpoint

LIMITS = SetpointLimits(turn_rate_rad_s=0.8, speed_m_s=5.0)


def encode(turn_rate: float, speed: float = 5.0, wanted_m: float = math.nan, height_m: float = math.nan, lead_s=0.6):
    options = Options(LIMITS, 5.0, 0.5, lead_s, math.nan, math.nan)
    setpoint = TurnRateSetpoint(1.0, turn_rate, speed, wanted_m)
    name, fields = Velocity(options).encode(setpoint, VehicleState(height_m=height_m), 1.0)
    assert name == "SET_POSITION_TARGET_LOCAL_NED"
    return fields


def test_a_left_turn_is_a_negative_yaw_rate():
    assert encode(+0.25)["yaw_rate"] == -0.25
    assert encode(-0.25)["yaw_rate"] == +0.25


def test_frame_and_mask_are_the_ones_that_px4_takes():
    fields = encode(0.1)
    assert fields["coordinate_frame"] == 8  # MAV_FRAME_BODY_NED
    assert fields["type_mask"] == 0b0000010111000111
    assert all(math.isfinite(v) for v in fields.values())


@pytest.mark.parametrize("turn_rate", [-0.8, -0.25, 0.0, 0.25])
def test_the_velocity_runs_ahead_of_the_nose_into_the_turn_at_full_speed(turn_rate):
    fields = encode(turn_rate)
    assert math.hypot(fields["vx"], fields["vy"]) == pytest.approx(5.0)
    # y is to the right: turning left (+), the velocity points left of the nose.
    assert math.atan2(fields["vy"], fields["vx"]) == pytest.approx(-0.6 * turn_rate)


def test_height_is_closed_through_the_vertical_speed_down_positive():
    assert encode(0.0, wanted_m=15.0, height_m=14.0)["vz"] == pytest.approx(-0.5)
    assert encode(0.0, wanted_m=15.0, height_m=40.0)["vz"] == LIMITS.climb_m_s
    assert encode(0.0, wanted_m=15.0)["vz"] == 0.0
    assert encode(0.0, height_m=15.0)["vz"] == 0.0


@pytest.mark.parametrize(
    ("turn_rate", "speed"),
    [(math.nan, 5.0), (math.inf, 5.0), (0.1, math.nan), (0.81, 5.0), (-0.81, 5.0), (0.1, 5.1), (0.1, -1.0)],
)
def test_what_is_not_finite_or_past_a_limit_raises_and_is_never_clamped(turn_rate, speed):
    with pytest.raises(SetpointError):
        encode(turn_rate, speed)
