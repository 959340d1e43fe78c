"""How a multirotor moves: PX4's velocity and yaw-rate loops as lags, with the figures measured on PX4 (PX4.md, 4).

Axes: north, east, up [m]; yaw [rad] clockwise from north, as in MAVLink. A vehicle keeps the rates of its angles;
`body_rates` makes of them what MAVLink shows. Steps are exact for inputs that are constant
over a step.

The velocity loop is a second-order lag with damping 0.7 and 2.37 rad/s: a step reaches 50 / 63 / 90 % after 0.60 / 0.76
/ 1.15 s (measured 0.59 / 0.76 / 1.31) and the course runs 8.5 deg behind a nose that turns at 0.25 rad/s (measured
8.4), 17 deg at 0.5 (17), 28 deg at 0.8 (29). The yaw rate is one with 0.9 and 4.6 rad/s: 63 / 90 % after 0.46 / 0.76 s
(measured 0.41-0.5 / 0.7-0.8).
"""

from __future__ import annotations

import math
from typing import NamedTuple

G = 9.80665
VELOCITY_OMEGA, VELOCITY_ZETA = 2.37, 0.7
YAW_OMEGA, YAW_ZETA = 4.6, 0.9
YAW_RATE_GAIN = 0.978  # steady yaw rate flown / asked (0.25 -> 0.244, 1.5 -> 1.468)
CLIMB_TAU_S = 0.35
TILT_TAU_S = 0.12
YAW_RATE_MAX = math.radians(200.0)  # MC_YAWRATE_MAX
BODY_RATE_MAX = math.radians(220.0)  # MC_ROLLRATE_MAX, MC_PITCHRATE_MAX
AIRFRAME_MAX_M_S = 20.0  # what the airframe can do, whatever its parameters say
DRAG_PER_S = 0.15  # SIH_KDV / mass: what the air's pull gives of acceleration per m/s of airspeed
WIND_TAU_S = 2.5  # how fast the velocity loop's integrator takes up a change of wind


class SecondOrder(NamedTuple):
    """One exact step of x'' = omega^2 (target - x) - 2 zeta omega x', for zeta < 1."""

    xx: float
    xd: float
    dx: float
    dd: float

    @classmethod
    def of(cls, omega: float, zeta: float, dt_s: float) -> SecondOrder:
        """Return the transition over dt_s of (x - target, x')."""
        damped = omega * math.sqrt(1.0 - zeta * zeta)
        fade = math.exp(-zeta * omega * dt_s)
        c, s = math.cos(damped * dt_s), math.sin(damped * dt_s)
        ratio = zeta * omega / damped
        return cls(
            fade * (c + ratio * s), fade * s / damped, -fade * s * omega * omega / damped, fade * (c - ratio * s)
        )


