"""Parameter -> what it will do, how grave that is, what mends it: one table an autopilot family.

As measured on PX4 v1.16 and ArduPilot 4.6. Several rows of one parameter: from top to bottom, the first that holds.
"""

from __future__ import annotations

from collections.abc import Callable

from circumnav_mav.settings_check import Facts, Row, Severity

OK, WARNING, ERROR = Severity.OK, Severity.WARNING, Severity.ERROR


def any_value(v: float, f: Facts) -> bool:
    return True


def is_(*values: float) -> Callable[[float, Facts], bool]:
    return lambda v, f: v in values


def bit(mask: int, *, rc: bool | None = None) -> Callable[[float, Facts], bool]:
    """Whether a bit of the parameter is set; rc: and whether sticks are there."""
    return lambda v, f: bool(int(v) & mask) and rc in (None, f.has_rc)


def below(least: Callable[[Facts], float]) -> Callable[[float, Facts], bool]:
    return lambda v, f: v < least(f)


SINKS = "set COM_OBL_RC_ACT to 5 (Hold), 3 (Return) or 4 (Land)"
OUT_OF_RANGE = "out of RC range nobody can take over by stick: clear bit 2 (4), or mean it"


def loss_action(value: int, without: Severity, with_rc: Severity, does: str) -> tuple[Row, Row]:
    """Two rows of COM_OBL_RC_ACT: sticks that somebody holds make some of them bearable."""
    text = "if this app dies: " + does
    return (
        Row("COM_OBL_RC_ACT", lambda v, f: v == value and not f.has_rc, without, text, SINKS if without else ""),
        Row("COM_OBL_RC_ACT", lambda v, f: v == value and f.has_rc, with_rc, text, SINKS if with_rc else ""),
    )


PX4: tuple[Row, ...] = (
    Row(
        "COM_OF_LOSS_T",
        lambda v, f: 0.3 <= v <= 2.0,
        OK,
        "the autopilot acts {v:g} s after the last setpoint, and flies on with that one until then",
    ),
    Row(
        "COM_OF_LOSS_T",
        any_value,
        WARNING,
        "the autopilot acts {v:g} s after the last setpoint, and flies on with that one until then",
        "set COM_OF_LOSS_T to 1",
    ),
    *loss_action(3, OK, OK, "Return: climbs to RTL_RETURN_ALT, then flies home"),
    *loss_action(4, OK, OK, "Land where it is"),
    *loss_action(5, OK, OK, "Hold"),
    *loss_action(6, ERROR, ERROR, "TERMINATION: motors off, it falls"),
    *loss_action(7, ERROR, ERROR, "DISARM in the air: it falls"),
    Row("COM_RC_OVERRIDE", bit(2), OK, "moved sticks end Offboard"),
    Row(
        "COM_RC_OVERRIDE",
        any_value,
        WARNING,
        "moved sticks do NOT end Offboard, only the mode switch does",
        "set COM_RC_OVERRIDE to {with_2}",
    ),
    Row("COM_RCL_EXCEPT", bit(4, rc=True), WARNING, "a lost RC does nothing in Offboard", OUT_OF_RANGE),
    Row("COM_RCL_EXCEPT", bit(4), OK, "a lost RC does nothing in Offboard"),
    Row("COM_RCL_EXCEPT", any_value, OK, "a lost RC ends Offboard, and NAV_RCL_ACT says what comes then"),
    Row(
        "NAV_RCL_ACT",
        lambda v, f: v in (5, 6) and not int(f.parameters.get("COM_RCL_EXCEPT", 0)) & 4,
        ERROR,
        "a lost RC in Offboard: motors off, it falls",
        "set NAV_RCL_ACT to 2 (Return), 1 (Hold) or 3 (Land)",
    ),
    Row("NAV_RCL_ACT", lambda v, f: bool(int(f.parameters.get("COM_RCL_EXCEPT", 0)) & 4), OK, "not asked in Offboard"),
    Row("NAV_RCL_ACT", is_(1), OK, "a lost RC in Offboard: Hold"),
    Row("NAV_RCL_ACT", is_(2), OK, "a lost RC in Offboard: Hold for COM_FAIL_ACT_T, then Return"),
    Row("NAV_RCL_ACT", is_(3), OK, "a lost RC in Offboard: Hold for COM_FAIL_ACT_T, then Land"),
    Row("NAV_RCL_ACT", any_value, WARNING, "a lost RC does nothing", "set NAV_RCL_ACT to 2 (Return)"),
)

