"""What the app tells ground stations, which hear it through the autopilot: texts, the orbit, the target, the drift."""

from __future__ import annotations

from math import isnan

from circumnav_mav.mavlink.autopilot import Autopilot
from circumnav_mav.mavlink.codec import Packer
from circumnav_mav.mavlink.dialect import by_name, enums

STATUSTEXT_LENGTH = 50
TARGET, DRIFT = b"TARGET", b"DRIFT"
"""Names, at most ten letters, under which ground stations and logs show the target."""


class Announcer:
    """Packs what is told; it decides nothing and remembers only which long text was the last."""

    def __init__(self, packer: Packer, autopilot: Autopilot) -> None:
        self._pack, self._autopilot = packer.pack, autopilot
        self._text_id = 0

    def text(self, text: str, severity: int) -> list[bytes]:
        """Return a text for the ground station, which the autopilot forwards: in chunks where it is long."""
        raw = text.encode("ascii", "replace")
        chunks = [raw[i : i + STATUSTEXT_LENGTH] for i in range(0, len(raw), STATUSTEXT_LENGTH)]
        self._text_id = self._text_id % 0xFFFF + 1 if len(chunks) > 1 else self._text_id
        text_id = self._text_id if len(chunks) > 1 else 0
        return [
            self._pack("STATUSTEXT", severity=severity, text=chunk, id=text_id, chunk_seq=i)
            for i, chunk in enumerate(chunks)
        ]

    def orbit(self, now_s: float, radius_m: float, lat_deg: float, lon_deg: float) -> bytes:
        """Return ORBIT_EXECUTION_STATUS: ground stations draw the circle. radius_m: + clockwise."""
        return self._pack(
            "ORBIT_EXECUTION_STATUS",
            time_usec=int(now_s * 1e6),
            radius=radius_m,
            x=round(lat_deg * 1e7),
            y=round(lon_deg * 1e7),
            z=0.0 if isnan(self._autopilot.amsl_m) else self._autopilot.amsl_m,
            frame=enums.MAV_FRAME_GLOBAL,
        )

    def target(self, now_s: float, north_m: float, east_m: float, sigma_m: float) -> bytes:
        """Return DEBUG_VECT `TARGET`: the target from the vehicle (x north, y east) and the uncertainty z, in metres.

        Ground stations keep one row a message and component, whatever its name: so no message is sent under two names.
        """
        return self._pack("DEBUG_VECT", name=TARGET, time_usec=int(now_s * 1e6), x=north_m, y=east_m, z=sigma_m)

    def drift(self, now_s: float, north_m_s: float, east_m_s: float, sigma_m_s: float) -> bytes:
        """Return DEBUG_FLOAT_ARRAY `DRIFT`: wind minus the target's velocity (north, east), its uncertainty, in m/s."""
        values = (north_m_s, east_m_s, sigma_m_s)
        data = values + (0.0,) * (by_name("DEBUG_FLOAT_ARRAY").lengths[-1] - len(values))
        return self._pack("DEBUG_FLOAT_ARRAY", time_usec=int(now_s * 1e6), name=DRIFT, array_id=0, data=data)
