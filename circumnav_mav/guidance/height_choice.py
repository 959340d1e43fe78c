"""Horizontal ranges, or slant ones to a target on the ground? Decided in flight: `ranging.target_height_m: auto`.

Two estimators of the same kind fly. One takes a range R as it is, the other its level part, r = sqrt(R^2 - h^2), h
being the height above the take-off point. On a straight course both explain the ranges equally well; a turn tells them
apart, for the circle that the wrong one sees is too wide or too narrow for the speed. The log of the ratio of their
likelihoods (densities of R) is summed, range by range; no single range counts for much, so that echoes do not decide.
A range clearly shorter than the height cannot be slant.

Until the sum speaks clearly for the other, ranges are flown on as slant: where they are not, the aircraft is farther
from the target than it believes, and so on the safe side. Once one of the two is beyond doubt it flies alone; where it
has to start again later, so does the other.

A flight that the wrong one leads turns hard and often, and ranges that are late may then outvote the right one as well.
That does not tell whether it can be flown on: such restarts are taken back once it flies alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isnan, log

from circumnav_mav.guidance.estimators.flying import FlyingEstimator
from circumnav_mav.guidance.kernel import Motion
from circumnav_mav.guidance.slant import horizontal
from circumnav_mav.types import RangeSample, Rejected

Reading = RangeSample | Rejected
"""A range in one of the two ways."""
LEVEL, SLANT = "horizontal", "slant"
OTHER = {LEVEL: SLANT, SLANT: LEVEL}
WORDS = {
    LEVEL: "ranges are taken as horizontal, or to a target at the aircraft's own height",
    SLANT: "ranges are taken as slant, to a target on the ground at the height of the take-off",
}
CAP = 3.0
"""Greatest weight of one range (natural logarithm): an echo that only one of the two believes counts for no more."""
REFUSED = -8.0
"""Log likelihood of a range beyond the estimators' gate, in units of its sigma: 4^2 / 2."""
RESTART = 10.0
"""What it costs to have had to start again."""
SWITCH = 8.0
"""The sum from which the other one is flown on."""
DROP = 30.0
"""The sum from which one of the two is beyond doubt, and the most that is kept."""
AGAIN = 20.0
"""What stays of the sum when the one that was beyond doubt starts again: a beacon that moved, and a run of echoes that
agree, make it do so more often than a wrong choice does."""
HEIGHT_SIGMAS, HEIGHT_ERROR_M = 4.0, 5.0
"""A slant range is no shorter than the height less so many of its sigmas and the error of a barometer."""


