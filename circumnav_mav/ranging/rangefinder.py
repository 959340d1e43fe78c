"""RANGEFINDER (173, ardupilotmega): a float distance in metres and nothing else; 0 means that there is no range."""

from __future__ import annotations

from typing import Any

from circumnav_mav.ranging.plug import MessageSource, Reading, Reason
from circumnav_mav.types import Rejected


def read(fields: Any, now_s: float) -> Reading | Rejected:
    if fields.distance == 0.0:
        return Rejected(now_s, Reason.NO_READING, "distance is 0")
    return Reading(range_m=fields.distance)


SOURCE = MessageSource(
    name="rangefinder",
    summary="MAVLink RANGEFINDER (173): metres, no stamp, no id: say who sends it with ranging.from",
    message_ids=(173,),
    read=read,
    resolution_m=0.01,
    most_m=10_000.0,
)
