"""How PX4's simulated airplane (SIH 10041) moves: attitude loops as lags and a small longitudinal model.

The airplane is draggy and its motor weak, as measured (PX4.md, 5): 12 m/s takes thrust 0.835 at pitch -1 deg, all of it
gives 13.6 m/s at -2 deg, and at 25-30 deg of pitch it climbs with 4.8 m/s at 10 m/s. The four numbers below solve these
three states. Lift acts along the angle of attack until the stall, turns are coordinated (no sideslip), and the roll
loop is a first-order lag (StubConfig.roll_lag_s), 0.165 s: measured, 63 % after 0.16-0.22 s, 90 % after 0.37-0.41 s, no
overshoot.

Axes as in kinematics.py. Airspeed V [m/s], flight path angle gamma [rad, up], both relative to the air.
"""

from __future__ import annotations

import math

from sitl_stub.kinematics import BODY_RATE_MAX, G, angle_rates, wrap

LIFT_PER_RAD = 0.8642  # lift acceleration / (V^2 (alpha + ALPHA_0)), 1/m/rad
ALPHA_0 = math.radians(5.515)  # angle of attack without lift is -ALPHA_0
PARASITE = 0.0733  # drag acceleration / V^2, 1/m
INDUCED = 369.0 / G**2  # drag acceleration V^2 / lift^2
THRUST = 15.7  # acceleration of full thrust, m/s2
ALPHA_STALL = math.radians(14.0)
PITCH_TAU_S, MOTOR_TAU_S = 0.25, 0.15
STALL_LIFT_SHARE = 0.7  # of the greatest lift that is left beyond the stall
ROLL_WHEN_STALLED = math.radians(25.0)  # a wing drops
LEAST_AIRSPEED = 1.0