NO_STICKS = ": without sticks "
PX4_COPTER: tuple[Row, ...] = (
    *loss_action(0, ERROR, WARNING, f"Position mode{NO_STICKS}it SINKS to the ground, 0.5 to 1 m/s"),
    *loss_action(1, ERROR, WARNING, f"Altitude mode{NO_STICKS}it sinks at 0.7 m/s and drifts"),
    *loss_action(2, ERROR, WARNING, f"Stabilized mode{NO_STICKS}it sinks at 0.4 m/s and drifts"),
)

NO_POSITION: tuple[Row, ...] = (
    Row(
        "COM_OBL_RC_ACT",
        lambda v, f: v == 1 and f.has_rc,
        OK,
        "if this app dies: Altitude mode, and the pilot flies by stick",
    ),
    Row(
        "COM_OBL_RC_ACT",
        lambda v, f: v == 1 and not f.has_rc,
        ERROR,
        f"if this app dies: Altitude mode{NO_STICKS}it sinks at 0.7 m/s and drifts",
        "set COM_OBL_RC_ACT to 4 (Land), or have a pilot at the sticks",
    ),
    Row(
        "COM_OBL_RC_ACT",
        is_(0, 2, 6, 7),
        ERROR,
        "if this app dies: a mode that needs sticks or a position, or none; it sinks or drifts",
        "set COM_OBL_RC_ACT to 4 (Land), or to 1 (Altitude) with a pilot at the sticks",
    ),
    Row(
        "COM_OBL_RC_ACT",
        is_(3, 5),
        WARNING,
        "if this app dies: Return or Hold, which needs a position: a vehicle that has none cannot do it",
        "set COM_OBL_RC_ACT to 1 (Altitude) with a pilot at the sticks, or 4 (Land)",
    ),
)
"""For the class that is made for vehicles without one; these rows come before the others."""

PX4_PLANE: tuple[Row, ...] = (
    *loss_action(0, ERROR, WARNING, f"Position mode{NO_STICKS}it flies STRAIGHT AWAY, for ever"),
    *loss_action(1, ERROR, WARNING, f"Altitude mode{NO_STICKS}it flies straight away"),
    *loss_action(2, ERROR, WARNING, f"Stabilized mode{NO_STICKS}it flies straight away"),
    Row(
        "FW_AIRSPD_MIN",
        lambda v, f: v > f.speed_m_s,
        ERROR,
        "{v:g} m/s: the autopilot's least airspeed is above orbit.speed_m_s, {f.speed_m_s:g} m/s",
        "raise orbit.speed_m_s, or the parameter was set too high",
    ),
    Row("FW_AIRSPD_MIN", any_value, OK, "{v:g} m/s is below orbit.speed_m_s"),
)

PX4_PLANE_BY_POSITION: tuple[Row, ...] = (
    Row(
        "FW_AIRSPD_TRIM",
        lambda v, f: abs(v - f.speed_m_s) > 0.1 * f.speed_m_s,
        WARNING,
        "PX4 flies {v:g} m/s whatever is asked, orbit.speed_m_s is {f.speed_m_s:g}",
        "make FW_AIRSPD_TRIM and orbit.speed_m_s the same",
    ),
    Row("FW_AIRSPD_TRIM", any_value, OK, "PX4 flies {v:g} m/s, about orbit.speed_m_s"),
    Row(
        "FW_R_LIM",
        below(lambda f: f.bank_deg),
        WARNING,
        "PX4 banks {v:g} deg at most, limits.bank_deg is {f.bank_deg:g}",
        "raise FW_R_LIM or lower limits.bank_deg: what is asked beyond it is not flown",
    ),
    Row("FW_R_LIM", any_value, OK, "PX4 banks {v:g} deg at most"),
)

