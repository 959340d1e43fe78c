"""What the app asks an autopilot to send, and what it turns off. Settings are per link and lost at a reboot."""

from __future__ import annotations

from collections.abc import Collection

from circumnav_mav.mavlink.dialect import enums

WANTED_HZ: dict[str, float] = {
    # It follows the mode: 2 Hz and at once on every change, where HEARTBEAT comes at 1 Hz only.
    "CURRENT_MODE": 10.0,
    "ATTITUDE": 50.0,
    "LOCAL_POSITION_NED": 10.0,
    "GLOBAL_POSITION_INT": 5.0,
    "VFR_HUD": 5.0,
    "EXTENDED_SYS_STATE": 2.0,
    "SYS_STATUS": 1.0,
    "BATTERY_STATUS": 1.0,
    "ESTIMATOR_STATUS": 2.0,
}
"""Messages the app lives on with a PX4, by rate. A vehicle class changes and adds its own."""

ARDUPILOT_HZ: dict[str, float] = {
    # Its mode is in an extra HEARTBEAT on every change. A plane's loop runs at 50 Hz and refuses more than 40.
    "ATTITUDE": 25.0,
    "LOCAL_POSITION_NED": 10.0,
    "GLOBAL_POSITION_INT": 5.0,
    "VFR_HUD": 5.0,
    "EKF_STATUS_REPORT": 1.0,
    "EXTENDED_SYS_STATE": 2.0,
    "SYS_STATUS": 1.0,
    "BATTERY_STATUS": 0.5,
}
"""The same with an ArduPilot, which sends little or nothing by itself."""

RANGES_HZ = 20.0
"""Of an autopilot's own ranges, where they are flown on: one that waits for its turn is old."""

UNWANTED: tuple[str, ...] = (
    "ODOMETRY",
    "HIGHRES_IMU",
    "ATTITUDE_QUATERNION",
    "ALTITUDE",
    "ATTITUDE_TARGET",
    "POSITION_TARGET_LOCAL_NED",
    "SERVO_OUTPUT_RAW",
    "GPS_RAW_INT",
    "OPEN_DRONE_ID_LOCATION",
    "OPEN_DRONE_ID_SYSTEM",
    "SCALED_PRESSURE",
    "VIBRATION",
    "NAV_CONTROLLER_OUTPUT",
    "MISSION_CURRENT",
    "PING",
    # The autopilot's own: its range finder that looks down, and echoes of the radio's ranges. Not flown on unasked.
    "DISTANCE_SENSOR",
)
"""Default streams of PX4's onboard link that nothing here reads: three quarters of its 24 kB/s."""


def unwanted(autopilot: int, wanted: Collection[str]) -> list[str]:
    """Return the streams to turn off; an ArduPilot sends none of them and would complain of each in words."""
    return sorted(set(UNWANTED) - set(wanted)) if autopilot == enums.MAV_AUTOPILOT_PX4 else []


def interval_us(rate_hz: float) -> float:
    """Return param2 of MAV_CMD_SET_MESSAGE_INTERVAL; a rate of 0 turns the message off."""
    return 1e6 / rate_hz if rate_hz > 0 else -1.0
