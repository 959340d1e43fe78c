"""The parameters that matter, with the values that a stock PX4 v1.16 SITL boots with, and PX4's odd wire form.

PX4 puts the four bytes of an INT32 into the float field. A PARAM_SET of the wrong type is ignored without a word; one
beyond a parameter's limits is taken, as PX4 takes it. The limits are for whoever configures the stub.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping

INT32, REAL32 = 6, 9
Entry = tuple[int | float, int | float, int | float]  # default, least, most: as PX4 documents them, or somewhat wider

_COMMON: dict[str, Entry] = {
    "BAT1_N_CELLS": (4, 0, 16),
    "CBRK_FLIGHTTERM": (121212, 0, 121212),
    "CBRK_IO_SAFETY": (22027, 0, 22027),
    "CBRK_SUPPLY_CHK": (0, 0, 894281),
    "CBRK_USB_CHK": (197848, 0, 197848),
    "COM_ARM_WO_GPS": (1, 0, 2),
    "COM_DISARM_LAND": (2.0, -1.0, 20.0),
    "COM_DISARM_PRFLT": (10.0, -1.0, 30.0),
    "COM_DL_LOSS_T": (10, 5, 300),
    "COM_FAIL_ACT_T": (5.0, 0.0, 25.0),
    "COM_FLTMODE1": (-1, -1, 116),
    "COM_OBL_RC_ACT": (0, 0, 7),
    "COM_OF_LOSS_T": (1.0, 0.0, 60.0),
    "COM_PREARM_MODE": (0, 0, 2),
    "COM_RCL_EXCEPT": (0, 0, 31),
    "COM_RC_IN_MODE": (1, 0, 4),
    "COM_RC_LOSS_T": (0.5, 0.0, 35.0),
    "COM_RC_OVERRIDE": (1, 0, 3),
    "COM_RC_STICK_OV": (30.0, 5.0, 80.0),
    "GF_ACTION": (2, 0, 5),
    "GF_MAX_HOR_DIST": (0.0, 0.0, 10000.0),
    "GF_MAX_VER_DIST": (0.0, 0.0, 10000.0),
    "MAV_COMP_ID": (1, 1, 250),
    "MAV_FWDEXTSP": (1, 0, 1),
    "MAV_SYS_ID": (1, 1, 250),
    "MAV_TYPE": (2, 0, 22),
    "MIS_TAKEOFF_ALT": (2.5, 0.0, 80.0),
    "NAV_ACC_RAD": (10.0, 0.05, 200.0),
    "NAV_DLL_ACT": (0, 0, 6),
    "NAV_LOITER_RAD": (80.0, 5.0, 1000.0),
    "NAV_RCL_ACT": (2, 0, 6),
    "RTL_DESCEND_ALT": (30.0, 0.0, 1000.0),
    "RTL_LAND_DELAY": (0.0, -1.0, 300.0),
    "RTL_RETURN_ALT": (30.0, 0.0, 1000.0),
    "RTL_TYPE": (0, 0, 3),
    "SYS_AUTOSTART": (10040, 0, 9999999),
    "SYS_HAS_GPS": (1, 0, 1),
    "SYS_HAS_MAG": (1, 0, 4),
}

_MULTIROTOR: dict[str, Entry] = {
    "MC_YAWRATE_MAX": (200.0, 0.0, 1800.0),
    "MC_YAW_P": (2.8, 0.0, 5.0),
    "MPC_ACC_DOWN_MAX": (3.0, 2.0, 15.0),
    "MPC_ACC_HOR": (3.0, 2.0, 15.0),
    "MPC_ACC_UP_MAX": (4.0, 2.0, 15.0),
    "MPC_JERK_AUTO": (4.0, 1.0, 80.0),
    "MPC_LAND_ALT1": (10.0, 0.0, 1000.0),
    "MPC_LAND_ALT2": (5.0, 0.0, 1000.0),
    "MPC_LAND_SPEED": (0.7, 0.6, 10.0),
    "MPC_THR_HOVER": (0.489, 0.1, 0.8),
    "MPC_TILTMAX_AIR": (45.0, 20.0, 89.0),
    "MPC_TKO_RAMP_T": (3.0, 0.0, 5.0),
    "MPC_TKO_SPEED": (1.5, 1.0, 5.0),
    "MPC_XY_CRUISE": (5.0, 3.0, 20.0),
    "MPC_XY_ERR_MAX": (2.0, 0.1, 10.0),
    "MPC_XY_P": (0.95, 0.0, 2.0),
    "MPC_XY_VEL_MAX": (12.0, 0.0, 20.0),
    "MPC_YAWRAUTO_MAX": (45.0, 5.0, 360.0),
    "MPC_Z_P": (1.0, 0.1, 1.5),
    "MPC_Z_VEL_MAX_DN": (1.5, 0.5, 4.0),
    "MPC_Z_VEL_MAX_UP": (3.0, 0.5, 8.0),
    "MPC_Z_V_AUTO_DN": (1.5, 0.5, 4.0),
    "MPC_Z_V_AUTO_UP": (3.0, 0.5, 8.0),
    "NAV_MC_ALT_RAD": (0.8, 0.05, 200.0),
}

_FIXED_WING: dict[str, Entry] = {
    "COM_DISARM_PRFLT": (-1.0, -1.0, 30.0),
    "FW_AIRSPD_MAX": (20.0, 0.5, 1000.0),
    "FW_AIRSPD_MIN": (10.0, 0.5, 1000.0),
    "FW_AIRSPD_STALL": (7.0, 0.5, 1000.0),
    "FW_AIRSPD_TRIM": (15.0, 0.5, 1000.0),
    "FW_P_LIM_MAX": (30.0, 0.0, 60.0),
    "FW_P_LIM_MIN": (-30.0, -60.0, 0.0),
    "FW_R_LIM": (50.0, 5.0, 80.0),
    "FW_R_RMAX": (70.0, 0.0, 180.0),
    "FW_R_TC": (0.4, 0.2, 1.0),
    "FW_THR_TRIM": (0.6, 0.0, 1.0),
    "FW_T_CLMB_MAX": (5.0, 1.0, 15.0),
    "FW_T_SINK_MAX": (5.0, 1.0, 15.0),
    "MAV_TYPE": (1, 0, 22),
    "MIS_TAKEOFF_ALT": (25.0, 0.0, 80.0),
    "RTL_RETURN_ALT": (100.0, 0.0, 1000.0),
    "RTL_DESCEND_ALT": (100.0, 0.0, 1000.0),
    "SYS_AUTOSTART": (10041, 0, 9999999),
}


class Parameters:
    """The parameter table: sorted by name as PX4 lists them. Values keep their type, int or float."""

    def __init__(self, fixed_wing: bool, overrides: Mapping[str, float] = {}) -> None:
        table = _COMMON | (_FIXED_WING if fixed_wing else _MULTIROTOR)
        self._limits = table
        self._values = {name: entry[0] for name, entry in sorted(table.items())}
        self.names = list(self._values)
        for name, value in overrides.items():
            self.check(name, value)
            self.set(name, value)

    def check(self, name: str, value: float) -> None:
        """Refuse a parameter that PX4 does not have, or a value beyond its limits. ValueError in words."""
        if name not in self._values:
            raise ValueError(f"no parameter {name!r}; the stub has: {', '.join(self.names)}")
        default, least, most = self._limits[name]
        if not isinstance(value, int | float) or not least <= value <= most:
            raise ValueError(f"parameter {name} cannot be {value}: it goes from {least:g} to {most:g}")
        if isinstance(default, int) and value != int(value):
            raise ValueError(f"parameter {name} cannot be {value}: it is a whole number")

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def set(self, name: str, value: float) -> None:
        """Set a parameter, keeping its type."""
        self._values[name] = int(value) if isinstance(self._values[name], int) else float(value)

    def wire(self, name: str) -> tuple[bytes, float, int, int, int]:
        """Return PARAM_VALUE's fields: id, value (an int's bytes seen as a float), type, count, index."""
        value = self._values[name]
        if isinstance(value, int):
            as_float: float = struct.unpack("<f", struct.pack("<i", value))[0]
            return name.encode(), as_float, INT32, len(self), self.names.index(name)
        return name.encode(), value, REAL32, len(self), self.names.index(name)

    def set_from_wire(self, name: str, raw: float, kind: int) -> bool:
        """Take a PARAM_SET as PX4 does; False if it is ignored (unknown name, wrong type, not a number)."""
        if name not in self._values:
            return False
        if isinstance(self._values[name], int):
            if kind != INT32:
                return False
            self._values[name] = struct.unpack("<i", struct.pack("<f", raw))[0]
            return True
        if kind != REAL32 or not math.isfinite(raw):
            return False
        self._values[name] = raw
        return True