PX4_BY_VELOCITY: tuple[Row, ...] = (
    Row(
        "MPC_XY_VEL_MAX",
        below(lambda f: f.speed_m_s),
        ERROR,
        "it clips the speed at {v:g} m/s, orbit.speed_m_s is {f.speed_m_s:g}",
        "raise MPC_XY_VEL_MAX above orbit.speed_m_s, or fly slower",
    ),
    Row("MPC_XY_VEL_MAX", any_value, OK, "{v:g} m/s is above orbit.speed_m_s"),
)

ARDUCOPTER: tuple[Row, ...] = (
    Row(
        "GUID_TIMEOUT",
        lambda v, f: v > 1.5,
        WARNING,
        "if this app dies it flies on, TURNING, for {v:g} s, then stops and stays in Guided: nothing brings it home",
        "set GUID_TIMEOUT to 1; a pilot or the ground station must take it from there",
    ),
    Row(
        "GUID_TIMEOUT",
        any_value,
        OK,
        "if this app dies it flies on for {v:g} s, then stops and stays in Guided: nothing brings it home by itself",
    ),
    Row(
        "GUID_OPTIONS",
        bit(4),
        WARNING,
        "the pilot's yaw stick is ignored in Guided",
        "clear bit 2 (4): the pilot should win",
    ),
    Row("GUID_OPTIONS", any_value, OK, "the pilot's yaw stick overrides the turn"),
    Row("FS_THR_ENABLE", lambda v, f: v == 0 and f.has_rc, WARNING, "a lost RC does nothing", "set FS_THR_ENABLE to 1"),
    Row("FS_THR_ENABLE", is_(0), OK, "a lost RC does nothing, and none is there"),
    Row("FS_THR_ENABLE", any_value, OK, "a lost RC is acted on"),
    Row("FS_OPTIONS", bit(4, rc=True), WARNING, "a lost RC does nothing in Guided", OUT_OF_RANGE),
    Row("FS_OPTIONS", bit(4), OK, "a lost RC does nothing in Guided"),
    Row("FS_OPTIONS", any_value, OK, "a lost RC ends Guided (FS_THR_ENABLE says how)"),
    Row(
        "WPNAV_SPEED",
        below(lambda f: 100.0 * f.speed_m_s),
        ERROR,
        "it clips the speed at {v:g} cm/s, orbit.speed_m_s is {f.speed_m_s:g} m/s",
        "raise WPNAV_SPEED, or fly slower",
    ),
    Row("WPNAV_SPEED", any_value, OK, "{v:g} cm/s is above orbit.speed_m_s"),
    Row(
        "WPNAV_ACCEL",
        below(lambda f: 250.0),
        WARNING,
        "it turns with {v:g} cm/s2 at most; the app asks for up to 250",
        "set WPNAV_ACCEL to 250, or lower limits.turn_rate_rad_s",
    ),
    Row("WPNAV_ACCEL", any_value, OK, "{v:g} cm/s2: what the app asks for is flown"),
)

