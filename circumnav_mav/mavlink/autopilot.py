"""The autopilot as its messages show it: mode, motion, height. Nobody else is believed.

The autopilot is the sender with component id 1 whose HEARTBEAT names an autopilot: the first one, or the one with the
system id that is configured. Everything is filtered on its system id from then on, so that a ground station's forwarded
heartbeat (custom_mode 0) never makes the mode flicker.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, nan, pi, sin
from typing import Any, NamedTuple

from circumnav_mav.mavlink.codec import Message
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.height import Height
from circumnav_mav.mavlink.order import Order

AUTOPILOT_COMPONENT = 1
ARMED = 0x80
STATUS_STANDBY = 3
STATUS_CRITICAL = 5
SILENT_AFTER_S = 3.5
"""HEARTBEAT comes at 1 Hz, CURRENT_MODE at 2 Hz: without either for so long, the autopilot counts as not heard."""
REBOOT_JUMP_MS = 5000
"""A boot clock that goes back by more than any reordering could means that the autopilot has restarted."""
BATTERY_LOW = range(2, 7)
"""MAV_BATTERY_CHARGE_STATE: LOW, CRITICAL, EMERGENCY, FAILED, UNHEALTHY."""
MODE_MESSAGES = ("HEARTBEAT", "CURRENT_MODE")
SPEED_TIME_CONSTANT_S = 1.0
"""Low-pass on the ground speed: short beside a lap, long beside the velocity loop's noise."""
VELOCITY_FLAG, POSITION_FLAGS, STANDS_STILL_FLAG = 0x02, 0x08 | 0x10, 0x80
"""Of ESTIMATOR_STATUS (PX4) and EKF_STATUS_REPORT (ArduPilot): horizontal velocity, horizontal position, and that the
estimator assumes to stand still because nothing aids it: its velocity is then no velocity."""


class VehicleState(NamedTuple):
    """What an encoder may know of the vehicle at one tick; NaN = not heard lately. MAVLink's signs throughout."""

    roll_rad: float = nan  # + right wing down
    pitch_rad: float = nan  # + nose up
    yaw_rad: float = nan  # clockwise from north
    yaw_rate_rad_s: float = nan  # of the heading, + clockwise
    height_m: float = nan  # above home
    climb_m_s: float = nan
    airspeed_m_s: float = nan  # true airspeed
    throttle: float = nan  # 0..1
    speed_m_s: float = nan  # over the ground, low-passed
    course_rad: float = nan  # of the ground track, clockwise from north
    north_m: float = nan  # in the autopilot's local frame
    east_m: float = nan
    down_m: float = nan
    in_air: bool = False  # armed, off the ground, and done with taking off


