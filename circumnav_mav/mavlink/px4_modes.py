"""PX4's custom_mode word: (sub << 24) | (main << 16), as measured on v1.16 (HEARTBEAT and CURRENT_MODE)."""

from __future__ import annotations

from circumnav_mav.mavlink.modes import ModeWords

OFFBOARD = 0x00060000
HOLD = 0x03040000
RETURN = 0x05040000
LAND = 0x06040000
TAKEOFF = 0x02040000

_NAMES = {
    0x00010000: "Manual",
    0x00020000: "Altitude",
    0x00030000: "Position",
    0x00050000: "Acro",
    OFFBOARD: "Offboard",
    0x00070000: "Stabilized",
    0x000A0000: "Termination",
    0x01040000: "Ready",
    TAKEOFF: "Takeoff",
    HOLD: "Hold",
    0x04040000: "Mission",
    RETURN: "Return",
    LAND: "Land",
    0x08040000: "Follow me",
    0x09040000: "Precision land",
}


def main_and_sub(custom_mode: int) -> tuple[int, int]:
    """Return the two numbers that MAV_CMD_DO_SET_MODE takes as param2 and param3."""
    return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF


WORDS = ModeWords(
    autopilot="PX4",
    ours=OFFBOARD,
    hold=HOLD,
    return_=RETURN,
    land=LAND,
    names=_NAMES,  # QGroundControl's
    split=main_and_sub,
    stream_first=True,
    leaves_when_silent=True,
    tells_intention=True,
    loss_timeout_s=1.0,
    loss_parameter="COM_OF_LOSS_T",
    parameters=("COM_OF_LOSS_T",),
)
name = WORDS.name