ARDUPLANE: tuple[Row, ...] = (
    Row("STICK_MIXING", is_(0), OK, "sticks do nothing in Guided, only the mode switch does"),
    Row(
        "STICK_MIXING",
        lambda v, f: f.has_rc,
        WARNING,
        "a stick ADDS to the app's bank (24 deg asked and the stick pushed flew 47), and no message says so",
        "set STICK_MIXING to 0, or keep the hands off the sticks in Guided",
    ),
    Row("STICK_MIXING", any_value, OK, "a stick would add to the app's bank, but none is there"),
    Row(
        "FS_LONG_ACTN",
        lambda v, f: v == 0 and f.has_rc,
        WARNING,
        "a lost RC does nothing in Guided: it goes on obeying the app",
        "set FS_LONG_ACTN to 1 (RTL)",
    ),
    Row("FS_LONG_ACTN", is_(0), OK, "a lost RC does nothing in Guided, and none is there"),
    Row("FS_LONG_ACTN", is_(1), OK, "a lost RC: RTL after FS_LONG_TIMEOUT"),
    Row(
        "FS_LONG_ACTN",
        any_value,
        WARNING,
        "a lost RC: it glides in FBWA (2) or worse",
        "set FS_LONG_ACTN to 1 (RTL)",
    ),
    Row(
        "TKOFF_ALT",
        below(lambda f: min(10.0, f.height_m)),
        ERROR,
        "its mode Takeoff climbs to {v:g} m: engage: auto does not begin there",
        "set TKOFF_ALT to 10 or more",
    ),
    Row(
        "TKOFF_ALT",
        below(lambda f: f.height_m - 1.0),
        OK,
        "{v:g} m, the height that its mode Takeoff climbs to; the rest to orbit.height_m is climbed once engaged",
    ),
    Row("TKOFF_ALT", any_value, OK, "{v:g} m, the height that its mode Takeoff climbs to"),
    Row(
        "ROLL_LIMIT_DEG",
        below(lambda f: f.bank_deg),
        WARNING,
        "it banks {v:g} deg at most, limits.bank_deg is {f.bank_deg:g}",
        "raise ROLL_LIMIT_DEG or lower limits.bank_deg: what is asked beyond it is not flown",
    ),
    Row("ROLL_LIMIT_DEG", any_value, OK, "it banks {v:g} deg at most"),
    Row(
        "AIRSPEED_CRUISE",
        lambda v, f: abs(v - f.speed_m_s) > 0.15 * f.speed_m_s,
        WARNING,
        "it flies {v:g} m/s (calibrated) whatever is asked, orbit.speed_m_s is {f.speed_m_s:g} (true)",
        "set orbit.speed_m_s to AIRSPEED_CRUISE, and 5 % more for every 1000 m above the sea",
    ),
    Row("AIRSPEED_CRUISE", any_value, OK, "it flies {v:g} m/s (calibrated), about orbit.speed_m_s"),
)

ARDUPILOT: tuple[Row, ...] = (
    Row(
        "SYSID_MYGCS",
        lambda v, f: v == f.sysid,
        OK,
        "the companion's heartbeat is the one that FS_GCS_ENABLE (FS_GCS_ENABL) watches: RTL if it stops",
    ),
    Row("SYSID_MYGCS", any_value, OK, "system {v:g} is the ground station; nothing watches the companion"),
)

TABLES: dict[str, tuple[Row, ...]] = {
    "px4_multirotor": PX4 + PX4_COPTER + PX4_BY_VELOCITY,
    "px4_multirotor_attitude": NO_POSITION + PX4 + PX4_COPTER,
    "px4_fixed_wing": PX4 + PX4_PLANE,
    "px4_fixed_wing_position": PX4 + PX4_PLANE + PX4_PLANE_BY_POSITION,
    "px4_rover": (*PX4, Row("COM_OBL_RC_ACT", any_value, WARNING, "what a rover does then was never measured", SINKS)),
    "arducopter": ARDUCOPTER + ARDUPILOT,
    "arduplane": ARDUPLANE + ARDUPILOT,
}
"""By vehicle.class."""


def asked(vehicle_class: str) -> tuple[str, ...]:
    """Return the parameters to read of the autopilot, each once."""
    return tuple(dict.fromkeys(row.parameter for row in TABLES[vehicle_class]))
