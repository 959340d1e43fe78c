"""ArduPilot's custom_mode: a plain number, other ones on a copter than on a plane (measured on 4.6.3)."""

from __future__ import annotations

from circumnav_mav.mavlink.modes import ModeWords

COPTER_STABILIZE, COPTER_GUIDED, COPTER_LOITER, COPTER_RTL, COPTER_LAND, COPTER_BRAKE = 0, 4, 5, 6, 9, 17
PLANE_MANUAL, PLANE_RTL, PLANE_LOITER, PLANE_TAKEOFF, PLANE_GUIDED = 0, 11, 12, 13, 15


def plain(custom_mode: int) -> tuple[int, int]:
    """Return param2 and param3 of MAV_CMD_DO_SET_MODE."""
    return custom_mode, 0


COPTER = ModeWords(
    autopilot="ArduCopter",
    ours=COPTER_GUIDED,
    # Not Loiter: it follows the throttle stick, and a companion's copter may have none, or one that is down.
    hold=COPTER_BRAKE,
    return_=COPTER_RTL,
    land=COPTER_LAND,
    names={
        0: "Stabilize", 1: "Acro", 2: "Alt Hold", 3: "Auto", 4: "Guided", 5: "Loiter", 6: "RTL", 7: "Circle", 9: "Land",
        16: "PosHold", 17: "Brake", 20: "Guided NoGPS", 21: "Smart RTL",
    },
    split=plain,
    stream_first=False,
    leaves_when_silent=False,
    tells_intention=False,
    loss_timeout_s=3.0,
    loss_parameter="GUID_TIMEOUT",
    parameters=("GUID_TIMEOUT",),
)  # fmt: skip

PLANE = ModeWords(
    autopilot="ArduPlane",
    ours=PLANE_GUIDED,
    hold=PLANE_LOITER,
    return_=PLANE_RTL,
    land=None,  # a plane lands by a mission
    names={
        0: "Manual", 1: "Circle", 2: "Stabilize", 5: "FBWA", 6: "FBWB", 7: "Cruise", 10: "Auto", 11: "RTL",
        12: "Loiter", 13: "Takeoff", 15: "Guided", 16: "Initialising",
    },
    split=plain,
    stream_first=False,
    leaves_when_silent=False,
    tells_intention=False,
    loss_timeout_s=3.0,  # fixed in ArduPlane
    loss_parameter="",
    parameters=("TKOFF_ALT",),
)  # fmt: skip
