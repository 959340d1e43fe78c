"""RANGING_BEACON (513, development): millimetres, with the beacon's id, a sequence number and its accuracy.

range and range_accuracy of UINT32_MAX are unknown; the status flag for a poor signal is shown as a quality of 50 %, so
that min_quality_pct can turn such ranges away.
"""

from __future__ import annotations

from typing import Any

from circumnav_mav.ranging.plug import FARTHEST_M, NAN, TWO_BYTES, MessageSource, Reading, Reason
from circumnav_mav.types import Rejected

MM = 1000.0  # a metre
UNKNOWN = 0xFFFFFFFF
SIGNAL_POOR = 1
POOR_PCT = 50.0


def read(fields: Any, now_s: float) -> Reading | Rejected:
    if fields.range == UNKNOWN:
        return Rejected(now_s, Reason.NO_READING, f"beacon {fields.beacon_id}: range unknown")
    return Reading(
        range_m=fields.range / MM,
        sigma_m=NAN if fields.range_accuracy in (0, UNKNOWN) else fields.range_accuracy / MM,
        beacon_id=fields.beacon_id,
        quality_pct=POOR_PCT if fields.status & SIGNAL_POOR else NAN,
        stamp_s=fields.time_usec / 1e6 if fields.time_usec else NAN,
        sequence=fields.sequence,
    )


SOURCE = MessageSource(
    name="ranging_beacon",
    summary="MAVLink RANGING_BEACON (513): millimetres, several beacons by id",
    message_ids=(513,),
    read=read,
    resolution_m=1.0 / MM,
    carries=frozenset({"beacon_id", "quality_pct", "stamp_s"}),
    most_beacon_id=TWO_BYTES,
    most_m=FARTHEST_M,
)
