"""What a flight of the stub is made of: one frozen table, every field with its unit and default."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from numbers import Integral, Real

from sitl_stub.devices import DEVICES, WITH_ID
from sitl_stub.faults import FAR_M, WIND_MOST_M_S, Fault, assigned, parse
from sitl_stub.params import Parameters

AIRFRAMES = ("multirotor", "fixed_wing")
RANGE_MESSAGES = ("distance_sensor", "ranging_beacon", "landing_target")
INTEGER_RANGES = ("distance_sensor", "ranging_beacon")  # messages without a place for NaN


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
    unix_start_s: float | None = None  # time of day at t = 0; None: 2026-01-01 in lockstep, now over sockets
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
    roll_lag_s: float = 0.165  # of the roll loop, and so of the turn rate: a larger airplane's is longer (fixed wing)
    airspeed_scale: float = 1.0  # an error of the airspeed sensor: shown / calibrated airspeed (fixed wing)
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
        faults = [*_wrong_numbers(self), *_wrong_words(self)]
        if not faults:  # numbers are numbers, so that they may be compared
            faults = [*_wrong_windows(self), *_wrong_parameters(self), *_wrong_lines(self)]
        if faults:
            raise ValueError("; ".join(faults))


_FAR_M, _FAST_M_S = FAR_M, 1000.0
# What a number may be, both ends included.
BOUNDS: dict[str, tuple[float, float]] = {
    "seed": (-(2**63), 2**63),
    "step_s": (0.001, 0.02),
    "system_id": (1, 255),
    "unix_start_s": (0.0, 4e9),
    "ready_after_s": (0.0, 1e9),
    "start_east_m": (-_FAR_M, _FAR_M),
    "start_north_m": (-_FAR_M, _FAR_M),
    "start_heading_rad": (-100.0, 100.0),
    "start_height_m": (0.0, 10_000.0),
    "start_speed_m_s": (0.0, 100.0),
    "beacon_east_m": (-_FAR_M, _FAR_M),
    "beacon_north_m": (-_FAR_M, _FAR_M),
    "beacon_height_m": (-_FAR_M, _FAR_M),
    "beacon_east_m_s": (-_FAST_M_S, _FAST_M_S),
    "beacon_north_m_s": (-_FAST_M_S, _FAST_M_S),
    "wind_east_m_s": (-WIND_MOST_M_S, WIND_MOST_M_S),
    "wind_north_m_s": (-WIND_MOST_M_S, WIND_MOST_M_S),
    "gust_sigma_m_s": (0.0, WIND_MOST_M_S),
    "gust_tau_s": (0.01, 1e6),
    "height_drift_m_s": (0.0, 10.0),
    "compass_error_rad": (-100.0, 100.0),
    "compass_wobble_rad": (-100.0, 100.0),
    "roll_lag_s": (0.01, 10.0),
    "airspeed_scale": (0.01, 100.0),
    "local_z_error_m": (-1000.0, 1000.0),
    "range_sigma_m": (0.0, _FAR_M),
    "range_bias_m": (-_FAR_M, _FAR_M),
    "range_rate_hz": (0.001, 100.0),
    "range_latency_s": (0.0, 3600.0),
    "range_max_m": (0.0, 1e9),
    "outlier_share": (0.0, 1.0),
    "outlier_mean_m": (0.0, _FAR_M),
    "range_sysid": (0, 255),
    "range_compid": (0, 255),
    "range_sensor_id": (0, 255),
    "range_orientation": (0, 255),
    "range_beacon_id": (0, 65535),
    "range_step_m": (0.0, _FAR_M),
    "range_rate_sigma_m_s": (0.0, _FAST_M_S),
}
CHOICES: dict[str, tuple[str, ...]] = {
    "airframe": AIRFRAMES,
    "range_link": ("offboard", "ranging"),
    "range_message": RANGE_MESSAGES,
    "device": ("", *DEVICES),
}


def _wrong_numbers(c: StubConfig) -> Iterator[str]:
    for f in fields(c):
        if f.name not in BOUNDS:
            continue
        value, (least, most) = getattr(c, f.name), BOUNDS[f.name]
        whole = "int" in str(f.type)
        if value is None and "None" in str(f.type):
            continue
        if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
            yield f"{f.name} {value!r} is not a {'whole ' * whole}number"
        elif not least <= float(value) <= most:  # NaN is never within
            yield f"{f.name} {value} is not within {least:g}..{most:g}"
    params: object = c.params
    if not isinstance(params, Mapping):
        yield f"params {params!r} is not a mapping of parameters' names to numbers"
        return
    for name, value in params.items():
        if not isinstance(name, str) or isinstance(value, bool) or not isinstance(value, Real):
            yield f"params: {name!r}: {value!r} is not a parameter's name and a number"


def _wrong_words(c: StubConfig) -> Iterator[str]:
    for name, choices in CHOICES.items():
        if getattr(c, name) not in choices:
            yield f"{name} {getattr(c, name)!r} is none of {', '.join(word for word in choices if word)}"
    for name in ("gps", "radio"):
        if not isinstance(getattr(c, name), bool):
            yield f"{name} {getattr(c, name)!r} is neither True nor False"
    if c.mavlink_version not in (1, 2):
        yield f"mavlink_version {c.mavlink_version} is neither 1 nor 2"
    if not isinstance(c.signing_key, bytes) or len(c.signing_key) not in (0, 32):
        yield "signing_key is not 32 bytes"
    elif c.signing_key and c.mavlink_version == 1:
        yield "signing_key with mavlink_version 1: only MAVLink 2 can be signed, leave one of the two out"


def _wrong_windows(c: StubConfig) -> Iterator[str]:
    windows: object = c.range_dropouts_s
    if not isinstance(windows, tuple | list):
        yield f"range_dropouts_s {windows!r} is not a tuple of (from, to) in seconds"
        windows = ()
    for window in windows:
        if not _is_window(window):
            yield f"dropout {window} is not (from, to) in seconds with from before to"
    if not c.device and c.range_message != "distance_sensor" and c.range_beacon_id > 255:
        yield f"range_beacon_id {c.range_beacon_id} is not within 0..255, which is all that {c.range_message} carries"
    if c.start_speed_m_s > 0.0 and c.start_height_m == 0.0:
        yield f"start_speed_m_s {c.start_speed_m_s} is that of an airborne start, and start_height_m is 0"
    if c.device and not c.radio:
        yield f"device {c.device!r} is the radio, and radio=False leaves none on board"
    if c.device and c.range_link == "ranging":
        yield f"range_link 'ranging' is for messages, and device {c.device!r} sends none"
    if c.device:
        try:
            DEVICES[c.device](c.range_beacon_id)
        except ValueError as error:
            yield str(error)


def _is_window(window: object) -> bool:
    if not isinstance(window, tuple | list) or len(window) != 2:
        return False
    if not all(isinstance(end, Real) and not isinstance(end, bool) for end in window):
        return False
    return bool(window[0] <= window[1])  # NaN never is


def _wrong_parameters(c: StubConfig) -> Iterator[str]:
    known = Parameters(c.airframe == "fixed_wing")
    for name, value in c.params.items():
        try:
            known.check(name, value)
            if name == "MAV_SYS_ID" and value != c.system_id:
                yield f"parameter MAV_SYS_ID cannot be {value}: it is system_id, {c.system_id}; set that instead"
        except ValueError as error:
            yield str(error)


def _wrong_lines(c: StubConfig) -> Iterator[str]:
    lines: object = c.faults
    if isinstance(lines, str):
        yield "faults is one line: write a tuple of lines"
        return
    if not isinstance(lines, tuple | list):
        yield f"faults {lines!r} is not a tuple of lines"
        return
    known = Parameters(c.airframe == "fixed_wing")
    for line in lines:
        if not isinstance(line, str):
            yield f"fault {line!r} is not a line of text"
            continue
        try:
            fault = parse(line)
            if fault.kind == "param":
                known.check(*assigned(fault))
                if assigned(fault)[0] == "MAV_SYS_ID":
                    raise ValueError("parameter MAV_SYS_ID is system_id, which stays as it is for a whole flight")
            if why := _cannot_act(c, fault):
                yield f"fault {line!r} cannot act: {why}"
        except ValueError as error:
            yield str(error) if repr(line) in str(error) else f"fault {line!r}: {error}"


def _cannot_act(c: StubConfig, fault: Fault) -> str:
    """Return why a fault of the ranges would change nothing, or nothing that can be sent; "" if it acts."""
    if not fault.kind.startswith("range-"):
        return ""
    if not c.radio:
        return "there is no radio on board (radio=False)"
    format_ = c.device or c.range_message
    if fault.kind == "range-orientation" and format_ != "distance_sensor":
        return f"{format_} carries no orientation"
    if fault.kind == "range-id" and c.device and c.device not in WITH_ID:
        return f"{format_} carries no id"
    if fault.kind == "range-value" and math.isnan(float(fault.words[0])) and format_ in INTEGER_RANGES:
        return f"{format_} carries a whole number, never NaN; range-invalid is its way to have no range"
    return ""
