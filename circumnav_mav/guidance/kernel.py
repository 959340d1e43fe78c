"""What laws and estimators are made of, written once for flying and for the study.

A kernel is a plain scalar function on floats and NamedTuples of floats that calls nothing but `math` and other kernels:
the flying loop calls it as it is, the study compiles the very same function. A missing value is NaN, never None.

Axes: x east, y north, heading psi counter-clockwise from east, turn rate u = psi-dot; theta is the bearing from the
line of sight (towards the target) to the heading, so that r_dot = -V cos(theta) (NOTES: the paper's polar form).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from circumnav_mav.guidance.bounds import Bound

NAN = math.nan


class Motion(NamedTuple):
    """How the vehicle moves now, by its own sensors: what an estimator is carried with."""

    V: float = NAN  # speed the law uses: ground speed (multirotor) or true airspeed (plane), m/s
    u: float = NAN  # turn rate flown (measured yaw rate, else the last command), rad/s, + counter-clockwise
    psi: float = NAN  # heading, rad, counter-clockwise from east; NaN without a compass
    ahead: float = NAN  # velocity at this moment in the axes of the heading, m/s; NaN: V straight ahead
    left: float = NAN


class Estimate(NamedTuple):
    """What an estimator knows of the target at a tick, and what a law steers by."""

    r: float = NAN  # range, m
    r_dot: float = NAN  # range rate, m/s, + opening
    V: float = NAN  # speed, m/s
    u: float = NAN  # turn rate flown now, rad/s
    theta: float = NAN  # bearing from the line of sight to the heading, rad
    psi: float = NAN  # heading, rad
    px: float = NAN  # target minus vehicle, east, m
    py: float = NAN  # target minus vehicle, north, m
    wx: float = NAN  # drift = wind minus target velocity, east, m/s
    wy: float = NAN  # drift, north, m/s


def mirror(est: Estimate) -> Estimate:
    """Return the estimate reflected in the east axis: laws are written for the clockwise orbit only.

    An anticlockwise orbit is `-law(mirror(est), par)`. r, r_dot and V do not change in a mirror.
    """
    return Estimate(est.r, est.r_dot, est.V, -est.u, -est.theta, -est.psi, est.px, -est.py, est.wx, -est.wy)


class Rival(NamedTuple):
    """Where one of several hypotheses has the target, and how surely: what a law may fear while they do not agree."""

    share: float  # of the belief
    px: float  # target minus vehicle at the tick, m
    py: float
    wx: float  # drift, m/s
    wy: float
    xx: float  # covariance of (p, w) as of the last range; u, v: the two components of w
    xy: float
    xu: float
    xv: float
    yy: float
    yu: float
    yv: float
    uu: float
    uv: float
    vv: float


NOBODY = Rival(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def no_rivals(bank: list[Any], m: Any) -> list[Rival]:
    """Return none: the hypotheses have no place, or are as good as one."""
    rivals = [NOBODY]
    rivals.pop()  # the compiler must see of what the list would be
    return rivals


def no_escape(u: float, est: Estimate, rivals: list[Rival], par: Any) -> float:
    """Return the law's own turn rate: it knows nothing of rivals."""
    return u


@dataclass(frozen=True, slots=True)
class LawContext:
    """What a law may know of the flight when its parameters are made. NaN where nothing is configured."""

    r_a: float  # orbit radius, m
    V: float  # configured speed, m/s
    turn_rate_limit: float  # rad/s
    turn_lag_s: float  # first-order lag of the turn rate of this vehicle class, s
    r_min: float = NAN  # least range allowed, m


@dataclass(frozen=True, slots=True)
class Law:
    """A registered guidance law: the plug that config, check, compare and the shared tests read."""

    name: str
    turn_rate: Callable[[Estimate, Any], float]  # (estimate, parameters) -> u [rad/s] for the clockwise orbit
    parameters: Callable[[Mapping[str, float], LawContext], Any]  # options -> NamedTuple of floats; ValueError in words
    options: Mapping[str, float]  # every key of the `law:` section with its default; NaN = not given
    needs: tuple[str, ...]  # fields of Estimate that must be finite
    source: str  # paper and equation
    escape: Callable[[float, Estimate, list[Rival], Any], float] = no_escape
    """(u, estimate, rivals, parameters) -> u: what is flown in place of the law's u where hypotheses do not agree. It
    sees the world as it is, whichever way round the orbit goes."""
    bounds: Mapping[str, Bound] = field(default_factory=dict)  # of options, as far as they have any


