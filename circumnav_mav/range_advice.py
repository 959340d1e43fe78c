"""What the rate, the noise and the age of the ranges mean for a flight: part of `circumnav check`."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

from circumnav_mav.config import Config
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.estimators.flying import TRAIL_S
from circumnav_mav.guidance.estimators.gate import believed_s
from circumnav_mav.guidance.kernel import EstimatorContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.verdict import Finding
from circumnav_mav.ranging import SOURCES


def _period_s(config: Config) -> tuple[float, str]:
    """Return how far apart ranges come, s, and which key says so."""
    if "range_rate_hz" in config.study.model_fields_set:
        return 1.0 / config.study.range_rate_hz, "study.range_rate_hz"
    return config.ranging.max_age_s, "ranging.max_age_s"


def seldom(config: Config) -> Iterator[Finding]:
    """Yield a warning where every range is stale before the next one comes."""
    period_s, whose = _period_s(config)
    if period_s > config.ranging.max_age_s:
        text = (
            f"one range in {period_s:.3g} s ({whose}) is stale before the next: after ranging.max_age_s = "
            f"{config.ranging.max_age_s:g} s the flight counts as coasting; raise it, or take a quicker sensor"
        )
        yield Finding("warning", "seldom", text)


def jumps(config: Config) -> Iterator[Finding]:
    """Yield a warning where the range is lost before a beacon that was moved is believed: gate.py votes meanwhile."""
    coast_s, needed_s = config.ranging.coast_s, believed_s(1.0 / config.study.range_rate_hz)
    if config.estimator.name != "raw" and coast_s < needed_s:
        text = (
            f"ranging.coast_s = {coast_s:.3g} s is over before ranges that contradict the estimate, from a beacon that "
            f"was moved, say, are believed ({needed_s:.3g} s with {config.study.range_rate_hz:g} ranges a second): the "
            f"range is lost first; {needed_s + config.ranging.max_age_s:.3g} s is enough"
        )
        yield Finding("warning", "jumps", text)


def rate_of_ranges(config: Config, kappa: float, lag_s: float) -> Iterator[Finding]:
    """Yield how the rate of ranges and the filter bound the gain of the paper's law.

    Reckoned with are the ranges of study.range_rate_hz, where the file gives it; else the slowest that still count as
    fresh, one in ranging.max_age_s.
    """
    orbit, (slowest_s, whose) = config.orbit, _period_s(config)
    r_a, V = orbit.radius_m, orbit.speed_m_s
    if config.estimator.name == "raw":
        measured = SOURCES[config.ranging.source].has_rate
        bears_s = sampling.slowest_period_s(r_a, kappa, V, lag_s, measured)
        most = sampling.largest_kappa(r_a, V, lag_s + sampling.held_s(slowest_s, measured))
        text = (
            f"raw holds a rate between ranges: kappa {kappa:.3g} bears them {max(bears_s, 0.0):.3g} s apart at most; "
            f"{slowest_s:.3g} s apart ({whose}), only kappa below {most:.3g}"
        )
        yield Finding("warning" if bears_s < slowest_s else "info", "range_rate", text)
        return
    text = (
        f"{config.estimator.name} carries ranges on by the turn that was flown: waiting for one adds nothing to the "
        "lag of the loop"
    )
    if config.estimator.name != "direct":
        yield Finding("info", "range_rate", text)
        return
    context = EstimatorContext(r_a, V, config.turn_rate_limit_rad_s)
    noise = ESTIMATORS["direct"].parameters(config.estimator.options, context).q
    late_s = sampling.filter_lag_s(config.ranging.sigma_m, sqrt(noise), slowest_s)
    most = sampling.kappa_of_use(r_a, V, late_s)
    text += (
        f"; one in {slowest_s:.3g} s follows wind {late_s:.2g} s late, and kappa above {most:.3g} gains nothing then"
    )
    yield Finding("warning" if kappa > most else "info", "range_rate", text)


def carried_far(config: Config) -> Iterator[Finding]:
    """Yield where an estimator has too few ranges, and what `tangent` on `drift` makes of their noise and rate.

    Without study.wind_m_s, still air. docs/estimation.md says how the thresholds were measured.
    """
    orbit, estimator, (period_s, whose) = config.orbit, config.estimator, _period_s(config)
    r_a, V, wind_m_s = orbit.radius_m, orbit.speed_m_s, config.study.wind_m_s or 0.0
    if estimator.name not in sampling.MOST_TURN_RAD or wind_m_s >= V:
        return
    turned_rad, most_rad = (V + wind_m_s) * period_s / r_a, sampling.MOST_TURN_RAD[estimator.name]
    if turned_rad > most_rad:
        text = (
            f"one range in {period_s:.3g} s ({whose}) is too few: between two of them the sight turns by up to "
            f"{turned_rad:.2g} rad, and from {most_rad:g} on {estimator.name} loses flights in wind: fly "
            f"{(V + wind_m_s) * period_s / most_rad:.3g} m or wider, slower, or take a quicker sensor"
        )
        yield Finding("warning", "sight", text)
    if config.law.name == "tangent":  # the only law on drift that this was measured with
        options = {**ESTIMATORS["drift"].options, **estimator.options}
        rms_m = sampling.drift_rms_m(r_a, V, config.ranging.sigma_m, period_s, options["gust_share"])
        text = (
            f"tangent on drift: expect {rms_m:.2g} m rms on the circle with one range in {period_s:.3g} s ({whose}) "
            f"and ranging.sigma_m = {config.ranging.sigma_m:g}"
        )
        noisy = rms_m > sampling.MOST_RMS_SHARE * r_a * (1.0 - wind_m_s / V)
        if noisy:
            text += f", more in the wind of {wind_m_s:g} m/s, in which some flights are lost" if wind_m_s else ""
            text += f": fly wider than {r_a:g} m, or take a better or a quicker sensor"
        yield Finding("warning" if noisy else "info", "range_rate", text)
        yield from _restless(config, rms_m)


def _restless(config: Config, rms_m: float) -> Iterator[Finding]:
    """Yield a warning where `tangent` turns what the estimate is off by into more turning than the circle takes."""
    law = LAWS["tangent"].parameters(config.law.options, config.law_context())
    circle_rad_s = config.orbit.speed_m_s / config.orbit.radius_m
    asked_rad_s = law.gain * rms_m / law.reach
    if asked_rad_s > sampling.MOST_NOISE_SHARE * circle_rad_s:
        text = (
            f"an estimate that is off by {rms_m:.2g} m asks for {asked_rad_s:.2g} rad/s through law.gain_per_s = "
            f"{law.gain:g} and law.reach_s = {law.reach / config.orbit.speed_m_s:g}, where the circle takes "
            f"{circle_rad_s:.2g}: the vehicle is never still; a lower gain or a longer reach keeps the range as well"
        )
        yield Finding("warning", "effort", text)


def ages(config: Config) -> Iterator[Finding]:
    """Yield a warning where ranging.max_age_s allows what the estimator cannot place any more."""
    if config.ranging.max_age_s > TRAIL_S:
        text = (
            f"a range that comes more than {TRAIL_S:g} s late is not used, though ranging.max_age_s allows "
            f"{config.ranging.max_age_s:g} s: what was flown is remembered no longer"
        )
        yield Finding("warning", "age", text)
