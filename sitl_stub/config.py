"""What a flight of the stub is made of: one frozen table, every field with its unit and default."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from sitl_stub.devices import DEVICES
from sitl_stub.faults import parse

AIRFRAMES = ("multirotor", "fixed_wing")
RANGE_MESSAGES = ("distance_sensor", "ranging_beacon", "landing_target")


@dataclass(frozen=True, slots=True, kw_only=True)
class StubConfig:
    """Settings of one flight. East and north are metres from the world's origin, heights are above flat ground.

    Headings count counter-clockwise from east, as in Truth. The autopilot's LOCAL_POSITION_NED has its origin where
    the vehicle boots: at (start_east_m, start_north_m) on the ground.
    """

    seed: int = 1  # every random draw of the flight comes from it
    step_s: float = 0.01  # simulation step; 0.02 halves the cost and caps streams at 50 Hz
    airframe: str = "multirotor"  # or "fixed_wing"
    system_id: int = 1
    params: Mapping[str, float] = field(default_factory=dict)  # PX4 parameters that differ from a stock SITL
    ready_after_s: float = 1.0  # arming is refused until then (a real PX4: 6 to 8 s)

    start_east_m: float = 0.0
    start_north_m: float = 0.0
    start_heading_rad: float = math.pi / 2  # north
    start_height_m: float = 0.0  # above 0: starts armed and flying in Hold
    start_speed_m_s: float = 0.0  # ground speed of an airborne start

    beacon_east_m: float = 0.0
    beacon_north_m: float = 0.0
    beacon_height_m: float = 0.0
    beacon_east_m_s: float = 0.0  # the beacon may move
    beacon_north_m_s: float = 0.0

    wind_east_m_s: float = 0.0  # the air moves towards east with this speed
    wind_north_m_s: float = 0.0
    gust_sigma_m_s: float = 0.0  # standard deviation of each horizontal component, first-order
    gust_tau_s: float = 3.0  # correlation time of gusts
    height_drift_m_s: float = 0.04  # wander of the climb rate around the one commanded, standard deviation

    compass_error_rad: float = 0.0  # the autopilot's yaw minus the true one (clockwise)
    compass_wobble_rad: float = 0.0  # and a part that goes with the sine of the yaw (iron on board)
    airspeed_scale: float = 1.0  # airspeed shown / true airspeed (fixed wing)
    gps: bool = True  # without it there is no local position, and PX4 refuses what needs one
    local_z_error_m: float = -0.46  # what LOCAL_POSITION_NED.z reads on the ground (PX4: -0.73 to 0.01 seen)

    radio: bool = True  # whether the vehicle carries the ranging radio
    range_sigma_m: float = 0.3
    range_bias_m: float = 0.0
    range_rate_hz: float = 10.0
    range_latency_s: float = 0.0  # from the measurement to the message
    range_max_m: float = 650.0  # beyond it the radio is silent
    range_dropouts_s: tuple[tuple[float, float], ...] = ()  # (from, to): no messages
    outlier_share: float = 0.0  # share of ranges that took a detour
    outlier_mean_m: float = 10.0  # mean detour (exponential)
    range_link: str = "offboard"  # "offboard", or "ranging": an endpoint of its own
    range_sysid: int | None = None  # None: the vehicle's
    range_compid: int = 158
    range_sensor_id: int = 7
    range_orientation: int = 0
    range_message: str = "distance_sensor"  # or "ranging_beacon", "landing_target"
    range_beacon_id: int = 1  # of RANGING_BEACON and LANDING_TARGET, and of devices that know of one
    range_step_m: float = 0.0  # quantisation besides that of the message
    range_rate_sigma_m_s: float = 0.1  # noise of the range rate, for devices that measure one
    device: str = ""  # instead of messages, the bytes of a device (sitl_stub.devices) on the link "device"

    mavlink_version: int = 2  # 1: speak MAVLink 1 until the peer speaks 2
    signing_key: bytes = b""  # 32 bytes: sign what is sent and take only what is signed
    faults: tuple[str, ...] = ()  # a timeline, one line each: see sitl_stub.faults

    def __post_init__(self) -> None:
        faults = []
        if self.airframe not in AIRFRAMES:
            faults.append(f"airframe {self.airframe!r} is none of {', '.join(AIRFRAMES)}")
        if not 1 <= self.system_id <= 255:
            faults.append(f"system_id {self.system_id} is not within 1..255")
        if not 0.001 <= self.step_s <= 0.02:
            faults.append(f"step_s {self.step_s} is not within 0.001..0.02")
        if self.range_link not in ("offboard", "ranging"):
            faults.append(f"range_link {self.range_link!r} is neither offboard nor ranging")
        if not 0.0 < self.range_rate_hz <= 100.0:
            faults.append(f"range_rate_hz {self.range_rate_hz} is not within 0..100")
        if not 0.0 <= self.outlier_share <= 1.0:
            faults.append(f"outlier_share {self.outlier_share} is not within 0..1")
        if self.start_height_m < 0.0:
            faults.append(f"start_height_m {self.start_height_m} is below the ground")
        for name in ("range_sigma_m", "range_latency_s", "gust_sigma_m_s", "height_drift_m_s", "outlier_mean_m"):
            if not 0.0 <= getattr(self, name) < math.inf:
                faults.append(f"{name} {getattr(self, name)} is negative or not a number")
        if self.range_message not in RANGE_MESSAGES:
            faults.append(f"range_message {self.range_message!r} is none of {', '.join(RANGE_MESSAGES)}")
        if self.mavlink_version not in (1, 2):
            faults.append(f"mavlink_version {self.mavlink_version} is neither 1 nor 2")
        if len(self.signing_key) not in (0, 32):
            faults.append(f"signing_key has {len(self.signing_key)} bytes, not 32")
        if self.device and self.device not in DEVICES:
            faults.append(f"device {self.device!r} is none of {', '.join(DEVICES)}")
        for line in self.faults:
            try:
                parse(line)
            except ValueError as error:
                faults.append(str(error))
        for window in self.range_dropouts_s:
            if not window[0] <= window[1]:
                faults.append(f"dropout {window} ends before it begins")
        if faults:
            raise ValueError("; ".join(faults))
