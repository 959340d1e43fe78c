"""Whether the autopilot that is heard is the one that a vehicle class is for, and sends what the class flies on.

Asked before control can begin, never after: what is lost in flight is dealt with there.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import isnan, nan
from typing import NamedTuple

from circumnav_mav.mavlink.autopilot import Autopilot
from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.vehicles.plug import VehicleClass

FRESH_S = 2.5
ASK_AGAIN_S = 5.0
ESTIMATE_WORDS = {"velocity": "horizontal velocity", "position": "position"}


class Unfit(NamedTuple):
    """Why control must not begin. final: waiting does not help."""

    text: str
    final: bool = False


class Fitness:
    """Watches until the autopilot is fit; from then on it counts as fit until it restarts, or its messages end.

    An ArduPilot that restarts streams nothing by itself, not even the clock by which a restart is seen.
    """

    def __init__(self, vehicle: VehicleClass, all_classes: Iterable[VehicleClass]) -> None:
        self._vehicle, self._classes = vehicle, tuple(all_classes)
        self._fit_for: tuple[int | None, int] | None = None
        self._ask_next_s = nan

    def unfit(self, ap: Autopilot, now_s: float, *, held: bool = False) -> Unfit | None:
        """Return why control must not begin at `now_s`; None where the autopilot is fit. held: we have control."""
        if ap.sysid is None:
            return None  # not heard: that is said elsewhere
        if self._fit_for == (ap.sysid, ap.reboots):
            if held or not ap.heard(now_s) or not self._missing(ap, now_s):
                return None
            self._fit_for = None
        wrong = self._wrong(ap)
        if wrong is not None:
            return wrong
        lacks = [*self._missing(ap, now_s), *self._unknown(ap)]
        if self._vehicle.speed == "air" and heard(ap, "VFR_HUD", now_s) and isnan(ap.airspeed_m_s):
            lacks.append("no airspeed in VFR_HUD: it needs an airspeed sensor")
        if lacks:
            return Unfit(f"{self._vehicle.name} cannot fly yet: {'; '.join(lacks)}")
        self._fit_for = (ap.sysid, ap.reboots)
        return None

    def ask_again(self, ap: Autopilot, now_s: float) -> list[str]:
        """Return the messages to ask for again: those that are missed, every few seconds while not fit."""
        if ap.sysid is None or self._fit_for == (ap.sysid, ap.reboots):
            return []
        if self._ask_next_s != self._ask_next_s:
            self._ask_next_s = now_s + ASK_AGAIN_S
        if now_s < self._ask_next_s:
            return []
        self._ask_next_s = now_s + ASK_AGAIN_S
        missed = {name for group in self._vehicle.needs for name in group if not heard(ap, name, now_s)}
        return sorted(missed)

    def _wrong(self, ap: Autopilot) -> Unfit | None:
        v = self._vehicle
        if ap.kind == v.autopilot and ap.vehicle_type in v.types:
            return None
        fitting = [c.name for c in self._classes if c.autopilot == ap.kind and ap.vehicle_type in c.types]
        advice = f"set vehicle.class to {' or '.join(fitting)}" if fitting else "no vehicle class fits it"
        return Unfit(
            f"vehicle.class is {v.name}, but system {ap.sysid} is {described(ap.kind, ap.vehicle_type)}: {advice}",
            final=True,
        )

    def _missing(self, ap: Autopilot, now_s: float) -> list[str]:
        return [
            f"no {' or '.join(group)} from the autopilot"
            for group in self._vehicle.needs
            if not any(heard(ap, name, now_s) for name in group)
        ]

    def _unknown(self, ap: Autopilot) -> list[str]:
        unknown = [ESTIMATE_WORDS[what] for what in sorted(self._vehicle.estimates) if not ap.estimates(what)]
        if not unknown:
            return []
        others = [c.name for c in self._classes if self._fits_without(c, ap)]
        advice = f" (without one, {' or '.join(others)} flies)" if others else ""
        return [f"its estimator has no {' and no '.join(unknown)}: wait for GPS, optical flow or vision{advice}"]

    def _fits_without(self, other: VehicleClass, ap: Autopilot) -> bool:
        return other.autopilot == ap.kind and ap.vehicle_type in other.types and not other.estimates


def heard(ap: Autopilot, name: str, now_s: float) -> bool:
    """Return whether a message came lately."""
    return now_s - ap.heard_s.get(name, nan) <= FRESH_S


def described(kind: int, vehicle_type: int) -> str:
    """Return an autopilot and its vehicle in words."""
    return f"{_word('MAV_AUTOPILOT', kind)} on a {_word('MAV_TYPE', vehicle_type)}"


def _word(enum: str, value: int) -> str:
    entry = enums.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").lower() if entry else f"{enum} {value}"
