"""What a vehicle class is: what it fits, what it needs of the autopilot, and how a turn rate becomes a message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, tan
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.commands import Command
from circumnav_mav.mavlink.modes import ModeWords
from circumnav_mav.mavlink.setpoints import G_M_S2, Encoded, SetpointLimits
from circumnav_mav.types import TurnRateSetpoint

ATTITUDE = ("ATTITUDE",)
VELOCITY = ("LOCAL_POSITION_NED",)
AIRSPEED = ("VFR_HUD",)
ESTIMATOR = ("ESTIMATOR_STATUS", "EKF_STATUS_REPORT")
HEIGHT = ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "VFR_HUD")
"""Groups of messages of which a class needs one."""
SPEED_OF = {"ground": VELOCITY, "air": AIRSPEED, "believed": ATTITUDE}
"""What brings the speed of the law, by VehicleClass.speed."""
NO_ATTITUDE = "no attitude from the autopilot"
NO_PLACE = "no place and course from the autopilot"

Defaults: TypeAlias = Mapping[str, Any]
"""Sections of the configuration with the values that suit a class, `law` and `estimator` always among them."""

PAPER: Defaults = {"law": {"name": "hashemi2013"}, "estimator": {"name": "direct"}}
"""For what holds its ground speed: wind is no concern of the law then."""

IN_WIND: Defaults = {"law": {"name": "tangent"}, "estimator": {"name": "drift"}}
"""For what flies at an airspeed: in wind of a third of it every law on range and range rate alone loses flights."""

HIGH: Defaults = {**IN_WIND, "ranging": {"target_height_m": "auto"}}
"""A plane circles about as high as its circle is wide, where a slant range is anything but a horizontal one."""

SMALL_PLANE: Defaults = {
    **HIGH,
    "orbit": {"radius_m": 80.0, "speed_m_s": 12.0},
    "limits": {"turn_accel_rad_s2": 0.5},  # the bank changes by 35 deg/s at most, half of PX4's FW_R_RMAX
}


class Options(NamedTuple):
    """What an encoder is built from: limits and the vehicle's own numbers (NaN = learned in flight)."""

    limits: SetpointLimits
    speed_m_s: float  # the speed to fly
    bank_rad: float
    lead_s: float
    pitch_rad: float  # nose-up pitch in straight flight at that speed
    thrust: float  # 0..1, in level flight


class Encoder(Protocol):
    """One flight's encoder; it may learn and integrate, and is called once a tick while setpoints leave."""

    @property
    def lacks(self) -> str:
        """What it still has to learn before it can fly, in words; empty when it can. Till then it encodes None."""
        ...

    @property
    def misses(self) -> str:
        """What the last `encode` could not do without, in words; empty where it made a setpoint."""
        ...

    def encode(self, setpoint: TurnRateSetpoint, state: VehicleState, now_s: float) -> Encoded | None:
        """Return (message name, fields); None where what it needs is not heard: the autopilot then sees silence.

        A setpoint of speed 0 means to stay: place, or level flight for what cannot.
        """
        ...

    def engaged(self, state: VehicleState, height_m: float) -> list[Command]:
        """Return the commands to give once, as control begins; height_m: the height to hold above home."""
        ...


@dataclass(frozen=True, slots=True)
class TakeOff:
    """How `engage: auto` gets into the air."""

    first_mode: int | None
    """Asked for on the ground, before arming."""
    command: Literal["amsl", "relative", "none"]
    """What MAV_CMD_NAV_TAKEOFF's height counts from; none: the first mode takes off by itself."""
    climbing: frozenset[int]
    """Modes seen on the way up; any other is the pilot's choice."""
    arrived: int
    """The mode at the top."""
    level_s: float = 0.0
    """Time of level flight at the top before control is asked for (a plane's trim is learned then)."""
    height_parameter: str = ""
    """The autopilot's parameter that decides the height, where no command carries it."""
    arm_patience_s: float = 10.0
    """Arming that is refused is tried again for so long: the reason may pass, and ArduPilot says STANDBY too early."""


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """A registered vehicle class; docs/vehicles.md says what each can and cannot do."""

    name: str
    airframe: str  # for people, and for the stub
    words: ModeWords
    autopilot: int  # MAV_AUTOPILOT
    types: frozenset[int]  # MAV_TYPE
    messages_hz: Mapping[str, float]
    needs: tuple[tuple[str, ...], ...]  # of each group one message must come
    estimates: frozenset[str]  # "velocity", "position": what the autopilot must say that it knows
    speed: Literal["ground", "air", "believed"]  # what the law takes for the speed
    turn_lag_s: float  # 63 % of a step in turn rate, measured
    encoder: Callable[[Options], Encoder]
    defaults: Defaults  # where the file says nothing
    take_off: TakeOff | None = None
    lead_s: float = 0.0  # lag of the course behind the nose, measured, taken out by turning the velocity ahead
    banks: bool = False  # turns by limits.bank_deg
    turn_share: float = 1.0  # of a coordinated turn's rate, which a bank gives for sure
    lateral_m_s2: float = inf  # acceleration across the course that the autopilot gives at most
    attitude: bool = False  # flies by attitude: takes vehicle.pitch_deg and vehicle.thrust
    wants_pitch: bool = False  # cannot fly without vehicle.pitch_deg
    hands_over: bool = True  # can ask for Hold, Return and Land: they need a position

    @property
    def senses(self) -> frozenset[str]:
        """What an estimator can be sure of: that which some group of `needs` always brings."""
        groups = [set(group) for group in self.needs]
        bringers = {"turn_rate": ATTITUDE, "heading": ATTITUDE, "speed": SPEED_OF[self.speed]}
        return frozenset(what for what, by in bringers.items() if any(group <= set(by) for group in groups))

    def turn_rate_limit(self, turn_rate_rad_s: float, bank_rad: float, speed_m_s: float) -> float:
        """Return the turn rate [rad/s] that limits, bank and lateral acceleration all allow at a speed."""
        lateral = min(self.lateral_m_s2, self.turn_share * G_M_S2 * tan(bank_rad) if self.banks else inf)
        return min(turn_rate_rad_s, lateral / speed_m_s)
