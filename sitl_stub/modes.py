"""PX4's flight modes as they show on the wire (PX4.md, section 1)."""

from __future__ import annotations

import enum

ARMED = 128
CUSTOM = 1


class Mode(enum.IntEnum):
    """A flight mode; the value is HEARTBEAT.custom_mode."""

    MANUAL = 0x00010000
    ALTCTL = 0x00020000
    POSCTL = 0x00030000
    TAKEOFF = 0x02040000
    HOLD = 0x03040000
    MISSION = 0x04040000
    RTL = 0x05040000
    LAND = 0x06040000
    ACRO = 0x00050000
    OFFBOARD = 0x00060000
    STABILIZED = 0x00070000
    TERMINATION = 0x000A0000


# mode -> (name as people write it, HEARTBEAT.base_mode without the armed bit, AVAILABLE_MODES name)
_TABLE: dict[Mode, tuple[str, int, str]] = {
    Mode.MANUAL: ("MANUAL", 0x51, "Manual"),
    Mode.ALTCTL: ("ALTCTL", 0x51, "Altitude"),
    Mode.POSCTL: ("POSCTL", 0x51, "Position"),
    Mode.TAKEOFF: ("AUTO/TAKEOFF", 0x1D, "Takeoff"),
    Mode.HOLD: ("AUTO/LOITER", 0x1D, "Hold"),
    Mode.MISSION: ("AUTO/MISSION", 0x1D, "Mission"),
    Mode.RTL: ("AUTO/RTL", 0x1D, "Return"),
    Mode.LAND: ("AUTO/LAND", 0x1D, "Land"),
    Mode.ACRO: ("ACRO", 0x41, "Acro"),
    Mode.OFFBOARD: ("OFFBOARD", 0x11, "Offboard"),
    Mode.STABILIZED: ("STABILIZED", 0x51, "Stabilized"),
    Mode.TERMINATION: ("TERMINATION", 0x01, "Termination"),
}

# Modes that a pilot flies with sticks: refused without them.
STICK_MODES = frozenset({Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED})
# Modes that need a position estimate.
POSITION_MODES = frozenset({Mode.POSCTL, Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND})

# Modes that steer by themselves.
AUTO_MODES = frozenset({Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND})

# COM_OBL_RC_ACT -> the mode that the loss of offboard leads to (7 disarms).
OFFBOARD_LOSS_MODE = {
    0: Mode.POSCTL,
    1: Mode.ALTCTL,
    2: Mode.STABILIZED,
    3: Mode.RTL,
    4: Mode.LAND,
    5: Mode.HOLD,
    6: Mode.TERMINATION,
}
OFFBOARD_LOSS_DISARM = 7


def name_of(mode: Mode) -> str:
    """Return the mode's name as PX4's console and the captures write it."""
    return _TABLE[mode][0]


def title_of(mode: Mode) -> str:
    """Return the mode's name for people."""
    return _TABLE[mode][2]


def base_mode_of(mode: Mode, armed: bool, body_rates: bool = False) -> int:
    """Return HEARTBEAT.base_mode; `body_rates`: offboard on body rates drops the STABILIZE bit (16)."""
    base = _TABLE[mode][1] | (ARMED if armed else 0)
    return base & ~16 if body_rates and mode is Mode.OFFBOARD else base


def mode_of(main: int, sub: int) -> Mode | None:
    """Return the mode of PX4's main and sub mode numbers (DO_SET_MODE p2, p3), None if there is no such mode."""
    word = (sub << 24) | (main << 16)
    if main == 4 and sub == 0:
        return Mode.HOLD
    try:
        return Mode(word if main == 4 else main << 16)
    except ValueError:
        return None


def shown_modes() -> list[Mode]:
    """Return the modes that AVAILABLE_MODES lists."""
    return [mode for mode in Mode if mode is not Mode.TERMINATION]
