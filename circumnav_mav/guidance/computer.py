"""The guidance computer: ranges and the vehicle's motion in, a turn rate out, on the caller's clock.

on_sample(sample, motion)  whenever a range comes
tick(now_s, status)        on the fixed grid: phase -> estimate -> law -> limiter -> TurnRateSetpoint
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, isnan, nan
from typing import NamedTuple

from circumnav_mav.guidance.barrier import Band, margin_m, within
from circumnav_mav.guidance.estimators import make
from circumnav_mav.guidance.estimators.flying import FlyingEstimator
from circumnav_mav.guidance.height_choice import HeightChoice
from circumnav_mav.guidance.kernel import Estimate, EstimatorContext, Law, LawContext, Motion, mirror
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.limiter import TurnRateLimiter
from circumnav_mav.guidance.phases import ENGAGED, Facts, Phase, step
from circumnav_mav.guidance.slant import horizontal
from circumnav_mav.types import RangeSample, Rejected, TurnRateSetpoint

BAND_SHARE = 0.05
"""Half width of the orbit band as a share of the radius; not narrower than 3 sigma_r."""
SETTLED_S = 3.0
STRAYED_S = 3.0
STRAYED_BANDS = 3.0


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """What the computer is built from. Units as named; NaN = not configured."""

    law: str
    law_options: dict[str, float]
    estimator: str
    estimator_options: dict[str, float]
    context: LawContext
    clockwise: bool
    turn_accel_limit_rad_s2: float
    max_age_s: float
    coast_s: float
    sigma_m: float
    height_m: float = nan
    target_height_m: float = nan
    choose_height: bool = False
    """Find out in flight whether ranges are horizontal, or slant to a target at the height of the take-off."""
    r_min_m: float = -inf
    r_max_m: float = inf


@dataclass(frozen=True, slots=True)
class Status:
    """The vehicle at one tick. why: what the authority over the aircraft says, in words."""

    heard: bool
    held: bool
    released: bool
    ending: bool
    why: str
    motion: Motion
    height_m: float = nan
    broken: bool = False
    handing_over: bool = False


class Limits(NamedTuple):
    """What of the law's turn rate was changed before it was asked of the vehicle."""

    saturated: bool = False  # more than the turn-rate limit
    slewed: bool = False  # changed faster than the turn-acceleration limit
    barrier: bool = False  # led out of the range band
    way_out: bool = False  # gave way to the safer full turn: no harmless one was left by all that is believed


@dataclass(frozen=True, slots=True)
class Decision:
    """What one tick decided. setpoint: None = nothing may be asked of the vehicle in this phase."""

    phase: Phase
    reason: str
    setpoint: TurnRateSetpoint | None
    estimate: Estimate | None
    wanted_rad_s: float
    """By the law alone; NaN where it was not asked."""
    limits: Limits
    speed_source: str