class Autopilot:
    """Newest known state. Every value carries the time at which it was heard; NaN and None mean never.

    only: the system id of the one to believe; None = the first that is heard.
    """

    def __init__(self, only: int | None = None) -> None:
        self.sysid: int | None = None
        self.only = only
        self.kind = 0  # MAV_AUTOPILOT
        self.vehicle_type = 0  # MAV_TYPE
        self.heartbeat_s = nan
        self.mode_s = nan
        """When the mode was last shown, by HEARTBEAT or CURRENT_MODE."""
        self.custom_mode: int | None = None
        self.intended_mode: int | None = None
        self.armed = False
        self.system_status = 0
        self.in_air: bool | None = None
        self.aloft = False
        """In the air, and done with taking off."""
        self.attitude_s = nan
        self.roll_rad = self.pitch_rad = self.yaw_rad = self.yaw_rate_rad_s = nan
        """MAVLink's own signs: yaw clockwise from north; the rate is the heading's, + clockwise."""
        self.velocity_s = nan
        self.velocity = (nan, nan)
        """North and east [m/s], as it came."""
        self.speed_m_s = nan
        """Ground speed, low-passed."""
        self.climb_m_s = self.climb_s = nan
        self.place = (nan, nan, nan)
        """North, east, down [m] in the autopilot's local frame."""
        self.course_rad = nan
        self.height = Height()
        self.height_m = nan
        """Above home, by the autopilot."""
        self.amsl_m = nan
        self.lat_deg = self.lon_deg = self.position_s = nan
        self.hud_s = nan
        self.airspeed_m_s = nan
        """True airspeed: MAVLink's is calibrated, corrected here for the thinner air (ISA)."""
        self.throttle = nan
        self.estimator_flags: int | None = None
        self.heard_s: dict[str, float] = {}
        """When each message was last heard."""
        self.battery_pct = self.battery_v = nan
        self._batteries_low: dict[int, bool] = {}
        self.sensors: tuple[int, int, int] | None = None
        """MAV_SYS_STATUS_SENSOR present, enabled, healthy."""
        self.reboots = 0
        self.strangers: set[int] = set()
        """System ids of other autopilots on the link: heard and not believed."""
        self._boot_ms = 0
        self._order, self._mode_place = Order(), 0
        self._handlers: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._heartbeat,
            "CURRENT_MODE": self._current_mode,
            "ATTITUDE": self._attitude,
            "LOCAL_POSITION_NED": self._local_position,
            "GLOBAL_POSITION_INT": self._global_position,
            "VFR_HUD": self._vfr_hud,
            "EXTENDED_SYS_STATE": self._extended_state,
            "ESTIMATOR_STATUS": self._estimator,
            "EKF_STATUS_REPORT": self._estimator,
            "SYS_STATUS": self._sys_status,
            "BATTERY_STATUS": self._battery_status,
        }

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that this class wants decoded."""
        return tuple(self._handlers)

    def heard(self, now_s: float) -> bool:
        """Return whether the autopilot is there: its mode was shown within the last `SILENT_AFTER_S`."""
        return now_s - self.mode_s <= SILENT_AFTER_S

    def on_message(self, message: Message, now_s: float) -> bool:
        """Take in a message; return whether it came from the autopilot."""
        name, sysid, compid, seq, fields = message
        if compid != AUTOPILOT_COMPONENT or (sysid != self.sysid and not self._found(message)):
            return False
        if name == "HEARTBEAT" and fields.autopilot == enums.MAV_AUTOPILOT_INVALID:
            return False  # another program under the autopilot's ids: its mode is nobody's
        handler = self._handlers.get(name)
        if handler is None:
            return True
        place = self._order.place(seq, now_s)
        if not (name in MODE_MESSAGES and self._overtaken(place)):
            handler(fields, now_s)
            self.heard_s[name] = now_s
        return True

    def _overtaken(self, place: int) -> bool:
        """Whether a mode message was sent before the newest one: a late old mode must not look like a new choice."""
        if place < self._mode_place:
            return True
        self._mode_place = place
        return False

    def _found(self, message: Message) -> bool:
        if message.name != "HEARTBEAT" or message.fields.autopilot == enums.MAV_AUTOPILOT_INVALID:
            return False
        if self.sysid is None and self.only in (None, message.sysid):
            self.sysid = message.sysid
            self.strangers.discard(message.sysid)
            return True
        self.strangers.add(message.sysid)
        return False

    def _heartbeat(self, fields: Any, now_s: float) -> None:
        self.kind, self.vehicle_type = fields.autopilot, fields.type
        self.armed = bool(fields.base_mode & ARMED)
        if fields.custom_mode != self.custom_mode:
            self.intended_mode = None  # what CURRENT_MODE said belongs to the mode before
        self.custom_mode = fields.custom_mode
        self.system_status = fields.system_status
        self.heartbeat_s = self.mode_s = now_s

    def _current_mode(self, fields: Any, now_s: float) -> None:
        self.custom_mode = fields.custom_mode
        # 0 is MAVLink's "not supplied".
        self.intended_mode = fields.intended_custom_mode or None
        self.mode_s = now_s

    def _attitude(self, fields: Any, now_s: float) -> None:
        if not sane(fields.roll, fields.pitch, fields.yaw, fields.rollspeed, fields.pitchspeed, fields.yawspeed):
            return
        if fields.time_boot_ms < self._boot_ms - REBOOT_JUMP_MS:
            self.reboots += 1
            self._boot_ms = fields.time_boot_ms
        self._boot_ms = max(self._boot_ms, fields.time_boot_ms)
        self.roll_rad, self.pitch_rad, self.yaw_rad = fields.roll, fields.pitch, fields.yaw
        # The three speeds are the body's: in a bank of 42 degrees the heading turns by a third more than yawspeed says.
        about = fields.pitchspeed * sin(fields.roll) + fields.yawspeed * cos(fields.roll)
        self.yaw_rate_rad_s = about / max(0.1, cos(fields.pitch))
        self.attitude_s = now_s

    def _local_position(self, fields: Any, now_s: float) -> None:
        if not sane(fields.x, fields.y, fields.z, fields.vx, fields.vy, fields.vz):
            return
        self.velocity = (fields.vx, fields.vy)
        speed = hypot(fields.vx, fields.vy)
        elapsed = now_s - self.velocity_s
        if elapsed < SPEED_TIME_CONSTANT_S:
            self.speed_m_s += (speed - self.speed_m_s) * max(0.0, elapsed) / SPEED_TIME_CONSTANT_S
        else:  # the first one, or one after a long silence (NaN compares false)
            self.speed_m_s = speed
        if speed > 0.0:
            self.course_rad = atan2(fields.vy, fields.vx)
        self.climb_m_s = -fields.vz
        self.velocity_s = self.climb_s = now_s
        self.place = (fields.x, fields.y, fields.z)
        self.height.take("LOCAL_POSITION_NED", -fields.z, now_s, on_ground=not self.armed)

    def _global_position(self, fields: Any, now_s: float) -> None:
        self.lat_deg, self.lon_deg = fields.lat / 1e7, fields.lon / 1e7
        self.position_s = now_s
        self.height_m = fields.relative_alt / 1000.0
        self.amsl_m = fields.alt / 1000.0
        self.height.take("GLOBAL_POSITION_INT", self.height_m, now_s, on_ground=not self.armed)

    def _vfr_hud(self, fields: Any, now_s: float) -> None:
        if not sane(fields.alt, fields.climb):
            return
        # NaN from a plane without the sensor: the rest of the message counts all the same.
        self.airspeed_m_s = fields.airspeed * true_per_calibrated(fields.alt) if sane(fields.airspeed) else nan
        self.throttle = fields.throttle / 100.0
        self.height.take("VFR_HUD", fields.alt, now_s, on_ground=not self.armed)
        if not now_s - self.climb_s < 1.0 or self.climb_s == self.hud_s:  # no better one
            self.climb_m_s, self.climb_s = fields.climb, now_s
        self.hud_s = now_s

    def _estimator(self, fields: Any, now_s: float) -> None:
        self.estimator_flags = fields.flags

    def estimates(self, what: str) -> bool:
        """Return whether the autopilot has an estimate of its "velocity" or "position"; true while it does not say."""
        flags = self.estimator_flags
        if flags is None:
            return True
        position = bool(flags & POSITION_FLAGS)
        if what == "position":
            return position
        # PX4 shows the last flag on the ground with GPS, too: only without a position is the velocity made up.
        return bool(flags & VELOCITY_FLAG) and (position or not flags & STANDS_STILL_FLAG)

    def _extended_state(self, fields: Any, now_s: float) -> None:
        self.aloft = fields.landed_state == enums.MAV_LANDED_STATE_IN_AIR
        if fields.landed_state != enums.MAV_LANDED_STATE_UNDEFINED:
            self.in_air = fields.landed_state != enums.MAV_LANDED_STATE_ON_GROUND

    def _sys_status(self, fields: Any, now_s: float) -> None:
        self.battery_pct = float(fields.battery_remaining) if fields.battery_remaining >= 0 else nan
        self.battery_v = fields.voltage_battery / 1000.0 if fields.voltage_battery != 0xFFFF else nan
        self.sensors = (
            fields.onboard_control_sensors_present,
            fields.onboard_control_sensors_enabled,
            fields.onboard_control_sensors_health,
        )

    def _battery_status(self, fields: Any, now_s: float) -> None:
        self._batteries_low[fields.id] = fields.charge_state in BATTERY_LOW

    @property
    def battery_alarm(self) -> bool:
        """Whether the autopilot itself calls a battery low (or worse)."""
        return any(self._batteries_low.values())

    def turn_rate_rad_s(self, now_s: float, within_s: float = 0.5) -> float:
        """Return the measured turn rate, + counter-clockwise; NaN where none was heard for `within_s`."""
        return -self.yaw_rate_rad_s if now_s - self.attitude_s <= within_s else nan

    def heading_rad(self, now_s: float, within_s: float = 0.5) -> float:
        """Return the heading, counter-clockwise from east; NaN where none was heard for `within_s`."""
        return pi / 2 - self.yaw_rad if now_s - self.attitude_s <= within_s else nan

    def height_above_home_m(self, now_s: float, within_s: float = 2.0) -> float:
        """Return the height; NaN where none was heard for `within_s`."""
        return self.height.at(now_s, within_s)

    def true_airspeed_m_s(self, now_s: float, within_s: float = 1.0) -> float:
        """Return the true airspeed; NaN where none was heard for `within_s`."""
        return self.airspeed_m_s if now_s - self.hud_s <= within_s else nan

    def ground_speed_m_s(self, now_s: float, within_s: float = 1.0) -> float:
        """Return the low-passed ground speed; NaN where none was heard for `within_s`."""
        return self.speed_m_s if now_s - self.velocity_s <= within_s else nan

    def body_velocity_m_s(self, now_s: float, within_s: float = 0.5) -> tuple[float, float]:
        """Return the velocity over the ground ahead and to the left, as it came; NaN where it or the heading is older.

        While a multirotor gathers way or turns hard it is neither the low-passed speed nor straight ahead.
        """
        if not (now_s - self.velocity_s <= within_s and now_s - self.attitude_s <= within_s):
            return nan, nan
        north, east = self.velocity
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return north * c + east * s, north * s - east * c

    def state(self, now_s: float) -> VehicleState:
        """Return what an encoder may know at `now_s`."""
        attitude, local = now_s - self.attitude_s <= 0.5, now_s - self.velocity_s <= 1.0
        north, east, down = self.place if local else (nan, nan, nan)
        return VehicleState(
            self.roll_rad if attitude else nan,
            self.pitch_rad if attitude else nan,
            self.yaw_rad if attitude else nan,
            self.yaw_rate_rad_s if attitude else nan,
            self.height_above_home_m(now_s),
            self.climb_m_s if now_s - self.climb_s <= 1.0 else nan,
            self.true_airspeed_m_s(now_s),
            self.throttle if now_s - self.hud_s <= 1.0 else nan,
            self.ground_speed_m_s(now_s),
            self.course_rad if local else nan,
            north,
            east,
            down,
            self.armed and self.aloft,
        )


def sane(*values: float) -> bool:
    """Return whether no value is NaN, infinite or beyond anything that flies: such a message counts as not heard."""
    return all(abs(value) < 1e6 for value in values)


def true_per_calibrated(amsl_m: float) -> float:
    """Return true / calibrated airspeed in the ISA standard atmosphere, below 11 km."""
    return float((1.0 - 2.25577e-5 * min(max(amsl_m, 0.0), 11000.0)) ** -2.12794) if amsl_m == amsl_m else 1.0
