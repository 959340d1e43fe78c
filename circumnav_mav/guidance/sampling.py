"""How seldom ranges may come, and how far behind a filter may be, for a gain of the paper's law.

What the loop bears in all is a dead time T with k V T below LAG_UNSTABLE (feasibility.py): the phase margin of the law
linearised at the orbit. What of the sampling counts into T depends on the estimator:

* `raw` holds each reading until the next one: on average half a period old. Where the rate is the difference of two
  readings it is half a period older still. The whole period counts then, half of it with a measured rate.
* The others carry the reading on by the motion that was flown. A turn that is measured is in the estimate at once, so
  neither the period nor the filter counts (tests/theory/test_sampling.py flies k V T = 1.5 so). What the motion does
  not explain, wind and a wrong speed, they follow late by the lag of the filter, and a law that is faster than that
  gains nothing against it.
"""

from __future__ import annotations

from math import inf, sqrt

from circumnav_mav.guidance.feasibility import LAG_UNSTABLE, gain_per_m


def held_s(period_s: float, measured_rate: bool) -> float:
    """Return the dead time [s] of a rate that is held for a period: measured, or the difference of two ranges."""
    return 0.5 * period_s if measured_rate else period_s


def largest_kappa(r_a: float, V: float, dead_time_s: float) -> float:
    """Return the gain that a dead time makes weave: kappa = LAG_UNSTABLE r_a / (V T)."""
    return LAG_UNSTABLE * r_a / (V * dead_time_s) if dead_time_s > 0.0 else inf


def slowest_period_s(r_a: float, kappa: float, V: float, lag_s: float, measured_rate: bool) -> float:
    """Return the longest time [s] between held ranges that the gain bears beside a lag; 0 or less for none."""
    return (LAG_UNSTABLE / (gain_per_m(r_a, kappa) * V) - lag_s) / held_s(1.0, measured_rate)


def filter_lag_s(sigma_m: float, accel_m_s2: float, period_s: float) -> float:
    """Return how late [s] a Kalman filter on (r, r_dot) follows a change of rate that its model does not explain.

    Steady state of a double integrator driven by white noise of density accel^2 [m^2/s^3] and measured with sigma every
    period: two poles at (accel^2 / (sigma^2 T))^(1/4) rad/s, damping sqrt(1/2), so sqrt(2) over that.
    """
    return sqrt(2.0 * sigma_m * sqrt(period_s) / accel_m_s2)


KNOWN_RATE = 0.4
"""Standard deviation of the range rate over the speed, below which `direct` calls its estimate known."""


def most_accel_m_s2(V: float, sigma_m: float, period_s: float) -> float:
    """Return the accel_m_s2 above which the filter of filter_lag_s never knows the range rate to KNOWN_RATE.

    Its variance is sqrt(2) accel^1.5 (sigma^2 T)^(1/4) in the steady state.
    """
    return float(((KNOWN_RATE * V) ** 2 / sqrt(2.0)) ** (2.0 / 3.0) / (sigma_m**2 * period_s) ** (1.0 / 6.0))


def kappa_of_use(r_a: float, V: float, lag_s: float) -> float:
    """Return the gain with k V T = 1 for the filter's lag T: above it wind shifts the orbit no less."""
    return r_a / (V * lag_s)


MOST_NOISE_SHARE = 2.0
"""Turn rate that noise asks for through the gains of `tangent`, beside the circle's: from where on the effort grows."""

MOST_TURN_RAD = {"direct": 0.4, "drift": 0.75, "polar": 0.4}
"""How far the sight may turn between two ranges, the tail wind counted in. Measured: docs/estimation.md."""

MOST_RMS_SHARE = 0.07
"""drift_rms_m over r_a (1 - wind / V) from which `drift` lost flights. Measured likewise."""


def drift_rms_m(r_a: float, V: float, sigma_m: float, period_s: float, gust_share: float) -> float:
    """Return the rms [m] of `tangent` on `drift` on its circle: 1.4 (q_w rho^3)^(1/8), rho = sigma^2 T.

    gust_share: the estimator's option; q_w = gust_share^2 V^3 / r_a is what drives its drift. The form is that of a
    position known through a wandering rate (the eighth root of 4 q rho^3), the 1.4 is measured: docs/estimation.md.
    """
    q_w, rho = (gust_share * V) ** 2 * V / r_a, sigma_m**2 * period_s
    return 1.4 * sqrt(sqrt(sqrt(q_w * rho**3)))
