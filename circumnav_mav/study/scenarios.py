"""The situations that laws and estimators are compared in, by name."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

G_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class Scenario:
    """A vehicle, a sensor and a world. Directions and starts that are not given are uniform a run.

    "Tail" is the second half. Speeds of wind and target are over the ground; `heading` NaN = uniform.
    """

    name: str
    V_m_s: float
    r_a_m: float
    duration_s: float
    control_s: float  # a command is held for so long
    range_every: int  # control steps a range
    sigma_r_m: float
    sigma_r_dot_m_s: float = math.nan  # NaN: the sensor has no range rate
    lag_s: float = 0.0
    limit_rad_s: float = math.inf
    start_m: tuple[float, float] = (0.0, 0.0)  # least and greatest range at the start
    start_bearing_deg: float = math.nan  # of the vehicle as the target sees it, counter-clockwise from east
    start_heading_deg: float = math.nan
    start_away: bool = False  # heading straight away from the target
    wind_m_s: float = 0.0
    wind_deg: float = math.nan  # where it blows to
    gust_m_s: float = 0.0
    target_m_s: float = 0.0
    target_deg: float = math.nan
    target_turn_rad_s: float = 0.0
    outlier_share: float = 0.0
    outlier_mean_m: float = 0.0  # how much too long, exponential
    echo_m: float = 0.0  # above 0: outliers are all so much too long instead
    echo_burst: int = 1  # and come so many at a time
    gaps_s: tuple[tuple[float, float], ...] = ()
    believed_speed: float = 1.0  # believed over true airspeed
    heading_error_deg: float = 0.0
    heading_drift_deg_s: float = 0.0
    speed_step: float = 0.0  # share by which the airspeed rises at a third of the run
    latency_steps: int = 0

    @property
    def turn_rate_on_the_circle(self) -> float:
        return self.V_m_s / self.r_a_m


PAPER = Scenario(
    "P_calm",
    V_m_s=1.0,
    r_a_m=10.0,
    duration_s=350.0,
    control_s=0.5,
    range_every=1,
    sigma_r_m=0.1,
    sigma_r_dot_m_s=0.5,
    start_m=(20.0, 20.0),
    start_bearing_deg=180.0,
    start_heading_deg=0.0,
)
"""The paper's: V 1, r_a 10, control held 0.5 s, from (-20, 0) towards the target."""

PLANE = Scenario(
    "R_calm",
    V_m_s=15.0,
    r_a_m=80.0,
    duration_s=300.0,
    control_s=0.05,
    range_every=2,
    sigma_r_m=1.0,
    lag_s=0.5,
    limit_rad_s=G_M_S2 * math.tan(math.radians(35.0)) / 15.0,
    start_m=(150.0, 600.0),
)
"""A small plane: V 15, r_a 80, bank limit 35 deg, from anywhere."""


def _all() -> Iterable[Scenario]:
    p, r = PAPER, PLANE
    wind25 = replace(p, name="P_wind25", wind_m_s=0.25, wind_deg=45.0)
    wind5 = replace(r, name="R_wind5", wind_m_s=5.0)
    yield p
    yield wind25
    yield replace(p, name="P_wind50", wind_m_s=0.5, wind_deg=45.0)
    yield replace(p, name="P_moving", target_m_s=math.hypot(0.2, 0.1), target_deg=math.degrees(math.atan2(-0.1, 0.2)))
    yield replace(wind25, name="P_outliers", outlier_share=0.1, outlier_mean_m=5.0)
    yield r
    yield wind5
    yield replace(r, name="R_wind7", wind_m_s=7.6)
    yield replace(wind5, name="R_moving", target_m_s=4.0)
    yield replace(wind5, name="R_outliers", outlier_share=0.1, outlier_mean_m=40.0)
    yield replace(wind5, name="R_dropout", gaps_s=((150.0, 165.0),))
    yield replace(wind5, name="R_lag1", lag_s=1.0)
    yield replace(wind5, name="R_sigma5", sigma_r_m=5.0)
    yield replace(wind5, name="R_airspeed_high", believed_speed=1.1)
    yield replace(wind5, name="R_airspeed_low", believed_speed=0.9)
    yield replace(wind5, name="R_1Hz", range_every=20)
    yield replace(wind5, name="R_2Hz_sigma5", range_every=10, sigma_r_m=5.0)
    # Hard ones of our own.
    yield replace(wind5, name="X_overhead", start_m=(1.0, 10.0))
    yield replace(wind5, name="X_away", start_away=True)
    yield replace(wind5, name="X_curve", target_m_s=4.0, target_turn_rad_s=0.03)
    yield replace(wind5, name="X_gusts", gust_m_s=1.5)
    yield replace(wind5, name="X_heading", heading_error_deg=15.0, heading_drift_deg_s=0.1)
    yield replace(wind5, name="X_dropouts", gaps_s=tuple((t, t + 10.0) for t in range(40, 300, 30)))
    yield replace(wind5, name="X_speed", speed_step=0.15)
    yield replace(wind5, name="X_outliers30", outlier_share=0.3, outlier_mean_m=40.0)
    yield replace(wind5, name="X_echo_constant", outlier_share=0.2, echo_m=40.0)
    yield replace(wind5, name="X_echo_bursts", outlier_share=0.1, echo_m=40.0, echo_burst=8)
    yield replace(wind5, name="X_late", latency_steps=10)


SCENARIOS: dict[str, Scenario] = {scenario.name: scenario for scenario in _all()}

PLANNED_LAG_S = {"P": 0.0, "R": 0.5, "X": 0.5}
"""The turn-rate lag that a law is told, by the family of the scenario: what the vehicle class is thought to have."""
