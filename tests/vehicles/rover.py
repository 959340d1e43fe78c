"""A PX4 rover as it was measured (PX4.md, 6), small, on the stub's PX4: links, modes and failsafes are the stub's.

Measured were the controllers on a vehicle that stood: the direction of the velocity steers by rate = RO_YAW_P x angle,
the yaw rate asked for is ignored, a velocity backwards turns round and does not reverse, nothing but a trajectory
moves it, and no faster than RO_SPEED_LIM. How it follows is no measurement: front wheels that turn at their own pace
and to a stop, on a given wheel base, without slip, and a speed that lags.
"""

from __future__ import annotations

import math
from typing import Any

from sitl_stub import Stub
from sitl_stub.kinematics import wrap
from sitl_stub.modes import Mode
from sitl_stub.multirotor_pilot import MultirotorPilot
from sitl_stub.offboard import Trajectory

GROUND_ROVER = 10
RO_YAW_P, RO_SPEED_LIM_M_S = 3.0, 3.0
WHEEL_BASE_M, MOST_STEER_RAD, STEER_RAD_S = 0.32, 0.55, 2.0
SPEED_TAU_S = 0.5


class RoverPilot(MultirotorPilot):
    """Drives the stub's vehicle over the ground by what the setpoint asks for in OFFBOARD; stands in any other mode."""

    speed = steer = 0.0
    asked: tuple[float, float] = (0.0, 0.0)
    """Speed [m/s] and yaw rate [rad/s, + clockwise] that the controllers ask of motor and wheels."""

    @property
    def pushing(self) -> bool:
        """PX4's land detector takes an armed rover for one that flies."""
        return self.commander.armed

    def step(self, now_s: float, wind_n: float, wind_e: float) -> None:
        v, setpoint = self.vehicle, self.setpoint
        drives = self.commander.armed and self.commander.mode is Mode.OFFBOARD
        self.asked = (0.0, 0.0)
        if drives and isinstance(setpoint, Trajectory):
            self.asked = controllers(setpoint.vn, setpoint.ve, v.yaw)
        speed, yaw_rate = self.asked
        self.speed += (speed - self.speed) * v.dt_s / SPEED_TAU_S
        wheels = math.atan(yaw_rate * WHEEL_BASE_M / max(self.speed, 0.3))
        wheels = max(-MOST_STEER_RAD, min(MOST_STEER_RAD, wheels))
        self.steer += max(-STEER_RAD_S * v.dt_s, min(STEER_RAD_S * v.dt_s, wheels - self.steer))
        v.yaw_rate = self.speed * math.tan(self.steer) / WHEEL_BASE_M
        v.yaw = wrap(v.yaw + v.yaw_rate * v.dt_s)
        v.vn, v.ve, v.vu = self.speed * math.cos(v.yaw), self.speed * math.sin(v.yaw), 0.0
        v.n, v.e = v.n + v.vn * v.dt_s, v.e + v.ve * v.dt_s


def controllers(vn: float, ve: float, yaw: float) -> tuple[float, float]:
    """Return the speed and the yaw rate [+ clockwise] that PX4's rover asks for, of a velocity over the ground."""
    if not math.isfinite(vn + ve) or math.hypot(vn, ve) < 1e-3:
        return 0.0, 0.0
    return min(math.hypot(vn, ve), RO_SPEED_LIM_M_S), RO_YAW_P * wrap(math.atan2(ve, vn) - yaw)


def make_rover(stub: Stub) -> RoverPilot:
    """Turn a stub that stands on the ground into a rover, ready to be armed; it is not disarmed for standing."""
    autopilot: Any = stub.autopilot
    autopilot.mav_type = GROUND_ROVER
    autopilot.params.set("COM_DISARM_PRFLT", -1.0)
    autopilot.params.set("COM_DISARM_LAND", -1.0)
    autopilot.pilot = RoverPilot(autopilot.vehicle, autopilot.commander, autopilot.params, stub.config.seed, 0.0)
    return autopilot.pilot
