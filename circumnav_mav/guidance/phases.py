"""The phases of a flight as ONE transition table: first row that applies, top to bottom, one step a tick."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple


class Phase(StrEnum):
    """Where a flight is; the words that logs, the live view and the ground station show."""

    WAITING_AUTOPILOT = "waiting_autopilot"
    WAITING_RANGE = "waiting_range"
    READY = "ready"
    ACQUIRING = "acquiring"
    ORBITING = "orbiting"
    COASTING = "coasting"
    RANGE_LOST = "range_lost"
    BROKEN_OFF = "broken_off"
    RELEASED = "released"
    FINISHED = "finished"


class Facts(NamedTuple):
    """What the table looks at."""

    heard: bool = False  # the autopilot is there
    held: bool = False  # the autopilot shows that we fly
    handing_over: bool = False  # held, and we are giving it back
    released: bool = False  # it was taken from us; latched
    ending: bool = False  # the flight is asked to end
    fresh: bool = False  # a range not older than max_age_s, and an estimate from it
    coastable: bool = False  # the estimate may still be flown on: not older than coast_s
    settled: bool = False  # inside the orbit band for a while
    strayed: bool = False  # far outside it for a while
    broken: bool = False  # a cause of safety.py calls for an action


ALL = frozenset(Phase) - {Phase.FINISHED}
ENGAGED = frozenset({Phase.ACQUIRING, Phase.ORBITING, Phase.COASTING})
WITH_RANGE = frozenset({Phase.ACQUIRING, Phase.ORBITING})


class Row(NamedTuple):
    """From any of `leave`, if `when` holds, to `enter`; `reason` is for people ({why} = what the authority says)."""

    leave: frozenset[Phase]
    when: Callable[[Facts], bool]
    enter: Phase
    reason: str


def _in(*phases: Phase) -> frozenset[Phase]:
    return frozenset(phases)


TABLE: tuple[Row, ...] = (
    Row(ALL - _in(Phase.RELEASED), lambda f: f.released, Phase.RELEASED, "{why}"),
    Row(ALL, lambda f: f.ending and not f.held, Phase.FINISHED, "{why}"),
    Row(_in(Phase.RELEASED), lambda f: not f.released, Phase.WAITING_AUTOPILOT, "{why}"),
    Row(
        ALL - _in(Phase.WAITING_AUTOPILOT, Phase.RELEASED),
        lambda f: not f.heard,
        Phase.WAITING_AUTOPILOT,
        "the autopilot is not heard any more",
    ),
    Row(_in(Phase.WAITING_AUTOPILOT), lambda f: f.heard, Phase.WAITING_RANGE, "the autopilot is heard"),
    Row(
        ENGAGED | _in(Phase.WAITING_RANGE, Phase.READY, Phase.RANGE_LOST),
        lambda f: f.held and not f.handing_over and f.broken,
        Phase.BROKEN_OFF,
        "{why}",
    ),
    Row(_in(Phase.BROKEN_OFF), lambda f: not f.held, Phase.WAITING_RANGE, "{why}"),
    Row(
        _in(Phase.WAITING_RANGE, Phase.READY),
        lambda f: f.held and not f.handing_over and not f.fresh,
        Phase.RANGE_LOST,
        "engaged without a range",
    ),
    Row(_in(Phase.WAITING_RANGE, Phase.READY), lambda f: f.held and not f.handing_over, Phase.ACQUIRING, "{why}"),
    Row(_in(Phase.WAITING_RANGE), lambda f: f.fresh, Phase.READY, "the beacon is heard"),
    Row(_in(Phase.READY), lambda f: not f.fresh, Phase.WAITING_RANGE, "no range from the beacon"),
    Row(WITH_RANGE, lambda f: not f.fresh and not f.coastable, Phase.RANGE_LOST, "no range, and no estimate to carry"),
    Row(WITH_RANGE, lambda f: not f.fresh, Phase.COASTING, "no fresh range: the estimate is carried"),
    Row(_in(Phase.COASTING), lambda f: f.fresh, Phase.ACQUIRING, "the range is back"),
    Row(_in(Phase.COASTING), lambda f: not f.coastable, Phase.RANGE_LOST, "no range for longer than coast_s"),
    Row(_in(Phase.ACQUIRING), lambda f: f.settled, Phase.ORBITING, "settled on the orbit"),
    Row(_in(Phase.ORBITING), lambda f: f.strayed, Phase.ACQUIRING, "strayed from the orbit"),
    Row(_in(Phase.RANGE_LOST), lambda f: not f.held and f.fresh, Phase.READY, "the beacon is heard again"),
    Row(
        _in(Phase.RANGE_LOST),
        lambda f: f.held and not f.handing_over and f.fresh,
        Phase.ACQUIRING,
        "engaged again, and the range is back",
    ),
)


def step(phase: Phase, facts: Facts, why: str) -> tuple[Phase, str] | None:
    """Return the next phase and its reason, None to stay."""
    for row in TABLE:
        if phase in row.leave and row.when(facts):
            return row.enter, row.reason.format(why=why)
    return None
