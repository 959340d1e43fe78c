"""The vehicle with its autopilot on simulated time: airframe, commander and pilot, and what streams need to know."""

from __future__ import annotations

import math

from sitl_stub.commander import Commander
from sitl_stub.config import StubConfig
from sitl_stub.fixed_wing import FixedWing
from sitl_stub.fixed_wing_pilot import FixedWingPilot
from sitl_stub.kinematics import Multirotor, body_rates, wrap
from sitl_stub.missions import Missions
from sitl_stub.multirotor_pilot import MultirotorPilot
from sitl_stub.offboard import RatesTarget, Setpoint, Trajectory
from sitl_stub.params import Parameters
from sitl_stub.world import calibrated_per_true

UNIX_START_S = 1_767_225_600  # SYSTEM_TIME at the start: flights in lockstep all begin on 2026-01-01
START_AIRSPEED_M_S = 12.0  # of an airplane that starts in the air
MAV_TYPE_FIXED_WING, MAV_TYPE_QUADROTOR = 1, 2


class Autopilot:
    """PX4's state. North, east, up in the world; the local frame begins at the place of booting."""

    def __init__(self, config: StubConfig, dt_s: float) -> None:
        self.config = config
        self._compass_errs = config.compass_error_rad != 0.0 or config.compass_wobble_rad != 0.0
        self.params = Parameters(config.airframe == "fixed_wing", config.params)
        self.fixed_wing = config.airframe == "fixed_wing"
        self.mav_type = MAV_TYPE_FIXED_WING if self.fixed_wing else MAV_TYPE_QUADROTOR
        self.now_s = 0.0
        self.boot_ms = self.boot_us = 0
        self._boot_s = self._clock_s = 0.0
        start_s = UNIX_START_S if config.unix_start_s is None else config.unix_start_s
        self._unix_start_us = self._unix_boot_us = round(start_s * 1e6)
        self.origin_n, self.origin_e = config.start_north_m, config.start_east_m
        self.home_n, self.home_e = self.origin_n, self.origin_e
        yaw = self.home_yaw = math.pi / 2 - config.start_heading_rad
        self.has_home = config.gps
        """Whether home is known: it takes a position, and then stays."""
        self.origin_h = config.local_z_error_m  # z reads this on the ground
        place = (self.origin_n, self.origin_e, config.start_height_m, yaw)
        self.commander = Commander(self.params, config.ready_after_s)
        self.commander.position_ok = config.gps
        self.commander.sticks_override = not self.fixed_wing
        self.vehicle: Multirotor | FixedWing
        self.pilot: MultirotorPilot | FixedWingPilot
        if self.fixed_wing:
            self.vehicle = FixedWing(dt_s, *place, config.roll_lag_s)
            self.pilot = FixedWingPilot(self.vehicle, self.commander, self.params, config.airspeed_scale)
        else:
            self.vehicle = Multirotor(dt_s, *place)
            self.vehicle.hover_thrust = float(self.params["MPC_THR_HOVER"])
            drift = config.height_drift_m_s
            self.pilot = MultirotorPilot(self.vehicle, self.commander, self.params, config.seed, drift)
        self.pilot.local_h = self.origin_h
        self.missions = Missions()
        if config.start_height_m > 0.0:
            self.commander.start_flying(0.0)
            speed = config.start_speed_m_s or (START_AIRSPEED_M_S if self.fixed_wing else 0.0)
            self.vehicle.set_moving(speed, config.wind_north_m_s, config.wind_east_m_s)
            self.pilot.begin_in_hold()
        self._was_armed = self.commander.armed
        self.wind_n, self.wind_e = config.wind_north_m_s, config.wind_east_m_s

    def step(self, now_s: float, wind_n: float, wind_e: float) -> None:
        """Carry everything to now_s."""
        self.now_s = now_s
        self.boot_us = max(0, round((now_s - self._boot_s + self._clock_s) * 1e6))
        self.boot_ms = self.boot_us // 1000 & 0xFFFFFFFF  # 32 bits on the wire: it wraps after 49.7 days
        self.wind_n, self.wind_e = wind_n, wind_e
        arms, self._was_armed = self.commander.armed and not self._was_armed, self.commander.armed
        if self.commander.position_ok and (arms or not self.has_home):
            self._set_home()
        self.commander.update(now_s, self.vehicle.h <= 0.0 and not self.pilot.pushing)
        if self._compass_errs and isinstance(self.pilot, MultirotorPilot):
            self.pilot.yaw_error_rad = self.yaw_estimate() - self.vehicle.yaw
        self.pilot.step(now_s, wind_n, wind_e)

    def boot(self, now_s: float) -> None:
        """Begin again where it is: time from zero, disarmed in Hold, a new local frame. Parameters stay as they are."""
        self._boot_s = now_s
        self._unix_boot_us = self._unix_start_us + round(now_s * 1e6)  # the time of day goes on
        self._clock_s = 0.0
        self.commander.boot(now_s + self.config.ready_after_s)
        self.origin_n, self.origin_e = self.pilot.local_n, self.pilot.local_e = self.vehicle.n, self.vehicle.e
        self.has_home = False

    def _set_home(self) -> None:
        """Return to here from now on, as PX4 does once it has a position after booting, and whenever it arms."""
        self.has_home = True
        self.home_n, self.home_e, self.home_yaw = self.vehicle.n, self.vehicle.e, self.yaw_estimate()
        self.pilot.set_home(self.home_n, self.home_e)

    def jump_clock(self, seconds: float) -> None:
        """Let the autopilot's time jump; it never goes below zero."""
        self._clock_s += seconds

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Fly this from now on (in OFFBOARD), and count it as stream."""
        self.pilot.take_setpoint(setpoint)
        needs_position = isinstance(setpoint, Trajectory) and (setpoint.has_position or setpoint.has_velocity)
        self.commander.setpoint_received(self.now_s, needs_position)

    def yaw_estimate(self) -> float:
        """Return the yaw that the autopilot believes [rad, clockwise from north]: the compass may be wrong."""
        c, yaw = self.config, self.vehicle.yaw
        if not self._compass_errs:
            return yaw
        return wrap(yaw + c.compass_error_rad + c.compass_wobble_rad * math.sin(yaw))

    def airspeed(self) -> float:
        """Return the true airspeed [m/s]."""
        v = self.vehicle
        return math.sqrt((v.vn - self.wind_n) ** 2 + (v.ve - self.wind_e) ** 2 + v.vu**2)

    def airspeed_estimate(self) -> float:
        """Return VFR_HUD.airspeed, which is calibrated airspeed; a multirotor has no sensor and reports 0."""
        if not isinstance(self.vehicle, FixedWing):
            return 0.0
        return self.vehicle.airspeed * self.config.airspeed_scale * calibrated_per_true(self.vehicle.h)

    def body_rates(self) -> tuple[float, float, float]:
        """Return what the gyroscopes read [rad/s]: about the nose, the right wing and downwards."""
        v = self.vehicle
        return body_rates(v.roll, v.pitch, v.roll_rate, v.pitch_rate, v.yaw_rate)

    def flies_body_rates(self) -> bool:
        """Whether OFFBOARD flies body rates (base_mode then loses its STABILIZE bit)."""
        return isinstance(self.pilot.setpoint, RatesTarget)

    def unix_us(self) -> int:
        """Return the autopilot's idea of the time of day [us]."""
        return self._unix_boot_us + self.boot_us
