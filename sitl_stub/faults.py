"""Faults on a timeline, one line each, the same in lockstep and in real time; equal seeds give equal flights.

    FROM-TO KIND ARGUMENTS      a state that holds from FROM to TO [s since boot]
    AT KIND ARGUMENTS           something that happens at AT

FAULTS below is the list of kinds with what they mean; `parse` turns a line into a Fault or says what is wrong with it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

from sitl_stub.modes import Mode

WIND_MOST_M_S = 100.0
FAR_M = 1e6  # the flat world ends somewhere
REORDER_S = 0.1  # a reordered frame comes up to this much later than it should


@dataclass(frozen=True, slots=True)
class Fault:
    """One line of the timeline; to_s is infinite for what merely happens at from_s."""

    from_s: float
    to_s: float
    kind: str
    words: tuple[str, ...]  # its arguments
    line: str


def _within(low: float, high: float) -> Callable[[str], None]:
    def check(text: str) -> None:
        if not low <= float(text) <= high:
            raise ValueError(f"it goes from {low:g} to {high:g}")

    return check


def _share(text: str) -> None:
    _within(0.0, 1.0)(text)


def _pair_within(most: float) -> Callable[[str], None]:
    def check(text: str) -> None:
        parts = [float(part) for part in text.split(",")]
        if len(parts) != 2 or not all(abs(part) <= most for part in parts):
            raise ValueError(f"two numbers with a comma between them, of {most:g} at most")

    return check


def _one_of(*names: str) -> Callable[[str], None]:
    def check(text: str) -> None:
        if text not in names:
            raise ValueError(f"one of {', '.join(names)}")

    return check


def _assignment(text: str) -> None:
    name, equals, value = text.partition("=")
    if not name or not equals or not math.isfinite(float(value)):
        raise ValueError("a finite number is wanted")


def _byte(text: str) -> None:
    if not 0 <= int(text) <= 255:
        raise ValueError("it goes from 0 to 255")


_DIRECTION = _one_of("in", "out")
_RANGE = _within(-1e9, 1e9)


def _range_or_none(text: str) -> None:
    if not math.isnan(float(text)):
        _RANGE(text)


_DELAY_MOST_S, _CLOCK_MOST_S = 3600.0, 1e6
MODES = {mode.name.lower(): mode for mode in Mode}

# kind -> (whether it lasts, checks of its arguments, how the arguments are written, what it does)
FAULTS: dict[str, tuple[bool, tuple[Callable[[str], None], ...], str, str]] = {
    "silence": (True, (), "", "no frame of the companion's link passes, either way"),
    "drop": (
        True,
        (_DIRECTION, _share),
        "in|out SHARE",
        "a share of the companion link's frames is lost on the way in or out",
    ),
    "delay": (
        True,
        (_DIRECTION, _within(0.0, _DELAY_MOST_S)),
        "in|out SECONDS",
        "every frame of the companion's link comes later",
    ),
    "duplicate": (True, (_DIRECTION, _share), "in|out SHARE", "a share of the companion link's frames comes twice"),
    "reorder": (
        True,
        (_DIRECTION, _share),
        "in|out SHARE",
        "a share of the companion link's frames is overtaken by later ones",
    ),
    "corrupt": (
        True,
        (_DIRECTION, _share),
        "in|out SHARE",
        "a byte of a share of the companion link's frames is wrong",
    ),
    "range-stop": (True, (), "", "the radio measures nothing"),
    "range-stick": (True, (), "", "the radio repeats its last range"),
    "range-add": (True, (_RANGE,), "METRES", "every range is wrong by so much"),
    "range-value": (True, (_range_or_none,), "METRES", "every range reads this: 0, 655.35, 1e6, nan (where it fits)"),
    "range-invalid": (True, (), "", "no range, in the format's own way; DISTANCE_SENSOR: quality 1 and 0 cm"),
    "range-id": (True, (_byte,), "ID", "ranges come with another sensor id, or beacon id"),
    "range-orientation": (True, (_byte,), "ORIENTATION", "DISTANCE_SENSOR comes with another orientation"),
    "refuse-arm": (True, (), "", "arming is refused"),
    "refuse-offboard": (True, (), "", "OFFBOARD is refused, and lost if it is flown"),
    "deaf": (True, (), "", "setpoints are ignored"),
    "no-gps": (True, (), "", "there is no position estimate"),
    "foreign": (True, (_byte,), "SYSTEM_ID", "another PX4 talks on the companion's link, perhaps with our id"),
    "reboot": (False, (), "", "the autopilot boots: two seconds of silence, disarmed, time from zero"),
    "clock": (False, (_within(-_CLOCK_MOST_S, _CLOCK_MOST_S),), "SECONDS", "the autopilot's clock jumps (1e6 at most)"),
    "gcs": (False, (_one_of(*MODES),), "MODE", "a ground station asks for a mode: hold, posctl, rtl, land, ..."),
    "param": (False, (_assignment,), "NAME=VALUE", "a parameter changes"),
    "wind": (False, (_pair_within(WIND_MOST_M_S),), "EAST,NORTH", "the wind becomes this [m/s]"),
    "beacon": (False, (_pair_within(FAR_M),), "EAST,NORTH", "the beacon is put here [m]"),
}


def parse(line: str) -> Fault:
    """Return the fault of one line. ValueError in words."""
    words = line.split()
    if len(words) < 2:
        raise ValueError(
            f"fault {line!r}: it reads FROM-TO KIND ARGUMENTS or AT KIND ARGUMENTS, like '40-55 range-stop'"
        )
    when, kind, arguments = words[0], words[1], tuple(words[2:])
    if kind not in FAULTS:
        raise ValueError(f"fault {line!r}: no kind {kind!r}; there are {', '.join(FAULTS)}")
    lasts, checks, usage, _ = FAULTS[kind]
    begin, dash, end = when.partition("-")
    try:
        from_s, to_s = float(begin), float(end) if dash else math.inf
    except ValueError:
        raise ValueError(f"fault {line!r}: {when!r} is neither FROM-TO nor AT in seconds") from None
    if lasts and not (dash and 0.0 <= from_s < to_s):
        raise ValueError(f"fault {line!r}: {kind} lasts, it needs FROM-TO with FROM before TO")
    if not lasts and not dash and not 0.0 <= from_s < math.inf:
        raise ValueError(f"fault {line!r}: it cannot happen at {when} s")
    if not lasts and dash:
        raise ValueError(f"fault {line!r}: {kind} happens at one time, it takes no FROM-TO")
    if len(arguments) != len(checks):
        raise ValueError(f"fault {line!r}: {kind} is written '{'FROM-TO' if lasts else 'AT'} {kind} {usage}'")
    for check, argument in zip(checks, arguments, strict=True):
        try:
            check(argument)
        except ValueError as error:
            raise ValueError(f"fault {line!r}: {argument!r} does not fit '{kind} {usage}': {error}") from None
    return Fault(from_s, to_s, kind, arguments, line)


def assigned(fault: Fault) -> tuple[str, float]:
    """Return name and value of a `param` line."""
    name, _, value = fault.words[0].partition("=")
    return name, float(value)


class Timeline:
    """Tells which faults begin and end as time goes on."""

    def __init__(self, lines: tuple[str, ...]) -> None:
        faults = [parse(line) for line in lines]
        changes = [(f.from_s, i, True, f) for i, f in enumerate(faults)]
        changes += [(f.to_s, i, False, f) for i, f in enumerate(faults) if math.isfinite(f.to_s)]
        self.faults = faults
        self._changes = sorted(changes, key=lambda c: (c[0], c[2], c[1]))
        self._next = 0
        self.next_s = self._next_change_s()

    def _next_change_s(self) -> float:
        return self._changes[self._next][0] - 1e-9 if self._next < len(self._changes) else math.inf

    def until(self, now_s: float) -> list[tuple[Fault, bool]]:
        """Return the faults that began (True) or ended (False) by now_s since the last call."""
        found = []
        while self._next < len(self._changes) and self._changes[self._next][0] <= now_s + 1e-9:
            _, _, begins, fault = self._changes[self._next]
            found.append((fault, begins))
            self._next += 1
        self.next_s = self._next_change_s()
        return found


class Disturbance:
    """What happens to frames on their way in one direction, while faults of that direction are active."""

    def __init__(self, seed: int, direction: str) -> None:
        self.active: list[Fault] = []
        self._random = random.Random(f"{seed}:{direction}")

    def __call__(self, raw: bytes) -> list[tuple[float, bytes]]:
        """Return (delay [s], frame) for everything that becomes of one frame."""
        frames = [(0.0, raw)]
        for fault in self.active:
            frames = [out for delay_s, one in frames for out in self._disturb(fault, delay_s, one)]
        return frames

    def _disturb(self, fault: Fault, delay_s: float, raw: bytes) -> list[tuple[float, bytes]]:
        if fault.kind == "silence":
            return []
        amount = float(fault.words[1])
        if fault.kind == "delay":
            return [(delay_s + amount, raw)]
        if self._random.random() >= amount:
            return [(delay_s, raw)]
        if fault.kind == "drop":
            return []
        if fault.kind == "duplicate":
            return [(delay_s, raw), (delay_s, raw)]
        if fault.kind == "reorder":
            return [(delay_s + REORDER_S * self._random.random(), raw)]
        at, flip = self._random.randrange(len(raw)), self._random.randrange(1, 256)
        return [(delay_s, raw[:at] + bytes((raw[at] ^ flip,)) + raw[at + 1 :])]


FRAME_FAULTS = frozenset({"silence", "drop", "delay", "duplicate", "reorder", "corrupt"})
