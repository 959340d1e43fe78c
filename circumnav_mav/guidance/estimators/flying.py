"""An estimator in flight: keeps time and the trail, and lets the kernels do the rest. One class for all of them.

The bank of hypotheses stands at the time of the last sample; `at` carries a copy of it along the trail to the tick. So
a late sample is put where it belongs, a dropout costs nothing, and an estimate is as fresh as the tick.
"""

from __future__ import annotations

from math import copysign, exp, isnan, log, nan, sqrt
from typing import Any

from circumnav_mav.guidance.estimators.noise import NoiseMeter
from circumnav_mav.guidance.kernel import (
    ACCEPTED,
    NAN,
    OUTLIER,
    RESTARTED,
    Estimate,
    Estimator,
    Memory,
    Motion,
    Moved,
    Reading,
    Rival,
)
from circumnav_mav.guidance.trail import Place, Trail
from circumnav_mav.types import RangeSample, Rejected

TRAIL_S = 2.0
"""Samples older than this cannot be placed any more."""


class FlyingEstimator:
    """Samples in at their own times, an estimate out at any tick. Always sees the real, unmirrored world.

    speed_m_s: the configured speed, used until a Motion brings one.
    """

    def __init__(self, estimator: Estimator, parameters: Any, speed_m_s: float) -> None:
        self.name = estimator.name
        self.needs = estimator.needs
        self.gives = estimator.gives
        self._kernels = estimator
        self._par = parameters
        self._speed_m_s = speed_m_s
        self.reset()

    def reset(self) -> None:
        """Know nothing again."""
        self._bank = self._kernels.begin(self._par)
        self._mem = Memory()
        self._trail = Trail(TRAIL_S, self._speed_m_s, slips="heading" in self.needs)
        self._anchor: Place | None = None  # where the bank stands
        self.noise = NoiseMeter()
        self.restarts = 0  # times the readings outvoted the belief since the reset
        self.returns = 0  # times they came back to one that they had outvoted: an echo had won

    def advance(self, now_s: float, motion: Motion) -> None:
        """Take in what was flown since the last call: every control tick, before `at`."""
        self._trail.advance(now_s, motion)

    def on_sample(self, sample: RangeSample, motion: Motion) -> Rejected | None:
        """Use a range at the time it was true, perhaps before the last `advance`. Rejected says why it was not used."""
        if not self._trail:
            self._trail.advance(sample.t_s, motion)
        place = self._trail.at(sample.t_s, motion)
        if place is None:
            return Rejected(sample.t_s, "too_old", f"more than {TRAIL_S:g} s before the last tick, or before the first")
        if self._anchor is None:
            moved = Moved(0.0, 0.0, 0.0, 0.0, self._speed_m_s, NAN, NAN)
        elif sample.t_s > self._anchor.t_s:
            moved = self._trail.between(self._anchor, place, motion)
        else:
            return Rejected(sample.t_s, "out_of_order", "a later range was used before it")
        t_s, range_m, range_rate_m_s, claimed_m = sample.t_s, sample.range_m, sample.range_rate_m_s, sample.sigma_m
        sigma_m = self.noise.sigma(claimed_m)
        reading = Reading(range_m, range_rate_m_s, sigma_m)
        self._mem = mem = self._kernels.observe(self._bank, self._mem, moved, reading, self._par)
        self._anchor = place
        self.noise.add(_own_noise(mem, sigma_m), claimed_m)
        verdict = mem.verdict
        if verdict == ACCEPTED:
            return None
        if verdict == OUTLIER:
            return Rejected(t_s, "outlier", f"{range_m:.1f} m does not fit the ranges before it")
        if verdict == RESTARTED:
            self.restarts += 1
        else:
            self.returns += 1
        self.noise.restart()
        return None

    def at(self, now_s: float, motion: Motion) -> Estimate | None:
        """Return the estimate carried to `now_s`; None while the target is not known well enough to fly on."""
        moved = self._moved(now_s, motion)
        return None if moved is None else self._kernels.carry(self._bank, self._mem, moved, self._par)

    def rivals(self, now_s: float, motion: Motion) -> list[Rival]:
        """Return the likely hypotheses carried to `now_s`, while the estimator keeps many; few are as good as one."""
        moved = self._moved(now_s, motion)
        return [] if moved is None else self._kernels.rivals(self._bank, moved)

    def _moved(self, now_s: float, motion: Motion) -> Moved | None:
        """Return how the vehicle moved since the last sample; None while there is nothing to carry."""
        place = self._trail.at(now_s, motion)
        if self._anchor is None or place is None or self._mem.known == 0.0:
            return None
        return self._trail.between(self._anchor, place, motion)

    def covariance(self) -> tuple[float, ...]:
        """Return the variances that the estimator's module names, as of the last sample."""
        return self._kernels.covariance(self._bank)

    def spread_m(self) -> float:
        """Return how far the hypotheses lie from the leading one, rms by their weights: 0 once they agree.

        `covariance` is the leader's own; while the ring is open it is this that says how little is known.
        """
        places = self._kernels.places(self._bank) if self._kernels.places is not None else []
        if len(places) < 2:
            return 0.0
        x, y = places[0]
        most = max(h.log_weight for h in self._bank)
        weights = [exp(h.log_weight - most) for h in self._bank]
        squares = ((px - x) ** 2 + (py - y) ** 2 for px, py in places)
        return sqrt(sum(w * d for w, d in zip(weights, squares, strict=True)) / sum(weights))

    def sigma_r(self) -> float:
        """Return the standard deviation of the range at the last sample, m; NaN while unknown."""
        variance = self.covariance()[0]
        return nan if isnan(variance) else sqrt(max(0.0, variance))

    def times_noisier(self) -> float:
        """Return how many times noisier the ranges are than their samples say (a levelled slant range says more than
        the range itself did); 1 unless they surely are.
        """
        return self.noise.times if self.noise.surely else 1.0

    def evidence(self) -> float:
        """Return the log of the likelihood of the readings used since the bank began, up to a constant; NaN before.

        It is comparable between two estimators of one kind that were given the same readings.
        """
        weights: list[float] = [h.log_weight for h in self._bank]
        if not weights or self._anchor is None:
            return nan
        most = max(weights)
        return most + log(sum(exp(weight - most) for weight in weights))

    def consistency(self) -> float:
        """Return the normalised innovation squared of the last range that was used: 1 on average when all is well."""
        return self._mem.nis

    def sample_time_s(self) -> float:
        """Return the time of the last sample that arrived, used or refused; NaN before the first."""
        return nan if self._anchor is None else self._anchor.t_s


def _own_noise(mem: Memory, sigma_m: float) -> float:
    """Return what of the last innovation is the reading's own noise, m, if that has `sigma_m`.

    A filter that is quick (in hover: the vehicle may speed up any moment) follows the noise, and is missed by more.
    """
    error, nis = mem.error, mem.nis
    if mem.verdict == OUTLIER or isnan(nis) or isnan(error):
        return error
    return copysign(sigma_m * sqrt(nis), error)
