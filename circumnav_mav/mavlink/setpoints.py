"""Setpoint messages, and the one place where the sign of the turn rate is flipped. Vehicle classes are in vehicles/.

A setpoint that is not finite or past its limits is a bug upstream: it raises, the app stops, the autopilot sees
silence. PX4 checks neither ranges nor NaN of an attitude setpoint (a NaN thrust stops the motors), so this does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isfinite, pi, sin
from typing import Any

from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.types import TurnRateSetpoint

G_M_S2 = 9.80665
VELOCITY_AND_YAW_RATE = 1479
"""SET_POSITION_TARGET_LOCAL_NED: use vx, vy, vz and yaw_rate. PX4 and ArduPilot take all three velocities or none."""
CURVED_PATH = 3072
"""SET_POSITION_TARGET_LOCAL_NED: use position, velocity and acceleration; ignore yaw and yaw rate."""
ATTITUDE_AND_THRUST = 7
"""SET_ATTITUDE_TARGET: use q and thrust, ignore the three body rates."""
ATTITUDE_YAW_RATE_AND_THRUST = 3
"""SET_ATTITUDE_TARGET: use q, body_yaw_rate and thrust."""
ROLL_ALONE = 254
"""SET_ATTITUDE_TARGET as ArduPlane wants it for roll alone: everything ignored but the roll rate, roll from q."""
MOST_TILT_RAD = pi / 3
"""No attitude past this leaves, whatever is configured: PX4's failure detector acts at 60 degrees."""
ROUNDING = 1e-9

Fields = dict[str, Any]
Encoded = tuple[str, Fields]
"""A message's name and its fields without the target ids."""


@dataclass(frozen=True, slots=True)
class SetpointLimits:
    """What may never be passed on the wire."""

    turn_rate_rad_s: float
    speed_m_s: float
    climb_m_s: float = 1.0
    """Vertical speed of the height loop; inside PX4's MPC_Z_VEL_MAX_DN 1.5 and _UP 3."""


class SetpointError(RuntimeError):
    """A setpoint that must not leave the app."""


def yaw_rate_rad_s(turn_rate_rad_s: float) -> float:
    """Return MAVLink's yaw rate (+ clockwise from above) for a turn rate (+ counter-clockwise)."""
    return -turn_rate_rad_s


def checked(setpoint: TurnRateSetpoint, limits: SetpointLimits) -> TurnRateSetpoint:
    """Return the setpoint as it is. Raises SetpointError where it is not finite or not within the limits."""
    if not (isfinite(setpoint.turn_rate_rad_s) and isfinite(setpoint.speed_m_s)):
        raise SetpointError(f"a setpoint that is not finite must not be sent: {setpoint}")
    if abs(setpoint.turn_rate_rad_s) > limits.turn_rate_rad_s + ROUNDING:
        raise SetpointError(
            f"turn rate {setpoint.turn_rate_rad_s:.3f} rad/s is past {limits.turn_rate_rad_s:.3f} rad/s"
        )
    if not 0.0 <= setpoint.speed_m_s <= limits.speed_m_s + ROUNDING:
        raise SetpointError(f"speed {setpoint.speed_m_s:.2f} m/s is past {limits.speed_m_s:.2f} m/s")
    return setpoint


def position_target(t_s: float, frame: int, type_mask: int, **used: float) -> Encoded:
    """Return SET_POSITION_TARGET_LOCAL_NED with the fields `used`, the others 0. Raises SetpointError for a NaN."""
    fields: Fields = {"time_boot_ms": boot_ms(t_s), "coordinate_frame": frame, "type_mask": type_mask}
    fields |= dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    fields |= used
    if not all(isfinite(value) for value in used.values()):
        raise SetpointError(f"a setpoint that is not finite must not be sent: {used}")
    return "SET_POSITION_TARGET_LOCAL_NED", fields


def body_velocity(t_s: float, forward_m_s: float, right_m_s: float, down_m_s: float, yaw_rate: float) -> Encoded:
    """Return a velocity along the present heading and a yaw rate (BODY_NED, mask 1479)."""
    frame = enums.MAV_FRAME_BODY_NED
    return position_target(
        t_s, frame, VELOCITY_AND_YAW_RATE, vx=forward_m_s, vy=right_m_s, vz=down_m_s, yaw_rate=yaw_rate
    )


def attitude(
    t_s: float,
    type_mask: int,
    *,
    roll_rad: float,
    pitch_rad: float,
    yaw_rad: float,
    thrust: float,
    yaw_rate_rad_s: float = 0.0,
) -> Encoded:
    """Return SET_ATTITUDE_TARGET. Raises SetpointError where anything is not finite or out of its range."""
    if not all(isfinite(v) for v in (roll_rad, pitch_rad, yaw_rad, thrust, yaw_rate_rad_s)):
        raise SetpointError(
            f"an attitude that is not finite must not be sent: roll {roll_rad}, pitch {pitch_rad}, yaw {yaw_rad}, "
            f"thrust {thrust}, yaw rate {yaw_rate_rad_s}"
        )
    if abs(roll_rad) > MOST_TILT_RAD or abs(pitch_rad) > MOST_TILT_RAD:
        raise SetpointError(f"roll {roll_rad:.3f} or pitch {pitch_rad:.3f} rad is past {MOST_TILT_RAD:.3f} rad")
    if not 0.0 <= thrust <= 1.0:
        raise SetpointError(f"thrust {thrust:.3f} is not within 0..1")
    return "SET_ATTITUDE_TARGET", {
        "time_boot_ms": boot_ms(t_s),
        "type_mask": type_mask,
        "q": quaternion(roll_rad, pitch_rad, yaw_rad),
        "body_roll_rate": 0.0,
        "body_pitch_rate": 0.0,
        "body_yaw_rate": yaw_rate_rad_s,
        "thrust": thrust,
    }


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation by yaw, then pitch, then roll, as MAVLink has it."""
    cr, sr = cos(roll_rad / 2), sin(roll_rad / 2)
    cp, sp = cos(pitch_rad / 2), sin(pitch_rad / 2)
    cy, sy = cos(yaw_rad / 2), sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def boot_ms(t_s: float) -> int:
    """Return the time field of a setpoint; both autopilots ignore it."""
    return int(t_s * 1000) & 0xFFFFFFFF


def within(value: float, low: float, high: float) -> float:
    """Return the value, or the bound that it is past."""
    return max(low, min(high, value))
