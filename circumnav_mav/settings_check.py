"""What an autopilot's own parameters mean for a flight, by the rows of settings_table.py. Pure.

The first row of a parameter that holds is the one that is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import IntEnum
from math import inf, isfinite, nan
from typing import NamedTuple

from circumnav_mav.config import Config


class Severity(IntEnum):
    """How bad a finding is."""

    OK = 0
    WARNING = 1
    ERROR = 2


class Finding(NamedTuple):
    """One row of what `check --live` prints. fix: empty where nothing is to be done."""

    severity: Severity
    what: str
    text: str
    fix: str = ""


class Facts(NamedTuple):
    """What the rows look at besides the parameter."""

    has_rc: bool  # a receiver or joystick is heard
    sysid: int  # the vehicle's
    speed_m_s: float  # to fly, and
    bank_deg: float  # at most to bank; NaN for what does not turn by a bank
    height_m: float  # to take off to, with engage: auto; -inf otherwise
    parameters: Mapping[str, float]


class Row(NamedTuple):
    """A value, or a range of them, of one parameter. `{v}` in the texts is the value, `{f.…}` a fact."""

    parameter: str
    holds: Callable[[float, Facts], bool]
    severity: Severity
    does: str
    fix: str = ""


def facts(config: Config, *, has_rc: bool, sysid: int, parameters: Mapping[str, float]) -> Facts:
    """Return what the rows look at, for a configuration."""
    banks, auto = config.vehicle_class.banks, config.engage == "auto"
    return Facts(
        has_rc=has_rc,
        sysid=sysid,
        speed_m_s=config.orbit.speed_m_s,
        bank_deg=config.limits.bank_deg if banks else nan,
        height_m=(config.orbit.height_m or -inf) if auto else -inf,
        parameters=parameters,
    )


def judged(rows: Iterable[Row], f: Facts) -> Iterator[Finding]:
    """Yield a finding for each parameter: what the value that was read will do."""
    told: set[str] = set()
    for row in rows:
        value = f.parameters.get(row.parameter)
        if row.parameter in told:
            continue
        if value is None:
            told.add(row.parameter)
            fix = "listen longer: --seconds 30; or this version of the autopilot does not have it"
            yield Finding(Severity.WARNING, row.parameter, "the autopilot did not say", fix)
        elif isfinite(value) and row.holds(value, f):
            told.add(row.parameter)
            text = row.does.format(v=value, f=f)
            if not text.startswith(f"{value:g} "):
                text = f"{value:g}: {text}"
            yield Finding(row.severity, row.parameter, text, row.fix.format(v=value, f=f, with_2=int(value) | 2))
    for name in sorted({row.parameter for row in rows} - told):
        text = f"{f.parameters[name]:g}: not a value that is known"
        yield Finding(Severity.WARNING, name, text, "look it up in the autopilot's parameter reference")
