"""What PX4 sends by itself: every stream's fields (PX4.md, section 1); rates.py says how often.

A builder takes the stub's autopilot and returns the fields in the order of the XML declaration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from math import floor
from typing import TYPE_CHECKING, Any

from sitl_stub.kinematics import G, wrap
from sitl_stub.modes import AUTO_MODES, Mode, base_mode_of
from sitl_stub.sensors import ZERO4
from sitl_stub.world import HOME_AMSL_M, lat_lon_deg, pressure_hpa

if TYPE_CHECKING:
    from sitl_stub.autopilot import Autopilot

NAN, UNKNOWN, HOME_AMSL_MM = math.nan, 0xFFFF, round(HOME_AMSL_M * 1e3)
HEARTBEAT, CURRENT_MODE = 0, 436
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
# Upper triangles of 6 x 6 matrices with something on the diagonal.
COVARIANCE = tuple(0.08 if i in (0, 6, 11, 15, 18, 20) else 0.0 for i in range(21))


def attitude(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    return a.boot_ms, v.roll, v.pitch, a.yaw_estimate(), *a.body_rates()


def attitude_quaternion(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    w, x, y, z = quaternion(v.roll, v.pitch, a.yaw_estimate())
    return a.boot_ms, w, x, y, z, *a.body_rates(), ZERO4


def local_position_ned(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    if not a.commander.position_ok:
        return a.boot_ms, 0.0, 0.0, a.origin_h - v.h, 0.0, 0.0, -v.vu
    return a.boot_ms, v.n - a.origin_n, v.e - a.origin_e, a.origin_h - v.h, v.vn, v.ve, -v.vu


def global_position_int(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    lat, lon = lat_lon_deg(v.n, v.e)
    heading = _round(math.degrees(a.yaw_estimate()) * 100.0) % 36000
    mm = floor(v.h * 1e3 + 0.5)
    return (
        a.boot_ms, floor(lat * 1e7 + 0.5), floor(lon * 1e7 + 0.5), mm + HOME_AMSL_MM, mm,
        _int16(v.vn * 100.0), _int16(v.ve * 100.0), _int16(-v.vu * 100.0), heading,
    )  # fmt: skip


def highres_imu(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    felt = (G * math.sin(v.pitch), -G * math.sin(v.roll), -G)
    field = (0.21 * math.cos(v.yaw), -0.21 * math.sin(v.yaw), 0.42)  # gauss
    pressure = pressure_hpa(v.h)
    rates = a.body_rates()
    return (a.boot_us, *felt, *rates, *field, pressure, 0.0, v.h + HOME_AMSL_M, 15.0, 63, 0)


def odometry(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    north, east, vn, ve = _horizontal(a)
    return (
        a.boot_us, 1, 1, north, east, a.origin_h - v.h, quaternion(v.roll, v.pitch, a.yaw_estimate()), vn, ve, -v.vu,
        *a.body_rates(), COVARIANCE, COVARIANCE, 0, 8, 0,
    )  # fmt: skip


def timesync(a: Autopilot) -> tuple[Any, ...]:
    return 0, a.boot_us * 1000


def altitude(a: Autopilot) -> tuple[Any, ...]:
    h = a.vehicle.h
    return a.boot_us, h + HOME_AMSL_M, h + HOME_AMSL_M, h, h, 0.0, h


def distance_sensor_down(a: Autopilot) -> tuple[Any, ...]:
    """The range finder that looks down: a decoy for whoever takes any DISTANCE_SENSOR for a beacon."""
    return a.boot_ms, 0, 10000, min(_round(a.vehicle.h * 100.0), 65535), 0, 0, 25, 0, 0.0, 0.0, ZERO4, 0


def attitude_target(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    return a.boot_ms, 0, quaternion(v.roll, v.pitch, v.yaw), *a.body_rates(), _thrust(v.thrust)


def position_target_local_ned(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    north, east, vn, ve = _horizontal(a)
    return a.boot_ms, 1, 0, north, east, a.origin_h - v.h, vn, ve, -v.vu, 0.0, 0.0, 0.0, v.yaw, v.yaw_rate


def servo_output_raw(a: Autopilot) -> tuple[Any, ...]:
    output = 1000 + _round(1000.0 * min(max(_thrust(a.vehicle.thrust), 0.0), 1.0)) if a.commander.armed else 900
    return (a.boot_us & 0xFFFFFFFF, 0, *([output] * 4), *([900] * 12))


def vfr_hud(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    throttle = max(0, min(65535, _round(100.0 * _thrust(v.thrust))))
    heading = _round(math.degrees(a.yaw_estimate())) % 360
    speed = math.hypot(v.vn, v.ve) if a.commander.position_ok else 0.0
    return a.airspeed_estimate(), speed, heading, throttle, v.h + HOME_AMSL_M, v.vu


def gps_raw_int(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    if not a.commander.position_ok:
        return a.boot_us, 0, 0, 0, 0, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN, 255, 0, 0, 0, 0, 0, 0
    lat, lon = lat_lon_deg(v.n, v.e)
    alt = _round((v.h + HOME_AMSL_M) * 1e3)
    course = _round(math.degrees(math.atan2(v.ve, v.vn)) * 100.0) % 36000
    speed = _round(math.hypot(v.vn, v.ve) * 100.0)
    return (
        a.boot_us, 3, _round(lat * 1e7), _round(lon * 1e7), alt, 70, 110, speed, course, 10, alt, 900, 1780, 400, 0, 0,
    )  # fmt: skip


def extended_sys_state(a: Autopilot) -> tuple[Any, ...]:
    if a.commander.landed:
        return 0, ON_GROUND
    return 0, TAKING_OFF if a.commander.mode is Mode.TAKEOFF else LANDING if a.pilot.landing else IN_AIR


# As PX4 shows them: the pre-arm check is never "present", only healthy or not.
SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 0x0200402F, 0x0201402F, 0x1320C83F
GPS_SENSOR, AIRSPEED_SENSOR, PREARM_CHECK = 0x20, 0x10, 0x10000000


def sys_status(a: Autopilot) -> tuple[Any, ...]:
    healthy = SENSORS_HEALTHY if a.commander.position_ok else SENSORS_HEALTHY & ~GPS_SENSOR
    if not a.commander.checks_pass:
        healthy &= ~PREARM_CHECK
    airspeed = AIRSPEED_SENSOR if a.fixed_wing else 0
    return (
        SENSORS_PRESENT | airspeed,
        SENSORS_ENABLED | airspeed,
        healthy,
        96,
        16193,
        -100,
        100,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def heartbeat(a: Autopilot) -> tuple[Any, ...]:
    c = a.commander
    return a.mav_type, 12, base_mode_of(c.mode, c.armed, a.flies_body_rates()), int(c.mode), c.system_status, 3


def mission_current(a: Autopilot) -> tuple[Any, ...]:
    return 0, a.missions.total(), 0, 0


def estimator_status(a: Autopilot) -> tuple[Any, ...]:
    flags = 895 if a.commander.position_ok else 0b10100111
    return a.boot_us, flags, 0.2, 0.04, 0.02, 0.09, 0.002, NAN, 0.29, 0.29


def open_drone_id_location(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    lat, lon = lat_lon_deg(v.n, v.e)
    course = _round(math.degrees(math.atan2(v.ve, v.vn)) * 100.0) % 36000
    speed = min(_round(math.hypot(v.vn, v.ve) * 100.0), 25425)
    return (
        0, 0, bytes(20), 1 if a.commander.landed else 2, course, speed, _int16(v.vu * 100.0), _round(lat * 1e7),
        _round(lon * 1e7), v.h + HOME_AMSL_M, v.h + HOME_AMSL_M, 0, v.h, 12, 5, 5, 3, (a.boot_us / 1e6) % 3600.0, 1,
    )  # fmt: skip


def open_drone_id_system(a: Autopilot) -> tuple[Any, ...]:
    lat, lon = lat_lon_deg(a.origin_n, a.origin_e)
    place = (_round(lat * 1e7), _round(lon * 1e7))
    return 0, 0, bytes(20), 0, 0, *place, 1, 0, -1000.0, -1000.0, 0, 0, HOME_AMSL_M, a.boot_us // 1_000_000


def ping(a: Autopilot) -> tuple[Any, ...]:
    return a.boot_us, (a.boot_us // 1_000_000) & 0xFFFFFFFF, 0, 0


def scaled_pressure(a: Autopilot) -> tuple[Any, ...]:
    return a.boot_ms, pressure_hpa(a.vehicle.h), 0.0, 1500, 0


def system_time(a: Autopilot) -> tuple[Any, ...]:
    return a.unix_us(), a.boot_ms


def link_node_status(a: Autopilot) -> tuple[Any, ...]:
    return a.boot_us // 1000, 0, 24200, 0, 0, 0, 0, 0, 0, 0, 0


def battery_status(a: Autopilot) -> tuple[Any, ...]:
    cells = (15300, *([65535] * 9))
    return 0, 1, 1, 32767, cells, -100, 0, -1, 100, 0, 1, (0, 0, 0, 0), 0, 0


def current_mode(a: Autopilot) -> tuple[Any, ...]:
    return 0, int(a.commander.mode), int(a.commander.intention)


def home_position(a: Autopilot) -> tuple[Any, ...]:
    lat, lon = lat_lon_deg(a.home_n, a.home_e)
    place = (a.home_n - a.origin_n, a.home_e - a.origin_e, a.origin_h)
    fields = (_round(lat * 1e7), _round(lon * 1e7), _round(HOME_AMSL_M * 1e3), *place)
    return (*fields, quaternion(0.0, 0.0, a.home_yaw), 0.0, 0.0, 0.0, a.boot_us)


def vibration(a: Autopilot) -> tuple[Any, ...]:
    return a.boot_us, 0.0, 0.1, 1.4, 0, 0, 0


def time_estimate_to_target(a: Autopilot) -> tuple[Any, ...]:
    return -1, -1, -1, -1, -1


def current_event_sequence(a: Autopilot) -> tuple[Any, ...]:
    return 0, 0


def nav_controller_output(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    bearing = _round(math.degrees(v.yaw))
    return math.degrees(v.roll), math.degrees(v.pitch), bearing, bearing, 0, 0.0, 0.0, 0.0


def wind_cov(a: Autopilot) -> tuple[Any, ...]:
    return a.boot_us, a.wind_n, a.wind_e, 0.0, 0.1, 0.0, a.vehicle.h + HOME_AMSL_M, NAN, NAN


def position_target_global_int(a: Autopilot) -> tuple[Any, ...]:
    v = a.vehicle
    lat, lon = lat_lon_deg(v.n, v.e)
    place = (_round(lat * 1e7), _round(lon * 1e7), v.h + HOME_AMSL_M)
    return a.boot_ms, 5, 0, *place, v.vn, v.ve, -v.vu, 0.0, 0.0, 0.0, v.yaw, v.yaw_rate


def _has_position(a: Autopilot) -> bool:
    return a.commander.position_ok


def _flies_itself(a: Autopilot) -> bool:
    return a.commander.armed and a.commander.mode in AUTO_MODES


# Streams that PX4 sends only while there is something to tell.
CONDITIONS: dict[int, Callable[[Autopilot], bool]] = {
    33: _has_position,
    12901: _has_position,
    62: lambda a: a.commander.mode is not Mode.OFFBOARD,
    85: lambda a: not a.fixed_wing or not a.commander.armed or _flies_itself(a),
    87: lambda a: _flies_itself(a) and _has_position(a),
    231: lambda a: not a.commander.landed,
    242: lambda a: a.has_home,
}

BUILDERS: dict[int, Callable[[Autopilot], tuple[Any, ...]]] = {
    0: heartbeat, 1: sys_status, 2: system_time, 4: ping, 8: link_node_status, 24: gps_raw_int, 29: scaled_pressure,
    30: attitude, 31: attitude_quaternion, 32: local_position_ned, 33: global_position_int, 36: servo_output_raw,
    42: mission_current, 62: nav_controller_output, 74: vfr_hud, 83: attitude_target, 85: position_target_local_ned,
    87: position_target_global_int,
    105: highres_imu, 111: timesync, 132: distance_sensor_down, 141: altitude, 147: battery_status,
    230: estimator_status, 231: wind_cov, 241: vibration, 242: home_position, 245: extended_sys_state, 331: odometry,
    380: time_estimate_to_target, 411: current_event_sequence, 436: current_mode,
    12901: open_drone_id_location, 12904: open_drone_id_system,
}  # fmt: skip


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of the aerospace angles [rad]."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(wrap(yaw) / 2), math.sin(wrap(yaw) / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _horizontal(a: Autopilot) -> tuple[float, float, float, float]:
    """Return the local place and velocity [north, east], NaN without a position."""
    v = a.vehicle
    if not a.commander.position_ok:
        return NAN, NAN, NAN, NAN
    return v.n - a.origin_n, v.e - a.origin_e, v.vn, v.ve


def _thrust(thrust: float) -> float:
    return thrust if math.isfinite(thrust) else 0.0


def _int16(value: float) -> int:
    return floor(value + 0.5) if -32768.0 <= value < 32767.0 else -32768 if value < 0.0 else 32767


def _round(value: float) -> int:
    return floor(value + 0.5)  # a quarter of the price of round()
