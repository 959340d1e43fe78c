"""A vehicle with a lagging turn rate, in the tests' own kinematics: small Euler steps, compass axes, nothing shared."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

from circumnav_mav.guidance.estimators import ESTIMATORS, FlyingEstimator
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext, Motion, mirror
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.types import RangeSample


@dataclass
class Flight:
    """One flight around a target at the origin, and what it was like."""

    r_a: float = 50.0
    V: float = 5.0
    clockwise: bool = True
    law: str = "hashemi2013"
    law_options: dict[str, float] = field(default_factory=dict)
    estimator: str = "direct"
    estimator_options: dict[str, float] = field(default_factory=dict)
    start: tuple[float, float, float] = (-120.0, 30.0, 0.4)
    lag_s: float = 0.45
    turn_rate_limit: float = 0.8
    sigma_r: float = 0.3
    claimed: float | None = None  # sigma that comes with a range; None: the true one
    sigma_r_dot: float = math.nan  # NaN: the sensor has no range rate
    sample_hz: float = 10.0
    latency_s: float = 0.0
    outliers: float = 0.0
    outlier_mean_m: float = 30.0
    gaps: tuple[tuple[float, float], ...] = ()
    wind: tuple[float, float] = (0.0, 0.0)
    jump: tuple[float, float, float] = (math.inf, 0.0, 0.0)  # time, new place of the target
    echo: tuple[float, float, float] = (math.inf, math.inf, 0.0)  # from, to, how much too long every range is
    tick_hz: float = 50.0
    seed: int = 1
    compass: bool = True
    believed: float = 1.0  # believed over true speed
    r: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    rejected: dict[str, int] = field(default_factory=dict)
    est: FlyingEstimator = field(init=False)
    state: tuple[float, float, float] = (0.0, 0.0, 0.0)  # at the end: x, y, heading
    u: float = 0.0

    def fly(self, for_s: float) -> Flight:
        draw = random.Random(self.seed)
        side = 1.0 if self.clockwise else -1.0
        context = EstimatorContext(self.r_a, self.V, self.turn_rate_limit, side)
        kernels = ESTIMATORS[self.estimator]
        self.est = FlyingEstimator(kernels, kernels.parameters(self.estimator_options, context), self.V)
        law = LAWS[self.law]
        par = law.parameters(self.law_options, LawContext(self.r_a, self.V, self.turn_rate_limit, self.lag_s))
        x, y, psi = self.start
        u = u_command = 0.0
        dt, substeps = 1.0 / self.tick_hz, 4
        waiting: list[tuple[float, RangeSample]] = []
        next_sample_s = 0.0
        tx = ty = 0.0
        for n in range(int(for_s * self.tick_hz)):
            t = n * dt
            if t >= self.jump[0]:
                tx, ty = self.jump[1:]
            motion = Motion(self.believed * self.V, u, psi if self.compass else math.nan)
            self.est.advance(t, motion)
            if t >= next_sample_s - 1e-9:
                next_sample_s += 1.0 / self.sample_hz
                if not any(a <= t < b for a, b in self.gaps):
                    r = math.hypot(x - tx, y - ty)
                    r_dot = math.nan
                    if not math.isnan(self.sigma_r_dot):
                        vx = self.V * math.cos(psi) + self.wind[0]
                        vy = self.V * math.sin(psi) + self.wind[1]
                        r_dot = ((x - tx) * vx + (y - ty) * vy) / r + draw.gauss(0.0, self.sigma_r_dot)
                    z = r + draw.gauss(0.0, self.sigma_r) + (self.echo[2] if self.echo[0] <= t < self.echo[1] else 0.0)
                    if draw.random() < self.outliers:
                        z += draw.expovariate(1.0 / self.outlier_mean_m)
                    waiting.append(
                        (
                            t + self.latency_s,
                            RangeSample(t, z, r_dot, self.sigma_r if self.claimed is None else self.claimed),
                        )
                    )
            while waiting and waiting[0][0] <= t + 1e-9:
                refused = self.est.on_sample(waiting.pop(0)[1], motion)
                if refused:
                    self.rejected[refused.reason] = self.rejected.get(refused.reason, 0) + 1
            estimate = self.est.at(t, motion)
            if estimate is None:
                u_command = 0.0
            elif self.clockwise:
                u_command = law.turn_rate(estimate, par)
            else:
                u_command = -law.turn_rate(mirror(estimate), par)
            u_command = max(-self.turn_rate_limit, min(self.turn_rate_limit, u_command))
            for _ in range(substeps):
                h = dt / substeps
                u += (u_command - u) * h / self.lag_s if self.lag_s > 0.0 else u_command - u
                psi += u * h
                x += (self.V * math.cos(psi) + self.wind[0]) * h
                y += (self.V * math.sin(psi) + self.wind[1]) * h
            self.times.append(t + dt)
            self.r.append(math.hypot(x - tx, y - ty))
        self.state, self.u = (x, y, psi), u
        return self

    def errors(self, from_s: float, to_s: float = math.inf) -> list[float]:
        return [r - self.r_a for t, r in zip(self.times, self.r, strict=True) if from_s <= t < to_s]

    def rms(self, from_s: float, to_s: float = math.inf) -> float:
        errors = self.errors(from_s, to_s)
        return math.sqrt(sum(e * e for e in errors) / len(errors))

    def furthest(self, from_s: float, to_s: float = math.inf) -> float:
        return max(abs(e) for e in self.errors(from_s, to_s))