class FixedWing:
    """Place, velocity and attitude of an airplane. The public fields are those of Multirotor."""

    def __init__(
        self, dt_s: float, north_m: float, east_m: float, height_m: float, yaw_rad: float, roll_lag_s: float
    ) -> None:
        self.dt_s = dt_s
        self._roll_keep = math.exp(-dt_s / roll_lag_s)
        self._pitch_keep = math.exp(-dt_s / PITCH_TAU_S)
        self._motor_keep = math.exp(-dt_s / MOTOR_TAU_S)
        self.n, self.e, self.h = north_m, east_m, height_m
        self.vn = self.ve = self.vu = 0.0
        self.yaw, self.yaw_rate = yaw_rad, 0.0
        self.roll = self.pitch = self.roll_rate = self.pitch_rate = 0.0
        self.thrust = 0.0
        self.airspeed, self.gamma = 0.0, 0.0
        self.stalled = False

    def set_moving(self, airspeed_m_s: float, wind_n: float, wind_e: float) -> None:
        """Start in steady level flight."""
        self.airspeed = airspeed_m_s
        self.pitch = level_alpha(airspeed_m_s)
        self.thrust = min(1.0, level_drag(airspeed_m_s) / THRUST)
        self.vn = airspeed_m_s * math.cos(self.yaw) + wind_n
        self.ve = airspeed_m_s * math.sin(self.yaw) + wind_e

    def rest(self) -> None:
        """Stand on the ground."""
        self.vn = self.ve = self.vu = self.yaw_rate = self.roll_rate = self.pitch_rate = 0.0
        self.roll = self.pitch = self.thrust = self.airspeed = self.gamma = 0.0
        self.stalled = False

    def step_attitude(self, roll: float, pitch: float, thrust: float, wind_n: float, wind_e: float) -> None:
        """Fly a bank, a pitch [rad] and a thrust for one step; PX4 does not clamp the thrust, the motor ends at 1."""
        dt = self.dt_s
        new_roll = roll + (self.roll - roll) * self._roll_keep
        new_pitch = pitch + (self.pitch - pitch) * self._pitch_keep
        self.roll_rate, self.pitch_rate = (new_roll - self.roll) / dt, (new_pitch - self.pitch) / dt
        self.roll, self.pitch = new_roll, new_pitch
        self._fly(thrust, wind_n, wind_e)

    def step_rates(
        self, roll_rate: float, pitch_rate: float, yaw_rate: float, thrust: float, wind_n: float, wind_e: float
    ) -> None:
        """Fly body rates [rad/s] and thrust; the heading turns as the bank turns it."""
        p = min(max(roll_rate, -BODY_RATE_MAX), BODY_RATE_MAX)
        q = min(max(pitch_rate, -BODY_RATE_MAX), BODY_RATE_MAX)
        r = min(max(yaw_rate, -BODY_RATE_MAX), BODY_RATE_MAX)
        self.roll_rate, self.pitch_rate, _ = angle_rates(self.roll, self.pitch, p, q, r)
        self.roll = wrap(self.roll + self.roll_rate * self.dt_s)
        self.pitch = max(-1.5, min(1.5, self.pitch + self.pitch_rate * self.dt_s))
        self._fly(thrust, wind_n, wind_e)

    def _fly(self, thrust: float, wind_n: float, wind_e: float) -> None:
        dt = self.dt_s
        self.thrust = thrust + (self.thrust - thrust) * self._motor_keep
        v = max(self.airspeed, LEAST_AIRSPEED)
        alpha = self.pitch - self.gamma
        self.stalled = alpha > ALPHA_STALL and self.h > 0.0
        if self.stalled:  # the tail has no authority left: the nose falls, a wing drops
            self.pitch = max(self.pitch - 1.5 * dt, self.gamma + ALPHA_STALL)
            self.roll += ROLL_WHEN_STALLED * dt
            alpha = self.pitch - self.gamma
            lift = LIFT_PER_RAD * v * v * (ALPHA_STALL + ALPHA_0) * STALL_LIFT_SHARE
        else:
            lift = LIFT_PER_RAD * v * v * (alpha + ALPHA_0)
        drag = PARASITE * v * v + INDUCED * lift * lift / (v * v)
        push = min(max(self.thrust, 0.0), 1.0) * THRUST
        if self.h <= 0.0 and lift * math.cos(self.roll) + push * math.sin(max(0.0, self.pitch)) < G:
            self._roll_along(push, v, wind_n, wind_e)
            return
        cos_gamma = math.cos(self.gamma)
        self.airspeed = max(0.0, self.airspeed + (push * math.cos(alpha) - drag - G * math.sin(self.gamma)) * dt)
        turning = (lift + push * math.sin(alpha)) * math.sin(self.roll) / (v * max(0.1, cos_gamma))
        self.gamma += ((lift + push * math.sin(alpha)) * math.cos(self.roll) - G * cos_gamma) / v * dt
        self.gamma = max(-1.5, min(1.5, self.gamma))
        self.yaw_rate = turning
        self.yaw = wrap(self.yaw + turning * dt)
        self._move(wind_n, wind_e)

    def _roll_along(self, push: float, v: float, wind_n: float, wind_e: float) -> None:
        braking = 2.0 if push == 0.0 else 0.2
        self.airspeed = max(0.0, self.airspeed + (push - PARASITE * v * v - braking) * self.dt_s)
        self.roll = self.roll_rate = self.gamma = self.yaw_rate = 0.0
        if self.airspeed == 0.0:
            self.rest()
            return
        self._move(0.0, 0.0)

    def _move(self, wind_n: float, wind_e: float) -> None:
        flat = self.airspeed * math.cos(self.gamma)
        vn, ve = flat * math.cos(self.yaw) + wind_n, flat * math.sin(self.yaw) + wind_e
        vu = self.airspeed * math.sin(self.gamma)
        half = 0.5 * self.dt_s
        self.n += half * (self.vn + vn)
        self.e += half * (self.ve + ve)
        self.h += half * (self.vu + vu)
        self.vn, self.ve, self.vu = vn, ve, vu
        if self.h <= 0.0 and self.vu <= 0.0:
            hard = self.vu < -3.0  # nothing is left of an airplane that comes down like this
            self.h = self.vu = self.gamma = 0.0
            if hard:
                self.rest()


def level_alpha(airspeed_m_s: float, load: float = 1.0) -> float:
    """Return the angle of attack [rad] that carries `load` times the weight."""
    v = max(airspeed_m_s, 5.0)
    return load * G / (LIFT_PER_RAD * v * v) - ALPHA_0


def level_drag(airspeed_m_s: float, load: float = 1.0) -> float:
    """Return the drag acceleration [m/s2] at `load` times the weight."""
    v = max(airspeed_m_s, 5.0)
    return PARASITE * v * v + INDUCED * (load * G) ** 2 / (v * v)
