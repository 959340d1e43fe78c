"""What passes between the rings: frozen dataclasses in SI units, radians and monotonic seconds.

Signs: turn rate is positive counter-clockwise seen from above, as in the paper; `mavlink/setpoints.py` alone turns it
into MAVLink's clockwise yaw rate. A float that is not known is NaN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

NAN = math.nan


@dataclass(frozen=True, slots=True)
class RangeSample:
    """One measured range.

    t_s: when the range was true [s, the app's monotonic clock]; range_m [m]; range_rate_m_s [m/s, + opening] where the
    sensor has one; sigma_m: the standard deviation that the sensor claims [m].
    """

    t_s: float
    range_m: float
    range_rate_m_s: float = NAN
    sigma_m: float = NAN
    beacon_id: int | None = None


class ClockOffset(NamedTuple):
    """A clock beside the app's: what it shows is the app's time plus offset_s [s], wrong by bound_s [s] at most."""

    offset_s: float
    bound_s: float


@dataclass(frozen=True, slots=True)
class Rejected:
    """A range that is not flown on, with a reason that is counted and a detail that a person reads."""

    t_s: float
    reason: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class TurnRateSetpoint:
    """What guidance asks of the vehicle at one tick, before the vehicle class encodes it.

    turn_rate_rad_s: + counter-clockwise; speed_m_s: speed to fly, 0 = hold the place; height_m: height to hold above
    the take-off point, NaN = keep the height without a reference (vertical speed 0).
    """

    t_s: float
    turn_rate_rad_s: float
    speed_m_s: float
    height_m: float = NAN
