"""Where the vehicle has been by its own reckoning, for the last seconds: what carries an estimate between two times.

A range that comes late belongs to a place behind the vehicle. Ticks add to the trail; `between` gives the motion from
any time on it to any later one, so that the estimate waits at the last sample and nothing is ever replayed.
"""

from __future__ import annotations

from collections import deque
from math import cos, isnan, pi, sin
from typing import NamedTuple

from circumnav_mav.guidance.kernel import Motion, Moved


class Place(NamedTuple):
    t_s: float
    x: float  # m, in axes fixed at the start
    y: float
    heading: float  # rad, unwrapped, in the same axes
    north: float  # what to add to `heading` for the compass heading, rad; NaN until there was a compass


def sinc(x: float) -> float:
    return 1.0 - x * x / 6.0 if abs(x) < 1e-3 else sin(x) / x


def onward(place: Place, t_s: float, motion: Motion) -> Place:
    """Return the place after flying `motion` until `t_s`: one exact arc, turned by the compass where there is one."""
    dt = t_s - place.t_s
    turn, north = motion.u * dt, place.north
    if not isnan(motion.psi):
        if isnan(north):
            north = motion.psi - (place.heading + turn)
        else:
            turn = (motion.psi - place.heading - north + pi) % (2.0 * pi) - pi
    measured = not (isnan(motion.ahead) or isnan(motion.left))
    chord = dt * sinc(0.5 * turn)
    ahead, left = (motion.ahead * chord, motion.left * chord) if measured else (motion.V * chord, 0.0)
    middle = place.heading + 0.5 * turn
    c, s = cos(middle), sin(middle)
    return Place(t_s, place.x + ahead * c - left * s, place.y + ahead * s + left * c, place.heading + turn, north)


def between(a: Place, b: Place, motion: Motion) -> Moved:
    """Return the motion from one place to another, with the speed and turn rate of `motion` at the second."""
    t0_s, x0, y0, heading, _ = a
    t_s, x, y, later, north = b
    dx, dy, c, s = x - x0, y - y0, cos(heading), sin(heading)
    return Moved(t_s - t0_s, dx * c + dy * s, dy * c - dx * s, later - heading, motion.V, motion.u, later + north)


class Trail:
    """The last `span_s` seconds of dead reckoning.

    slips: take the velocity where it is measured, which need not point along the heading. To an estimator whose state
    is an angle to the heading it does, for its rate is V cos of that angle.
    """

    def __init__(self, span_s: float, speed_m_s: float, *, slips: bool = True) -> None:
        self._span_s, self._slips = span_s, slips
        self._places: deque[Place] = deque()
        self._motion = Motion(V=speed_m_s, u=0.0)

    def __bool__(self) -> bool:
        return bool(self._places)

    def known(self, motion: Motion) -> Motion:
        """Return the motion with the last known speed and turn rate where a sensor is silent."""
        if not self._slips and not isnan(motion.ahead):
            motion = Motion(motion.V, motion.u, motion.psi)
        if not (isnan(motion.V) or isnan(motion.u)):
            return motion
        last = self._motion
        V, u = last.V if isnan(motion.V) else motion.V, last.u if isnan(motion.u) else motion.u
        return Motion(V, u, motion.psi, motion.ahead, motion.left)

    def advance(self, now_s: float, motion: Motion) -> None:
        """Add the motion flown since the last call. Time that does not go on adds nothing."""
        self._motion = motion = self.known(motion)
        places = self._places
        if not places:
            places.append(Place(now_s, 0.0, 0.0, 0.0, motion.psi))
        elif now_s > places[-1].t_s:
            places.append(onward(places[-1], now_s, motion))
            while places[1].t_s < now_s - self._span_s:
                places.popleft()

    def at(self, t_s: float, motion: Motion) -> Place | None:
        """Return the place at a time: on the trail, or ahead of its end with `motion`. None before it begins."""
        places = self._places
        if not places or t_s < places[0].t_s:
            return None
        later = places[-1]
        if t_s >= later.t_s:
            return onward(later, t_s, self.known(motion)) if t_s > later.t_s else later
        i = len(places) - 2
        while places[i].t_s > t_s:
            i -= 1
        (t0_s, x0, y0, heading0, _), (t1_s, x1, y1, heading1, north) = places[i], places[i + 1]
        f = (t_s - t0_s) / (t1_s - t0_s)
        return Place(t_s, x0 + f * (x1 - x0), y0 + f * (y1 - y0), heading0 + f * (heading1 - heading0), north)

    def between(self, a: Place, b: Place, motion: Motion) -> Moved:
        """Return the motion from one place to another, with the speed and turn rate of `motion` at the second."""
        return between(a, b, self.known(motion))