class GuidanceComputer:
    """One flight's guidance. Pure: it acts only through what `tick` returns."""

    def __init__(self, settings: GuidanceSettings) -> None:
        s = settings
        self._settings = s
        self._law: Law = LAWS[s.law]
        self._parameters = self._law.parameters({**self._law.options, **s.law_options}, s.context)
        build = partial(make, s.estimator, s.estimator_options, estimator_context(s))
        self._estimator = build()
        self.choice = HeightChoice(build) if s.choose_height else None
        """Whether ranges are slant, where that is to be found out in flight."""
        missing = set(self._law.needs) - self.estimator.gives - {"V"}
        if missing:
            raise ValueError(
                f"law {s.law} needs {', '.join(sorted(missing))}, which estimator {s.estimator} does not give"
            )
        self._limiter = TurnRateLimiter(s.context.turn_rate_limit, s.turn_accel_limit_rad_s2)
        self.band_m = max(BAND_SHARE * s.context.r_a, 3.0 * s.sigma_m)
        self._band = band_of(s)
        self.entered = False
        """Whether the range has been within r_min..r_max since the engagement: r_max binds only from then on."""
        self.phase = Phase.WAITING_AUTOPILOT
        self.reason = "started"
        self._fresh_s = -1e9  # when the newest used range was true
        self._inside_since_s = nan
        self._outside_since_s = nan
        self.hold_height_m = nan
        """Above home; as configured, or as it was when control began."""

    @property
    def estimator(self) -> FlyingEstimator:
        """The estimator that is flown on."""
        return self._estimator if self.choice is None else self.choice.flown

    @property
    def restarts(self) -> int:
        """Times that the ranges outvoted all that was believed."""
        return self._estimator.restarts if self.choice is None else self.choice.restarts

    @property
    def returns(self) -> int:
        """Times that they came back to what had been believed: echoes had outvoted it."""
        return self._estimator.returns if self.choice is None else self.choice.returns

    def on_sample(self, sample: RangeSample, motion: Motion, height_m: float, climb_m_s: float) -> Rejected | None:
        """Use a range; return why not where it is not used. height_m, climb_m_s: the vehicle's, NaN unknown."""
        # A sensor may claim more than was configured. Less is not believed: DISTANCE_SENSOR's ends at 16 cm.
        sigma = max(self._settings.sigma_m, self._settings.sigma_m if isnan(sample.sigma_m) else sample.sigma_m)
        sample = RangeSample(sample.t_s, sample.range_m, sample.range_rate_m_s, sigma, sample.beacon_id)
        flown = self._motion(motion)[0]
        if self.choice is not None:
            rejected = self.choice.on_sample(sample, flown, height_m, climb_m_s)
        else:
            rejected = self._use(sample, flown, height_m, climb_m_s)
        if rejected is None:
            self._fresh_s = sample.t_s
        return rejected

    def _use(self, sample: RangeSample, motion: Motion, height_m: float, climb_m_s: float) -> Rejected | None:
        """Horizontal ranges as they are, slant ones where the target's height is configured."""
        flat: RangeSample | Rejected = sample
        if not isnan(self._settings.target_height_m):
            flat = horizontal(sample, height_m - self._settings.target_height_m, climb_m_s)
        return flat if isinstance(flat, Rejected) else self._estimator.on_sample(flat, motion)

    def tick(self, now_s: float, status: Status) -> Decision:
        """Decide at `now_s`."""
        motion, source = self._motion(status.motion)
        (self.choice or self._estimator).advance(now_s, motion)
        estimate = self.estimator.at(now_s, motion)
        if estimate is not None and not (isfinite(estimate.r) and estimate.r > 0.0):
            estimate = None
        self._change_phase(now_s, status, estimate)
        setpoint, wanted, limits = self._setpoint(now_s, status, motion, estimate)
        return Decision(self.phase, self.reason, setpoint, estimate, wanted, limits, source)

    def _motion(self, motion: Motion) -> tuple[Motion, str]:
        """The motion with the speed flown, or the configured speed where none is measured."""
        if isnan(motion.V):
            return motion._replace(V=self._settings.context.V), "configured"
        return motion, "measured"

    def _change_phase(self, now_s: float, status: Status, estimate: Estimate | None) -> None:
        known = estimate is not None
        age_s = now_s - self._fresh_s
        self._watch_band(now_s, estimate)
        facts = Facts(
            heard=status.heard,
            held=status.held,
            handing_over=status.handing_over,
            released=status.released,
            ending=status.ending,
            fresh=known and age_s <= self._settings.max_age_s,
            coastable=known and age_s <= self._settings.coast_s,
            settled=now_s - self._inside_since_s >= SETTLED_S,
            strayed=now_s - self._outside_since_s >= STRAYED_S,
            broken=status.broken,
        )
        change = step(self.phase, facts, status.why)
        if change is None:
            return
        before = self.phase
        self.phase, self.reason = change
        if self.phase in ENGAGED and before not in ENGAGED:
            self._limiter.reset()
            self.entered = False
            wanted = self._settings.height_m
            self.hold_height_m = status.height_m if isnan(wanted) else wanted

    def _watch_band(self, now_s: float, estimate: Estimate | None) -> None:
        error = nan if estimate is None else abs(estimate.r - self._settings.context.r_a)
        self._inside_since_s = _since(self._inside_since_s, now_s, error <= self.band_m)
        self._outside_since_s = _since(self._outside_since_s, now_s, error > STRAYED_BANDS * self.band_m)

    def _setpoint(
        self, now_s: float, status: Status, motion: Motion, estimate: Estimate | None
    ) -> tuple[TurnRateSetpoint | None, float, Limits]:
        stay = TurnRateSetpoint(now_s, 0.0, 0.0, self.hold_height_m)
        if self.phase is Phase.READY or (self.phase in (Phase.RANGE_LOST, Phase.BROKEN_OFF) and status.held):
            return stay, nan, Limits()
        if self.phase not in ENGAGED:
            return None, nan, Limits()
        if status.ending:
            return stay, nan, Limits()
        if estimate is None:
            return None, nan, Limits()
        self.entered = self.entered or self._band.r_min <= estimate.r <= self._band.r_max
        band = self._band if self.entered else self._band._replace(r_max=inf)
        rivals = self.estimator.rivals(now_s, motion)
        wanted = self._turn_rate(estimate)
        safe = self._law.escape(wanted, estimate, rivals, self._parameters)
        inside = within(safe, estimate, band)
        limited = self._limiter.limit(now_s, inside)
        speed = self._settings.context.V
        setpoint = TurnRateSetpoint(now_s, limited.turn_rate_rad_s, speed, self.hold_height_m)
        return setpoint, wanted, Limits(limited.saturated, limited.slewed, inside != safe, safe != wanted)

    def _turn_rate(self, estimate: Estimate) -> float:
        if self._settings.clockwise:
            return self._law.turn_rate(estimate, self._parameters)
        return -self._law.turn_rate(mirror(estimate), self._parameters)

    def sample_age_s(self, now_s: float) -> float:
        """Return the age of the newest range that was used; huge before the first."""
        return now_s - self._fresh_s


def estimator_context(s: GuidanceSettings) -> EstimatorContext:
    """Return what an estimator's parameters are made from."""
    side = 1.0 if s.clockwise else -1.0
    return EstimatorContext(r_a=s.context.r_a, V=s.context.V, turn_rate_limit=s.context.turn_rate_limit, side=side)


def band_of(s: GuidanceSettings) -> Band:
    """Return the range band that these settings ask for."""
    limit = s.context.turn_rate_limit
    reaction_s = s.context.turn_lag_s + limit / s.turn_accel_limit_rad_s2
    side = 1.0 if s.clockwise else -1.0
    return Band(s.r_min_m, s.r_max_m, margin_m(s.sigma_m, s.context.V, reaction_s), limit, reaction_s, side)


def _since(since_s: float, now_s: float, holds: bool) -> float:
    """Return since when a condition holds without a break; NaN while it does not."""
    if not holds:
        return nan
    return now_s if isnan(since_s) else since_s