def wrap(angle_rad: float) -> float:
    """Return the angle within [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def body_rates(
    roll: float, pitch: float, roll_rate: float, pitch_rate: float, yaw_rate: float
) -> tuple[float, float, float]:
    """Return p, q, r, what gyroscopes read, of an attitude [rad] and the rates of its angles [rad/s]."""
    cr, sr, cp = math.cos(roll), math.sin(roll), math.cos(pitch)
    return (
        roll_rate - math.sin(pitch) * yaw_rate,
        cr * pitch_rate + sr * cp * yaw_rate,
        cr * cp * yaw_rate - sr * pitch_rate,
    )


def angle_rates(roll: float, pitch: float, p: float, q: float, r: float) -> tuple[float, float, float]:
    """Return the rates of roll, pitch and yaw of body rates [rad/s]; held finite where the nose points straight up."""
    cr, sr, cp = math.cos(roll), math.sin(roll), math.cos(pitch)
    yaw_rate = (sr * q + cr * r) / (cp if abs(cp) > 0.1 else math.copysign(0.1, cp))
    return p + math.sin(pitch) * yaw_rate, cr * q - sr * r, yaw_rate


class Multirotor:
    """Place, velocity and attitude of a multirotor, moved by one of the `step` functions."""

    def __init__(self, dt_s: float, north_m: float, east_m: float, height_m: float, yaw_rad: float) -> None:
        self.dt_s = dt_s
        self._velocity_lag = SecondOrder.of(VELOCITY_OMEGA, VELOCITY_ZETA, dt_s)
        self._yaw_lag = SecondOrder.of(YAW_OMEGA, YAW_ZETA, dt_s)
        self._climb_keep = math.exp(-dt_s / CLIMB_TAU_S)
        self._tilt_keep = math.exp(-dt_s / TILT_TAU_S)
        self._wind_keep = math.exp(-dt_s / WIND_TAU_S)
        self.n, self.e, self.h = north_m, east_m, height_m
        self.vn = self.ve = self.vu = 0.0
        self.an = self.ae = 0.0  # acceleration
        self.yaw, self.yaw_rate, self._yaw_acc = yaw_rad, 0.0, 0.0
        self.roll = self.pitch = self.roll_rate = self.pitch_rate = 0.0
        self.thrust = 0.0
        self.hover_thrust = 0.489
        self._felt_n = self._felt_e = 0.0  # wind that the loop's integrator has taken up
        self.limit_tilt(45.0)

    def limit_tilt(self, most_deg: float) -> None:
        """Let `step_velocity` tilt no further than this [deg]."""
        self.tilt_max_deg = most_deg
        self._pull_max = G * math.tan(math.radians(min(max(most_deg, 0.0), 89.0)))

    def set_moving(self, speed_m_s: float, wind_n: float, wind_e: float) -> None:
        """Start in steady forward flight in a steady wind."""
        self.vn, self.ve = speed_m_s * math.cos(self.yaw), speed_m_s * math.sin(self.yaw)
        self._felt_n, self._felt_e = wind_n, wind_e
        self.thrust = self.hover_thrust

    def rest(self) -> None:
        """Stand on the ground."""
        self.vn = self.ve = self.vu = self.an = self.ae = 0.0
        self.roll = self.pitch = self.roll_rate = self.pitch_rate = self.yaw_rate = self._yaw_acc = 0.0
        self.thrust = 0.0

    def step_velocity(self, vn: float, ve: float, vu: float, yaw_rate: float, wind_n: float, wind_e: float) -> None:
        """Fly a velocity [m/s] (north, east, up) and yaw rate [rad/s] for one step; wind is only a disturbance."""
        dt = self.dt_s
        lag = self._velocity_lag
        keep = self._wind_keep
        self._felt_n = wind_n + (self._felt_n - wind_n) * keep
        self._felt_e = wind_e + (self._felt_e - wind_e) * keep
        old_n, old_e, old_u = self.vn, self.ve, self.vu
        off_n, off_e = old_n - vn, old_e - ve
        push_n, push_e = DRAG_PER_S * (wind_n - self._felt_n), DRAG_PER_S * (wind_e - self._felt_e)
        self.vn = vn + lag.xx * off_n + lag.xd * self.an + push_n * dt
        self.ve = ve + lag.xx * off_e + lag.xd * self.ae + push_e * dt
        self.an = lag.dx * off_n + lag.dd * self.an
        self.ae = lag.dx * off_e + lag.dd * self.ae
        # What the tilt has to give: acceleration and the pull of the air.
        pull_n, pull_e = self.an + DRAG_PER_S * (self.vn - wind_n), self.ae + DRAG_PER_S * (self.ve - wind_e)
        if pull_n * pull_n + pull_e * pull_e > self._pull_max * self._pull_max:  # it gives no more than its limit
            share, slow = self._pull_max / math.hypot(pull_n, pull_e), 1.0 + DRAG_PER_S * dt
            pull_n, pull_e = pull_n * share, pull_e * share
            self.an = (pull_n - DRAG_PER_S * (old_n + push_n * dt - wind_n)) / slow
            self.ae = (pull_e - DRAG_PER_S * (old_e + push_e * dt - wind_e)) / slow
            self.vn, self.ve = old_n + (self.an + push_n) * dt, old_e + (self.ae + push_e) * dt
        self.vu = vu + (old_u - vu) * self._climb_keep
        self._turn(yaw_rate)
        self._move(old_n, old_e, old_u)
        # Seen along the nose and to the right of it.
        cos_yaw, sin_yaw = math.cos(self.yaw), math.sin(self.yaw)
        pitch = -math.atan2(pull_n * cos_yaw + pull_e * sin_yaw, G)
        roll = math.atan2(pull_e * cos_yaw - pull_n * sin_yaw, G)
        self.roll_rate, self.pitch_rate = (roll - self.roll) / dt, (pitch - self.pitch) / dt
        self.roll, self.pitch = roll, pitch
        self.thrust = self.hover_thrust

    def step_attitude(
        self, roll: float, pitch: float, yaw_rate: float, thrust: float, wind_n: float, wind_e: float
    ) -> None:
        """Fly a tilt [rad], a yaw rate and a thrust (0..1; hover_thrust carries it): it drifts with the wind."""
        keep, dt = self._tilt_keep, self.dt_s
        new_roll = roll + (self.roll - roll) * keep
        new_pitch = pitch + (self.pitch - pitch) * keep
        self.roll_rate, self.pitch_rate = (new_roll - self.roll) / dt, (new_pitch - self.pitch) / dt
        self.roll, self.pitch, self.thrust = new_roll, new_pitch, thrust
        self._turn(yaw_rate)
        self._ballistic(wind_n, wind_e)

    def step_rates(
        self, roll_rate: float, pitch_rate: float, yaw_rate: float, thrust: float, wind_n: float, wind_e: float
    ) -> None:
        """Fly body rates [rad/s] and thrust: nothing levels the vehicle."""
        p = min(max(roll_rate, -BODY_RATE_MAX), BODY_RATE_MAX)
        q = min(max(pitch_rate, -BODY_RATE_MAX), BODY_RATE_MAX)
        r = min(max(yaw_rate, -YAW_RATE_MAX), YAW_RATE_MAX)
        self.roll_rate, self.pitch_rate, yaw_rate = angle_rates(self.roll, self.pitch, p, q, r)
        self.roll = wrap(self.roll + self.roll_rate * self.dt_s)
        self.pitch = wrap(self.pitch + self.pitch_rate * self.dt_s)
        self.thrust = thrust
        self._turn(yaw_rate)
        self._ballistic(wind_n, wind_e)

    def step_drift(self, sink_m_s: float, tau_s: float, wind_n: float, wind_e: float) -> None:
        """Drift on, levelled, slowing down with tau_s, sinking: what PX4 does in POSCTL without sticks."""
        old_n, old_e, old_u = self.vn, self.ve, self.vu
        keep = math.exp(-self.dt_s / tau_s)
        self.vn, self.ve = wind_n + (old_n - wind_n) * keep, wind_e + (old_e - wind_e) * keep
        self.an = self.ae = 0.0
        self.vu = -sink_m_s + (old_u + sink_m_s) * self._climb_keep
        self._felt_n, self._felt_e = wind_n, wind_e
        level = self._tilt_keep
        self.roll, self.pitch = self.roll * level, self.pitch * level
        self._turn(0.0)
        self._move(old_n, old_e, old_u)

    def yaw_rate_to(self, yaw_rad: float, feed_forward: float, gain_per_s: float) -> float:
        """Return the yaw rate of PX4's yaw loop towards a yaw angle."""
        rate = gain_per_s * wrap(yaw_rad - self.yaw) + feed_forward
        return min(max(rate, -YAW_RATE_MAX), YAW_RATE_MAX)

    def _ballistic(self, wind_n: float, wind_e: float) -> None:
        dt = self.dt_s
        lift = G * max(0.0, self.thrust) / self.hover_thrust
        cos_roll, sin_roll = math.cos(self.roll), math.sin(self.roll)
        cos_pitch, sin_pitch = math.cos(self.pitch), math.sin(self.pitch)
        forward, right = -sin_pitch * cos_roll * lift, sin_roll * lift
        cos_yaw, sin_yaw = math.cos(self.yaw), math.sin(self.yaw)
        old_n, old_e, old_u = self.vn, self.ve, self.vu
        self.an = forward * cos_yaw - right * sin_yaw - DRAG_PER_S * (old_n - wind_n)
        self.ae = forward * sin_yaw + right * cos_yaw - DRAG_PER_S * (old_e - wind_e)
        self.vn, self.ve = old_n + self.an * dt, old_e + self.ae * dt
        self.vu = old_u + (cos_roll * cos_pitch * lift - G - DRAG_PER_S * old_u) * dt
        self._felt_n, self._felt_e = wind_n, wind_e
        self._move(old_n, old_e, old_u)

    def _turn(self, yaw_rate: float) -> None:
        if not -YAW_RATE_MAX <= yaw_rate <= YAW_RATE_MAX:
            yaw_rate = math.copysign(YAW_RATE_MAX, yaw_rate)
        lag = self._yaw_lag
        off = self.yaw_rate - yaw_rate
        before = self.yaw_rate
        self.yaw_rate = yaw_rate + lag.xx * off + lag.xd * self._yaw_acc
        self._yaw_acc = lag.dx * off + lag.dd * self._yaw_acc
        self.yaw = wrap(self.yaw + 0.5 * (before + self.yaw_rate) * self.dt_s)

    def _move(self, old_n: float, old_e: float, old_u: float) -> None:
        half = 0.5 * self.dt_s
        self.n += half * (old_n + self.vn)
        self.e += half * (old_e + self.ve)
        self.h += half * (old_u + self.vu)
        if self.h <= 0.0 and self.vu <= 0.0:
            self.h = 0.0
            self.rest()
