"""What a setpoint of each vehicle class must look like on the wire, whatever happened before. Judged from the message.

The numbers are PX4's and ArduPilot's own, not the app's: frames and masks that they obey, what they do not check.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from circumnav_mav.config import Config

G_M_S2 = 9.80665
THROTTLE_IGNORE = 64
CLIMB_M_S = 1.0
PITCH_LOW_RAD, PITCH_HIGH_RAD = math.radians(-15.0), math.radians(20.0)
ROUNDING = 1e-4  # of 32-bit floats
Judge = Callable[[Any, Config], None]


def euler(q: Any) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] of a quaternion that is finite and of length 1."""
    w, x, y, z = q
    assert all(math.isfinite(v) for v in q), q
    assert abs(math.dist((0, 0, 0, 0), (w, x, y, z)) - 1.0) < ROUNDING, q
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def finite(m: Any, *names: str) -> None:
    assert all(math.isfinite(getattr(m, name)) for name in names), m


def body_velocity(m: Any, config: Config) -> None:
    """SET_POSITION_TARGET_LOCAL_NED in the body's axes: all three velocities and the yaw rate, nothing else."""
    assert m.get_type() == "SET_POSITION_TARGET_LOCAL_NED", m
    assert (m.coordinate_frame, m.type_mask) == (8, 1479), m
    # Also what is ignored: a NaN there is harmless to PX4 and an internal error to ArduPilot's next version.
    finite(m, "x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    assert math.hypot(m.vx, m.vy) <= config.orbit.speed_m_s + ROUNDING, m
    assert abs(m.vz) <= CLIMB_M_S + ROUNDING, m
    assert abs(m.yaw_rate) <= config.limits.turn_rate_rad_s + ROUNDING, m


def attitude(mask: int) -> Judge:
    """SET_ATTITUDE_TARGET with a real attitude and a real thrust: PX4 checks neither."""

    def judge(m: Any, config: Config) -> None:
        assert m.get_type() == "SET_ATTITUDE_TARGET", m
        assert m.type_mask == mask, m
        finite(m, "body_roll_rate", "body_pitch_rate", "body_yaw_rate", "thrust")
        roll, pitch, _ = euler(m.q)
        assert abs(roll) <= math.radians(config.limits.bank_deg) + ROUNDING, m
        assert PITCH_LOW_RAD - ROUNDING <= pitch <= PITCH_HIGH_RAD + ROUNDING, m
        assert abs(m.body_yaw_rate) <= config.limits.turn_rate_rad_s + ROUNDING, m
        assert 0.0 <= m.thrust <= 1.0, m

    return judge


def throttle_given(judge: Judge) -> Judge:
    """THROTTLE_IGNORE is thrust ZERO to PX4."""

    def both(m: Any, config: Config) -> None:
        assert not m.type_mask & THROTTLE_IGNORE, m
        judge(m, config)

    return both


def curved_path(m: Any, config: Config) -> None:
    """A path through the vehicle's own place: the acceleration across the velocity is the curve that it is to fly."""
    assert m.get_type() == "SET_POSITION_TARGET_LOCAL_NED", m
    assert (m.coordinate_frame, m.type_mask) == (1, 3072), m
    finite(m, "x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    assert (m.vz, m.afz) == (0.0, 0.0), m
    speed, across = math.hypot(m.vx, m.vy), math.hypot(m.afx, m.afy)
    assert 1.0 < speed < 60.0, m
    assert abs(m.vx * m.afx + m.vy * m.afy) <= ROUNDING * max(1.0, speed * across), m
    assert across <= G_M_S2 * math.tan(math.radians(config.limits.bank_deg)) + ROUNDING, m
    assert across / speed <= config.limits.turn_rate_rad_s + ROUNDING, m


JUDGES: dict[str, Judge] = {
    "px4_multirotor": body_velocity,
    "px4_multirotor_attitude": throttle_given(attitude(3)),
    "px4_fixed_wing": throttle_given(attitude(7)),
    "px4_fixed_wing_position": curved_path,
    "arducopter": body_velocity,
    "arduplane": attitude(254),
    "px4_rover": body_velocity,
}
"""By vehicle.class."""
