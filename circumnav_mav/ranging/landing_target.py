"""LANDING_TARGET (149, common): a float distance in metres to the target `target_num`. 0 means that none is given."""

from __future__ import annotations

from typing import Any

from circumnav_mav.ranging.plug import BYTE, NAN, MessageSource, Reading, Reason
from circumnav_mav.types import Rejected


def read(fields: Any, now_s: float) -> Reading | Rejected:
    if fields.distance == 0.0:
        return Rejected(now_s, Reason.NO_READING, f"target {fields.target_num}: no distance")
    return Reading(
        range_m=fields.distance,
        beacon_id=fields.target_num,
        stamp_s=fields.time_usec / 1e6 if fields.time_usec else NAN,
    )


SOURCE = MessageSource(
    name="landing_target",
    summary="MAVLink LANDING_TARGET (149): metres, several targets by target_num",
    message_ids=(149,),
    read=read,
    resolution_m=0.0,
    carries=frozenset({"beacon_id", "stamp_s"}),
    most_beacon_id=BYTE,
    most_m=10_000.0,
)
