"""Another PX4 within reach of the link, flying somewhere else; it may even have our system id."""

from __future__ import annotations

import math

from sitl_stub import wire
from sitl_stub.link import Link
from sitl_stub.modes import Mode, base_mode_of
from sitl_stub.sensors import ZERO4
from sitl_stub.world import HOME_AMSL_M, lat_lon_deg

CIRCLE_M, SPEED_M_S, HEIGHT_M = 150.0, 8.0, 60.0
CENTRE_N_M, CENTRE_E_M = 700.0, 400.0
PERIODS_S = {0: 1.0, 30: 0.1, 32: 0.1, 33: 0.2, 132: 0.1, 436: 0.5}


class ForeignVehicle:
    """Sends the heartbeat, mode, attitude, position and downward range of a multirotor on a circle in Hold."""

    def __init__(self, sysid: int, now_s: float) -> None:
        self._sysid = sysid
        self._next_s = {msgid: now_s + period for msgid, period in PERIODS_S.items()}

    def step(self, now_s: float, link: Link) -> None:
        """Send what is due."""
        for msgid, due_s in self._next_s.items():
            if due_s <= now_s:
                self._next_s[msgid] = due_s + PERIODS_S[msgid]
                link.send(msgid, wire.pack(msgid, self._fields(msgid, now_s)), self._sysid, 1)

    def _fields(self, msgid: int, now_s: float) -> tuple[object, ...]:
        rate = SPEED_M_S / CIRCLE_M
        angle = rate * now_s
        n, e = CENTRE_N_M + CIRCLE_M * math.cos(angle), CENTRE_E_M + CIRCLE_M * math.sin(angle)
        vn, ve = -SPEED_M_S * math.sin(angle), SPEED_M_S * math.cos(angle)
        yaw = math.atan2(ve, vn)
        ms = round(now_s * 1e3)
        if msgid == 0:
            return 2, 12, base_mode_of(Mode.HOLD, True), int(Mode.HOLD), 4, 3
        if msgid == 30:
            return ms, 0.05, 0.0, yaw, 0.0, 0.0, rate
        if msgid == 32:
            return ms, n, e, -HEIGHT_M, vn, ve, 0.0
        if msgid == 33:
            lat, lon = lat_lon_deg(n, e)
            place = (round(lat * 1e7), round(lon * 1e7), round((HEIGHT_M + HOME_AMSL_M) * 1e3), round(HEIGHT_M * 1e3))
            return ms, *place, round(vn * 100), round(ve * 100), 0, round(math.degrees(yaw) * 100) % 36000
        if msgid == 132:
            return ms, 0, 10000, round(HEIGHT_M * 100), 0, 0, 25, 0, 0.0, 0.0, ZERO4, 0
        return 0, int(Mode.HOLD), int(Mode.HOLD)
