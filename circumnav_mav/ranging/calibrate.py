"""The antenna delay of a ranging radio is a constant added to every range: measure it at a known distance. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite, nan, sqrt
from statistics import fmean, median

LEAST_SAMPLES = 50
LEAST_DISTANCE_M = 1.0
OUTLIER_SIGMAS = 4.0
MOST_OUTLIERS = 0.1
SIGMA_OF_MAD = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""

MOST_STANDARD_ERROR_M = 0.05
DRIFT_SIGMAS = 4.0


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a calibration found.

    bias_m: to be written as ranging.bias_m (true range = measured - bias); standard_error_m: of the bias; spread_m: the
    standard deviation of one range; outliers: ranges left out; problems: in words, empty when the bias may be used.
    """

    samples: int
    outliers: int
    bias_m: float
    standard_error_m: float
    spread_m: float
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        return not self.problems

    def verdict(self) -> str:
        """Return one line for people."""
        if not isfinite(self.bias_m):
            return f"nothing: {'; '.join(self.problems)}"
        measured = (
            f"bias {self.bias_m:+.3f} m, standard error {self.standard_error_m:.3f} m, from {self.samples} ranges"
        )
        return f"{measured}: good" if self.ok else f"{measured}, but do not use it: {'; '.join(self.problems)}"


def calibrate(
    ranges_m: Sequence[float], distance_m: float, *, resolution_m: float = 0.0, current_bias_m: float = 0.0
) -> Calibration:
    """Return the bias from ranges measured at rest at `distance_m`, which the receiver corrected by `current_bias_m`.

    Ranges further than OUTLIER_SIGMAS robust deviations from the median are left out. Successive ranges of one place
    are not independent: the standard error counts them by their lag-1 correlation rho as n (1 - rho) / (1 + rho), and
    is never less than what steps of `resolution_m` hide, resolution / sqrt(12). Raises ValueError for a distance that
    is not positive or ranges that are not finite.
    """
    if not (isfinite(distance_m) and distance_m > 0.0):
        raise ValueError(f"the distance must be a positive number of metres, not {distance_m}")
    if not all(isfinite(r_m) for r_m in ranges_m):
        raise ValueError("ranges must be finite")
    if len(ranges_m) < 2:
        return Calibration(len(ranges_m), 0, nan, nan, nan, (_too_few(len(ranges_m)),))
    errors_m = [r_m + current_bias_m - distance_m for r_m in ranges_m]
    kept_m = _without_outliers(errors_m, resolution_m)
    found = Calibration(
        samples=len(kept_m),
        outliers=len(errors_m) - len(kept_m),
        bias_m=fmean(kept_m),
        standard_error_m=_standard_error(kept_m, resolution_m),
        spread_m=_deviation(kept_m),
        problems=(),
    )
    half = len(kept_m) // 2
    drift_m = fmean(kept_m[half:]) - fmean(kept_m[:half]) if half >= 2 else 0.0
    # Each half has twice the variance of the whole, and so their difference four times.
    # About a line, not about the mean: else a drift would hide in the error that it makes.
    drift_error_m = max(2.0 * DRIFT_SIGMAS * _standard_error(_about_a_line(kept_m), resolution_m), 2.0 * resolution_m)
    drifts_m = drift_m if abs(drift_m) > drift_error_m else 0.0
    return replace(found, problems=tuple(_problems(found, distance_m, drifts_m)))


def _problems(found: Calibration, distance_m: float, drifts_m: float) -> list[str]:
    problems = []
    if found.samples < LEAST_SAMPLES:
        problems.append(_too_few(found.samples))
    if distance_m < LEAST_DISTANCE_M:
        problems.append(
            f"{distance_m:g} m is too near: put the beacon {LEAST_DISTANCE_M:g} m away or more, better 10 m"
        )
    if found.outliers > MOST_OUTLIERS * (found.samples + found.outliers):
        problems.append(f"{found.outliers} ranges are far off: keep the line of sight and its surroundings free")
    if found.spread_m > max(0.5, 0.02 * distance_m):
        problems.append(f"ranges spread by {found.spread_m:.2f} m: is everything at rest and in sight?")
    if abs(found.bias_m) > max(5.0, 0.2 * distance_m):
        problems.append(f"a bias of {found.bias_m:.1f} m is no antenna delay: is {distance_m:g} m right?")
    if drifts_m:
        problems.append(f"ranges drift by {drifts_m:+.3f} m between the halves: let the radios warm up, and keep still")
    elif found.standard_error_m > MOST_STANDARD_ERROR_M:
        problems.append(f"the standard error is above {MOST_STANDARD_ERROR_M:g} m: measure for longer")
    return problems


def _too_few(count: int) -> str:
    return f"{count} range{'s are' if count != 1 else ' is'} too few: at least {LEAST_SAMPLES} are needed"


def _without_outliers(errors_m: Sequence[float], resolution_m: float) -> list[float]:
    middle_m = median(errors_m)
    sigma_m = SIGMA_OF_MAD * median(abs(error_m - middle_m) for error_m in errors_m)
    limit_m = max(OUTLIER_SIGMAS * sigma_m, 1.5 * resolution_m)
    return [error_m for error_m in errors_m if abs(error_m - middle_m) <= limit_m]


def _about_a_line(values: Sequence[float]) -> list[float]:
    """Return what the best line through the values leaves of them."""
    mean, middle = fmean(values), (len(values) - 1) / 2.0
    steps = [n - middle for n in range(len(values))]
    slope = sum(s * value for s, value in zip(steps, values, strict=True)) / (sum(s * s for s in steps) or 1.0)
    return [value - mean - slope * s for s, value in zip(steps, values, strict=True)]


def _deviation(values: Sequence[float]) -> float:
    if len(values) < 2:
        return 0.0
    mean = fmean(values)
    return sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))


def _standard_error(values: Sequence[float], resolution_m: float) -> float:
    deviation, mean = _deviation(values), fmean(values)
    hidden = resolution_m / sqrt(12.0)
    if deviation == 0.0:
        return hidden
    products = sum((a - mean) * (b - mean) for a, b in pairwise(values))
    rho = min(max(products / ((len(values) - 1) * deviation**2), 0.0), 0.99)
    independent = max(1.0, len(values) * (1.0 - rho) / (1.0 + rho))
    return max(deviation / sqrt(independent), hidden)
