"""DISTANCE_SENSOR (132, common): whole centimetres up to 655.35 m.

current_distance 0 and 65535 are no readings; covariance [cm^2] 0 and 255 mean unknown; signal_quality 0 is unknown and
1 invalid, as in the message's definition. A max_distance or time_boot_ms of 0 is taken as not given.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from circumnav_mav.ranging.plug import NAN, MessageSource, Reading, Reason
from circumnav_mav.types import Rejected

CM = 100.0  # a metre
NOTHING_CM = (0, 0xFFFF)
COVARIANCE_UNKNOWN = (0, 0xFF)
QUALITY_UNKNOWN, QUALITY_INVALID = 0, 1


def read(fields: Any, now_s: float) -> Reading | Rejected:
    if fields.current_distance in NOTHING_CM:
        return Rejected(now_s, Reason.NO_READING, f"current_distance is {fields.current_distance}")
    quality = fields.signal_quality
    return Reading(
        range_m=fields.current_distance / CM,
        sigma_m=NAN if fields.covariance in COVARIANCE_UNKNOWN else sqrt(fields.covariance) / CM,
        sensor_id=fields.id,
        orientation=fields.orientation,
        quality_pct=NAN if quality == QUALITY_UNKNOWN else 0.0 if quality == QUALITY_INVALID else float(quality),
        least_m=fields.min_distance / CM,
        most_m=fields.max_distance / CM if fields.max_distance else NAN,
        stamp_s=fields.time_boot_ms / 1000.0 if fields.time_boot_ms else NAN,
    )


SOURCE = MessageSource(
    name="distance_sensor",
    summary="MAVLink DISTANCE_SENSOR (132): centimetres, up to 655 m",
    message_ids=(132,),
    read=read,
    resolution_m=1.0 / CM,
    carries=frozenset({"sensor_id", "orientation", "quality_pct", "stamp_s"}),
    most_m=655.36,
)
