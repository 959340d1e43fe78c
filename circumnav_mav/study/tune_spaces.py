"""What `circumnav tune` may change: every registered law and estimator is here, or has a reason not to be."""

from __future__ import annotations

from collections.abc import Mapping

Space = Mapping[str, tuple[float, float]]

KAPPA = (1.0, 20.0)

SPACES: Mapping[str, Space] = {
    "hashemi2013": {"kappa": KAPPA},
    "hashemi2013_outer": {"kappa": KAPPA},
    "cao2013_smooth": {"kappa": KAPPA},
    "cao2013_saturated": {"layer_share": (0.02, 1.0)},
    "sliding_mode": {"slope": (0.3, 10.0), "closing_share": (0.2, 0.95), "layer_share": (0.02, 1.0)},
    "pd_bias": {"kappa": (2.1, 20.0), "damping": (0.3, 1.0)},  # it needs kappa above 2 * damping
    "tangent": {"reach_s": (0.5, 8.0), "gain_per_s": (0.2, 4.0)},
    "direct": {"accel_m_s2": (0.02, 20.0)},
    "polar": {"drift_share": (0.001, 0.3), "turn_share": (0.003, 0.5)},
    "drift": {"wander_share": (3e-4, 0.03), "gust_share": (1e-3, 0.1)},
}
"""Least and greatest value of what is searched, in logarithms. Other options stay as the configuration has them."""

NOTHING_TO_TUNE: Mapping[str, str] = {
    "raw": "it believes the last reading, and a noise that it is told only shows in the estimate's spread",
}

MEANINGS: Mapping[str, str] = {
    "kappa": "gain x radius, at least 1; larger is tighter and busier",
    "layer_share": "range-rate error at which the turn is full, as a share of the speed",
    "slope": "closing speed asked for a radius of error, in speeds",
    "closing_share": "greatest closing speed asked for, as a share of the speed",
    "damping": "of the loop about the circle; 1 does not overshoot",
    "reach_s": "the course bends towards the circle within speed x reach_s of it",
    "gain_per_s": "how fast a heading error is turned away",
    "lag_s": "the lag of the turns, which the law takes out",
    "accel_m_s2": "how fast the range rate is believed to change",
    "drift_share": "unknown motion along the line of sight, as a share of the speed",
    "turn_share": "unknown turning, as a share of the orbit's own",
    "wander_share": "unknown motion of the position, as a share of the speed",
    "gust_share": "how fast wind and target are believed to change",
}
"""For the comments of the file that is written."""
