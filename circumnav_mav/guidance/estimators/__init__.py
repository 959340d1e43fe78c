"""Samples in, what a law needs out. A new estimator is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from circumnav_mav.guidance.estimators import direct, drift, polar, raw
from circumnav_mav.guidance.estimators.flying import FlyingEstimator
from circumnav_mav.guidance.kernel import Estimator, EstimatorContext

ESTIMATORS: dict[str, Estimator] = {
    estimator.name: estimator for estimator in (raw.ESTIMATOR, direct.ESTIMATOR, polar.ESTIMATOR, drift.ESTIMATOR)
}


def make(name: str, options: Mapping[str, float], context: EstimatorContext) -> FlyingEstimator:
    """Return a flying estimator. KeyError for a name that is not registered, ValueError in words for a bad option."""
    estimator = ESTIMATORS[name]
    return FlyingEstimator(estimator, estimator.parameters(options, context), context.V)