class HeightChoice:
    """Both ways to take a range, till one is left. build: makes an estimator that knows nothing."""

    def __init__(self, build: Callable[[], FlyingEstimator]) -> None:
        self._build = build
        self._tried = {SLANT: build(), LEVEL: build()}
        self._before = dict.fromkeys(WORDS, 0)  # their restarts when this round began
        self._led = SLANT  # what this round began with
        self._earlier_restarts = 0  # those that counted in the rounds before
        self._earlier_returns = 0  # of those that are dropped
        self._news: list[str] = []
        self.taken = SLANT
        """How the ranges that are flown on are taken: SLANT or LEVEL."""
        self.for_level = 0.0
        """How much likelier horizontal ranges are, as a natural logarithm; below 0: slant ones."""

    @property
    def flown(self) -> FlyingEstimator:
        """The estimator to fly on: that of the way chosen, or of the other as long as only that one knows anything."""
        chosen = self._tried[self.taken]
        if not self.decided and isnan(chosen.sample_time_s()):
            return self._tried[OTHER[self.taken]]
        return chosen

    @property
    def decided(self) -> bool:
        """Whether one of the two is beyond doubt, and flies alone."""
        return len(self._tried) == 1

    @property
    def restarts(self) -> int:
        """Times that the ranges outvoted every belief there is: the wrong one of the two may restart as it likes.

        It falls when those of a round that the wrong one led are taken back.
        """
        return self._earlier_restarts + min(self._restarts_of(way) for way in self._tried)

    @property
    def returns(self) -> int:
        """Times that a belief which had been outvoted came back, in whichever of the two."""
        return self._earlier_returns + sum(estimator.returns for estimator in self._tried.values())

    def _restarts_of(self, way: str) -> int:
        return self._tried[way].restarts - self._before[way]

    def news(self) -> list[str]:
        """Return what was decided since the last call, in words."""
        news, self._news = self._news, []
        return news

    def advance(self, now_s: float, motion: Motion) -> None:
        """Take in what was flown since the last call."""
        for estimator in self._tried.values():
            estimator.advance(now_s, motion)

    def on_sample(self, sample: RangeSample, motion: Motion, height_m: float, climb_m_s: float) -> Rejected | None:
        """Use a range; return why the one that is flown did not. height_m: above the take-off point, NaN unknown."""
        readings = {LEVEL: sample, SLANT: horizontal(sample, height_m, climb_m_s)}
        if self.decided:
            return self._alone(readings, motion)
        if isinstance(slant := readings[SLANT], Rejected) and slant.reason == "no_height":
            return slant
        flown = LEVEL if self.flown is self._tried[LEVEL] else SLANT
        judged = {way: judge(self._tried[way], readings[way], sample, motion) for way in WORDS}
        gain = min(max(judged[LEVEL][0] - judged[SLANT][0], -CAP), CAP)
        if isinstance(readings[SLANT], Rejected):  # near overhead, if it is slant: that tells nothing, or all
            short_m = abs(height_m) - HEIGHT_SIGMAS * sample.sigma_m - HEIGHT_ERROR_M
            gain = CAP if sample.range_m < short_m and judged[LEVEL][1] is None else 0.0
        self._weigh(gain)
        return judged[flown][1]

    def _alone(self, readings: Mapping[str, Reading], motion: Motion) -> Rejected | None:
        """The one that is left takes the range; where that ends its belief, both begin again."""
        before = self.restarts
        rejected = use(self._tried[self.taken], readings[self.taken], motion)
        if self.restarts > before:
            other = OTHER[self.taken]
            self._earlier_restarts = self.restarts
            self._tried[other] = self._build()
            use(self._tried[other], readings[other], motion)
            self._before = {self.taken: self._tried[self.taken].restarts, other: 0}
            self._led = self.taken
            self.for_level = AGAIN if self.taken == LEVEL else -AGAIN
            self._news.append(
                f"ranges taken as {self.taken} no longer fit the flight: horizontal and slant are both tried again"
            )
        return rejected

    def _weigh(self, gain: float) -> None:
        """Add the weight of a range to the sum: fly on the other, or on one alone, where that is called for."""
        self.for_level = min(max(self.for_level + gain, -DROP), DROP)
        likelier = LEVEL if self.for_level > 0.0 else SLANT
        if likelier != self.taken and abs(self.for_level) > SWITCH:
            self.taken = likelier
            self._news.append(WORDS[likelier])
        if abs(self.for_level) >= DROP:
            if likelier == self._led:
                self._earlier_restarts = self.restarts
            self._before[likelier] = self._tried[likelier].restarts
            self._earlier_returns += self._tried[OTHER[likelier]].returns
            self._tried = {likelier: self._tried[likelier]}
            self._news.append(f"{WORDS[likelier]}: beyond doubt")


def use(estimator: FlyingEstimator, reading: Reading, motion: Motion) -> Rejected | None:
    """Give a range to an estimator, if there is one."""
    return reading if isinstance(reading, Rejected) else estimator.on_sample(reading, motion)


def judge(
    estimator: FlyingEstimator, reading: Reading, sample: RangeSample, motion: Motion
) -> tuple[float, Rejected | None]:
    """Return the log likelihood of the range as it came, up to what both ways share, and why it was not used.

    A density of r is one of R by the factor dr/dR = R / r.
    """
    before, restarts, returns = estimator.evidence(), estimator.restarts, estimator.returns
    rejected = use(estimator, reading, motion)
    if isinstance(reading, Rejected):
        return 0.0, rejected
    if estimator.restarts > restarts:
        return REFUSED - log(sample.sigma_m) - RESTART, rejected
    if rejected is not None and rejected.reason == "outlier":
        return REFUSED - log(sample.sigma_m), rejected
    if estimator.returns > returns:  # another bank, whose sum is another's; the range is where it was expected
        return -log(sample.sigma_m), rejected
    gain = estimator.evidence() - before + log(sample.range_m / reading.range_m)
    return (0.0 if isnan(gain) else gain), rejected
