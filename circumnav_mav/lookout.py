"""What a flight watches besides the pilot and the range: gathers the facts for guidance/safety.py at every tick."""

from __future__ import annotations

from collections import deque
from math import inf, nan, pi

from circumnav_mav.config import Config, safety_limits
from circumnav_mav.guidance.computer import GuidanceComputer
from circumnav_mav.guidance.phases import ENGAGED, Phase
from circumnav_mav.guidance.safety import Facts, Trip, Watch
from circumnav_mav.mavlink.autopilot import Autopilot
from circumnav_mav.mavlink.vehicles.plug import HEIGHT

MINUTE_S = 60.0


class Lookout:
    """One flight's watch. `trip` is the cause that calls for an action now, None while all is well."""

    def __init__(self, config: Config, autopilot: Autopilot, computer: GuidanceComputer) -> None:
        self._autopilot, self._computer = autopilot, computer
        self._estimates = config.vehicle_class.estimates
        self._watch = Watch(*safety_limits(config))
        self._last_s = self._engaged_s = nan
        self._turned_rad = 0.0
        self._restarts = self._returns = 0
        self._restarts_s: deque[float] = deque(maxlen=32)
        self.trip: Trip | None = None

    def look(self, now_s: float, r_m: float, blind: str) -> tuple[list[Trip], str]:
        """Return (causes that began to hold now, what the estimator has just done about its belief, or nothing).

        r_m: estimated range; blind: what the encoder could make no setpoint without at the last tick.
        """
        belief = self._follow(now_s)
        ap, engaged = self._autopilot, self._computer.phase in ENGAGED
        # A silent link is another cause: so heights are as old as they were when the autopilot last spoke.
        height_s = max((ap.heard_s.get(name, -inf) for name in HEIGHT), default=-inf)
        facts = Facts(
            r_m=r_m if engaged and self._computer.entered else nan,
            battery_pct=ap.battery_pct,
            battery_alarm=ap.battery_alarm,
            height_age_s=ap.mode_s - height_s if engaged and height_s > -inf else nan,
            blind=blind if engaged else "",
            estimates_missing=engaged and not all(ap.estimates(what) for what in self._estimates),
            restarts_a_minute=len(self._restarts_s),
            engaged_s=now_s - self._engaged_s,
            laps=abs(self._turned_rad) / (2 * pi),
        )
        self.trip, news = self._watch.check(now_s, facts)
        return news, belief

    def _follow(self, now_s: float) -> str:
        """Keep time, laps and the estimator's restarts while engaged; return what it has just done, or nothing.

        A restart that it took back does not count: echoes had outvoted it, or the flight was led by what was wrong.
        """
        phase, computer = self._computer.phase, self._computer
        restarted = phase in ENGAGED and computer.restarts > self._restarts
        returned = phase in ENGAGED and computer.returns > self._returns
        taken_back = max(0, self._restarts - computer.restarts) + returned
        self._restarts, self._returns = computer.restarts, computer.returns
        if phase not in ENGAGED:
            self._engaged_s, self._turned_rad = nan, 0.0
            self._restarts_s.clear()
        elif not now_s >= self._engaged_s:
            self._engaged_s = now_s
        turn_rate = self._autopilot.turn_rate_rad_s(now_s)
        if phase is Phase.ORBITING and turn_rate == turn_rate:
            self._turned_rad += turn_rate * (now_s - self._last_s)
        if restarted:
            self._restarts_s.append(now_s)
        for _ in range(min(taken_back, len(self._restarts_s))):
            self._restarts_s.pop()
        while self._restarts_s and now_s - self._restarts_s[0] > MINUTE_S:
            self._restarts_s.popleft()
        self._last_s = now_s
        if returned:
            return "the ranges are back where they had been, and so is the estimate"
        return "the ranges outvoted the estimate, which starts again" if restarted else ""
