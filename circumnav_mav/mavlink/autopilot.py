"""The autopilot as its messages show it: mode, motion, height. Nobody else is believed.

The autopilot is the sender with component id 1 whose HEARTBEAT names an autopilot; everything is filtered on its system
id from then on, so that a ground station's forwarded heartbeat (custom_mode 0) never makes the mode flicker.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, nan, pi
from typing import Any

from circumnav_mav.mavlink.codec import Message
from circumnav_mav.mavlink.dialect import enums

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
OVERTAKEN_WITHIN_S = 0.6
"""Sequence numbers go round every 256 frames (0.6 s at PX4's 400 msg/s): older comparisons mean nothing."""
SPEED_TIME_CONSTANT_S = 1.0
"""Low-pass on the ground speed: short beside a lap, long beside the velocity loop's noise."""


class Autopilot:
    """Newest known state. Every value carries the time at which it was heard; NaN and None mean never."""

    def __init__(self) -> None:
        self.sysid: int | None = None
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
        self.attitude_s = nan
        self.roll_rad = self.pitch_rad = self.yaw_rad = self.yaw_rate_rad_s = nan
        """MAVLink's own signs: yaw clockwise from north, yaw rate + clockwise."""
        self.velocity_s = nan
        self.speed_m_s = nan
        """Ground speed, low-passed."""
        self.climb_m_s = nan
        self.height_s = nan
        self.height_m = nan
        """Above home, by the autopilot."""
        self.amsl_m = nan
        self.airspeed_s = nan
        self.airspeed_m_s = nan
        self.battery_pct = self.battery_v = nan
        self.battery_alarm = False
        """Whether the autopilot itself calls the battery low (or worse)."""
        self.estimator_flags: int | None = None
        """ESTIMATOR_STATUS_FLAGS, None where the autopilot does not send them."""
        self.sensors: tuple[int, int, int] | None = None
        """MAV_SYS_STATUS_SENSOR present, enabled, healthy."""
        self.reboots = 0
        self.strangers: set[int] = set()
        """System ids of other autopilots on the link: heard and not believed."""
        self._boot_ms = 0
        self._mode_seq = 0
        self._handlers: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._heartbeat,
            "CURRENT_MODE": self._current_mode,
            "ATTITUDE": self._attitude,
            "LOCAL_POSITION_NED": self._local_position,
            "GLOBAL_POSITION_INT": self._global_position,
            "VFR_HUD": self._vfr_hud,
            "EXTENDED_SYS_STATE": self._extended_state,
            "SYS_STATUS": self._sys_status,
            "BATTERY_STATUS": self._battery_status,
            "ESTIMATOR_STATUS": self._estimator_status,
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
        handler = self._handlers.get(name)
        if handler is not None and not (name in MODE_MESSAGES and self._overtaken(seq, now_s)):
            handler(fields, now_s)
        return True

    def _overtaken(self, seq: int, now_s: float) -> bool:
        """Whether a mode message was sent before the newest one: a late old mode must not look like a new choice."""
        if now_s - self.mode_s < OVERTAKEN_WITHIN_S and (seq - self._mode_seq) & 0xFF >= 0x80:
            return True
        self._mode_seq = seq
        return False

    def _found(self, message: Message) -> bool:
        if message.name != "HEARTBEAT" or message.fields.autopilot == enums.MAV_AUTOPILOT_INVALID:
            return False
        if self.sysid is None:
            self.sysid = message.sysid
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
        if fields.time_boot_ms < self._boot_ms - REBOOT_JUMP_MS:
            self.reboots += 1
            self._boot_ms = fields.time_boot_ms
        self._boot_ms = max(self._boot_ms, fields.time_boot_ms)
        self.roll_rad, self.pitch_rad, self.yaw_rad = fields.roll, fields.pitch, fields.yaw
        self.yaw_rate_rad_s = fields.yawspeed
        self.attitude_s = now_s

    def _local_position(self, fields: Any, now_s: float) -> None:
        speed = hypot(fields.vx, fields.vy)
        elapsed = now_s - self.velocity_s
        if elapsed < SPEED_TIME_CONSTANT_S:
            self.speed_m_s += (speed - self.speed_m_s) * max(0.0, elapsed) / SPEED_TIME_CONSTANT_S
        else:  # the first one, or one after a long silence (NaN compares false)
            self.speed_m_s = speed
        self.climb_m_s = -fields.vz
        self.velocity_s = now_s

    def _global_position(self, fields: Any, now_s: float) -> None:
        self.height_m = fields.relative_alt / 1000.0
        self.amsl_m = fields.alt / 1000.0
        self.height_s = now_s

    def _vfr_hud(self, fields: Any, now_s: float) -> None:
        self.airspeed_m_s = fields.airspeed
        self.airspeed_s = now_s

    def _extended_state(self, fields: Any, now_s: float) -> None:
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
        self.battery_alarm = fields.charge_state in BATTERY_LOW

    def _estimator_status(self, fields: Any, now_s: float) -> None:
        self.estimator_flags = fields.flags

    def turn_rate_rad_s(self, now_s: float, within_s: float = 0.5) -> float:
        """Return the measured turn rate, + counter-clockwise; NaN where none was heard for `within_s`."""
        return -self.yaw_rate_rad_s if now_s - self.attitude_s <= within_s else nan

    def heading_rad(self, now_s: float, within_s: float = 0.5) -> float:
        """Return the heading, counter-clockwise from east; NaN where none was heard for `within_s`."""
        return pi / 2 - self.yaw_rad if now_s - self.attitude_s <= within_s else nan

    def height_above_home_m(self, now_s: float, within_s: float = 2.0) -> float:
        """Return the height; NaN where none was heard for `within_s`."""
        return self.height_m if now_s - self.height_s <= within_s else nan
