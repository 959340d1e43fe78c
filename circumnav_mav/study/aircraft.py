"""The aircraft that `circumnav tune` searches gains for, what it is flown in, and a set of gains made for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from circumnav_mav.config import Config
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.from_log import Seen
from circumnav_mav.study.scenarios import Scenario
from circumnav_mav.study.simulate import Pilot

CONTROL_S = 0.05
"""The simulation holds a command for so long, or for the loop's own period where that is longer."""

WIND_SHARE = 0.2
"""The strongest wind, as a share of the speed, where none is given."""

MOST_WIND_SHARE = 0.8
"""Above it the aircraft makes a fifth of its speed against the wind: a run from far takes long and proves little."""

BELIEVED_SPEED = 1.05
"""Believed over true speed in one of the situations."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """What the search needs to know of the vehicle and its ranging, beyond the gains."""

    V_m_s: float
    r_a_m: float
    turn_rate_limit_rad_s: float
    lag_s: float  # of the turn rate
    told_lag_s: float  # what a law is told of it in flight: that of the vehicle class
    sigma_r_m: float
    range_rate_hz: float
    latency_s: float
    wind_m_s: float  # the strongest to be flown in, or the speed of a target that moves: to the guidance they are one
    control_s: float

    @staticmethod
    def of(config: Config, wind_m_s: float | None = None, range_rate_hz: float | None = None) -> Aircraft:
        """Return the aircraft of a configuration; wind and rate: those of its study section where none are given.

        No wind there either: WIND_SHARE of the speed. ValueError in words.
        """
        context, study = config.law_context(), config.study
        wind_m_s = study.wind_m_s if wind_m_s is None else wind_m_s
        wind_m_s = WIND_SHARE * context.V if wind_m_s is None else wind_m_s
        range_rate_hz = study.range_rate_hz if range_rate_hz is None else range_rate_hz
        _check_wind(wind_m_s, context.V)
        if not range_rate_hz > 0.0:
            raise ValueError(f"the ranges need a rate above 0 Hz, not {range_rate_hz:g}")
        return Aircraft(
            V_m_s=context.V,
            r_a_m=context.r_a,
            turn_rate_limit_rad_s=context.turn_rate_limit,
            lag_s=config.turn_lag_s,
            told_lag_s=context.turn_lag_s,
            sigma_r_m=config.ranging.sigma_m,
            range_rate_hz=range_rate_hz,
            latency_s=config.ranging.latency_s,
            wind_m_s=wind_m_s,
            control_s=max(CONTROL_S, 1.0 / config.loop.rate_hz),
        )

    def as_seen(self, seen: Seen) -> Aircraft:
        """Return the aircraft with what a flight showed in place of what was assumed, to three digits: it gets written.

        Raises ValueError in words.
        """
        shown = {
            "sigma_r_m": seen.sigma_r_m,
            "range_rate_hz": seen.range_rate_hz,
            "lag_s": seen.lag_s,
            "wind_m_s": seen.wind_m_s,
        }
        if seen.wind_m_s is not None:
            _check_wind(seen.wind_m_s, self.V_m_s)
        return replace(self, **{name: float(f"{value:.3g}") for name, value in shown.items() if value is not None})

    def scenarios(self) -> list[Scenario]:
        """Return calm air, half the wind with a wrong airspeed, and all of it.

        Long enough to come from far and fly three laps of tail. In calm air with everything known, the laziest gains
        look best, and the first wind or a radius of a few per cent too much would show them up.
        """
        lap_s, far = math.tau * self.r_a_m / self.V_m_s, 6.0 * self.r_a_m
        entry_s = far / (self.V_m_s - self.wind_m_s)
        calm = Scenario(
            name="R_tune",
            V_m_s=self.V_m_s,
            r_a_m=self.r_a_m,
            duration_s=2.0 * max(3.0 * lap_s, entry_s),
            control_s=self.control_s,
            range_every=max(1, round(1.0 / (self.range_rate_hz * self.control_s))),
            sigma_r_m=self.sigma_r_m,
            lag_s=self.lag_s,
            limit_rad_s=self.turn_rate_limit_rad_s,
            start_m=(1.5 * self.r_a_m, far),
            latency_steps=round(self.latency_s / self.control_s),
        )
        half = replace(calm, wind_m_s=0.5 * self.wind_m_s, believed_speed=BELIEVED_SPEED)
        return [calm, half, replace(calm, wind_m_s=self.wind_m_s)]


def _check_wind(wind_m_s: float, V_m_s: float) -> None:
    if not 0.0 <= wind_m_s <= MOST_WIND_SHARE * V_m_s:
        raise ValueError(
            f"a wind of {wind_m_s:.4g} m/s cannot be tuned for: it must be 0 to {MOST_WIND_SHARE * V_m_s:.4g} m/s, "
            f"{MOST_WIND_SHARE:g} of the speed of {V_m_s:g} m/s, for against more the aircraft can hardly come back"
        )


@dataclass(frozen=True)
class Gains(Pilot):
    """A law and an estimator with all their options, made for an aircraft just as the flying app makes them."""

    aircraft: Aircraft | None = None

    def parameters(self, scenario: Scenario) -> tuple[Any, Any]:
        """Return what the kernels of estimator and law take."""
        assert self.aircraft is not None
        a = self.aircraft
        est = EstimatorContext(a.r_a_m, a.V_m_s, a.turn_rate_limit_rad_s)
        law = LawContext(a.r_a_m, a.V_m_s, a.turn_rate_limit_rad_s, a.told_lag_s)
        return (
            ESTIMATORS[self.estimator].parameters(
                {**ESTIMATORS[self.estimator].options, **self.estimator_options}, est
            ),
            LAWS[self.law].parameters({**LAWS[self.law].options, **self.law_options}, law),
        )

    @property
    def pair(self) -> str:
        return f"{self.law} on {self.estimator}"


def gains_of(config: Config, aircraft: Aircraft) -> Gains:
    """Return the present gains of a configuration."""
    return Gains(config.law.name, config.estimator.name, config.law.options, config.estimator.options, aircraft)


def fresh_gains(law: str, estimator: str, aircraft: Aircraft) -> Gains:
    """Return a pair at its defaults; a law that takes the lag out is told that of this very aircraft."""
    told = "lag_s" in LAWS[law].options and abs(aircraft.lag_s - aircraft.told_lag_s) > 1e-6
    return Gains(law, estimator, {"lag_s": float(f"{aircraft.lag_s:.3g}")} if told else {}, {}, aircraft)