class Reading(NamedTuple):
    """One range as an estimator's kernel takes it."""

    r: float  # range, m
    r_dot: float = NAN  # range rate, m/s, + opening; NaN: the sensor has none
    sigma_r: float = NAN  # standard deviation that the sensor claims, m; NaN: the estimator's own


class Moved(NamedTuple):
    """How the vehicle moved between two times by its own reckoning: estimates are carried by this and nothing else."""

    dt: float  # s
    ahead: float  # displacement along the heading it had at the first time, m
    left: float  # displacement to the left of that heading, m
    turn: float  # change of heading, rad, + counter-clockwise
    V: float  # speed at the second time, m/s
    u: float  # turn rate at the second time, rad/s
    psi: float  # compass heading at the second time, rad; NaN without a compass


class Memory(NamedTuple):
    """What an estimator remembers besides its hypotheses: the same few numbers for all of them."""

    known: float = 0.0  # 1 once the estimate is fit to fly on
    verdict: float = 0.0  # on the last reading: ACCEPTED, OUTLIER, RESTARTED or RETURNED
    nis: float = NAN  # normalised innovation squared of the last reading that was used
    alarm: float = 0.0  # smoothed evidence that the hypotheses do not explain the readings
    rival_r: float = NAN  # the range that readings refused by the gate agree on, m
    rival_age: float = 0.0  # since the rival was last confirmed, s
    votes: float = 0.0  # for the rival, less those against it; 1 wins
    error: float = NAN  # the last reading, used or not, minus the range that the leader had expected, m
    shelf_s: float = NAN  # how long a belief that fell has been kept, the last of the bank; NaN: none is
    shelf_votes: float = 0.0  # for that one, less those against it
    stood_s: float = 0.0  # for how long readings have spoken for the belief: a few seconds at most


ACCEPTED, OUTLIER, RESTARTED, RETURNED = 0.0, 1.0, 2.0, 3.0


@dataclass(frozen=True, slots=True)
class EstimatorContext:
    """What an estimator may know of the flight when its parameters are made."""

    r_a: float  # orbit radius, m
    V: float  # configured speed, m/s
    turn_rate_limit: float  # rad/s
    side: float = 1.0  # the side the target is wanted on: +1 right (clockwise orbit), -1 left


@dataclass(frozen=True, slots=True)
class Estimator:
    """A registered estimator: kernels over a bank of hypotheses (a list of NamedTuples, changed in place).

    The bank stands at the time of the last reading; `carry` takes it to any later one without changing it.
    """

    name: str
    begin: Callable[[Any], list[Any]]  # parameters -> an empty bank
    observe: Callable[[list[Any], Memory, Moved, Reading, Any], Memory]  # predict by Moved, gate, update
    carry: Callable[[list[Any], Memory, Moved, Any], Estimate]  # the estimate after Moved
    covariance: Callable[[list[Any]], tuple[float, ...]]  # (var r, then what the module says), for logs
    parameters: Callable[[Mapping[str, float], EstimatorContext], Any]  # ValueError in words
    options: Mapping[str, float]  # every key of the `estimator:` section with its default; NaN = not given
    needs: frozenset[str]  # of SOURCES
    gives: frozenset[str]  # fields of Estimate that are finite once known
    source: str
    places: Callable[[list[Any]], list[tuple[float, float]]] | None = None
    """Where each hypothesis has the target, m, all in one frame; None where the estimator has no place."""
    rivals: Callable[[list[Any], Moved], list[Rival]] = no_rivals
    """The likely hypotheses after Moved, while they do not agree; empty once they are as good as one."""
    bounds: Mapping[str, Bound] = field(default_factory=dict)
    """Of options, as far as they have any."""


SOURCES = frozenset({"range", "speed", "turn_rate", "heading"})
"""What an estimator can ask of sensors: ranges of ranging.source, the rest of the autopilot (speed: the one that the
vehicle class flies by). A configuration whose class does not have what its estimator needs is refused."""
