"""One run: the plant, the estimator and the law, tick by tick. Written with global names that the runner binds.

BEGIN, OBSERVE, CARRY, RIVALS, LAW and ESCAPE are the kernels of the estimator and the law that fly; `kernels.compiled`
binds them, and the whole run becomes one compiled program.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, nan
from typing import Any, NamedTuple

from circumnav_mav.guidance.kernel import NAN, Memory, Motion, Reading
from circumnav_mav.guidance.trail import Place, between, onward
from circumnav_mav.study.noise import Floats
from circumnav_mav.study.plant import Plant, World, airspeed, fly, limited, range_and_rate


def _unbound(*_: Any) -> Any:
    raise NotImplementedError("bound by the runner")


BEGIN: Callable[..., Any] = _unbound
OBSERVE: Callable[..., Any] = _unbound
CARRY: Callable[..., Any] = _unbound
RIVALS: Callable[..., Any] = _unbound
LAW: Callable[..., Any] = _unbound
ESCAPE: Callable[..., Any] = _unbound


class Setup(NamedTuple):
    """What a run needs besides the plant."""

    steps: int
    range_every: int
    latency: int  # steps that a range is late
    r_a: float
    sigma_r: float  # what the sensor claims
    believed: float  # believed over true airspeed
    heading_error: float  # rad
    heading_drift: float  # rad/s
    band: float  # settled inside r_a +- band, m


class Outcome(NamedTuple):
    """What came of a run. "Tail" is its second half; u is the command as limited."""

    tail_ms: float  # mean (r - r_a)^2, m^2
    tail_bias: float  # mean r - r_a, m
    tail_u2: float  # mean u^2, rad^2/s^2
    settle_s: float  # inside the band for good from then on; NaN = not at the end
    least_range: float  # over the whole run, m
    restarts: float
    refused: float  # readings


def drive(
    setup: Setup,
    plant: Plant,
    start: World,
    range_error: Floats,
    rate_error: Floats,
    gust_x: Floats,
    gust_y: Floats,
    gaps: Floats,
    est_par: Any,
    law_par: Any,
    trace: Floats,
) -> Outcome:
    """Fly one run. `trace` (steps x 8, or empty) takes t, x, y, tx, ty, r estimated, heading and u of every step.

    Before the estimate is known the vehicle flies straight on.
    """
    world = start
    bank = BEGIN(est_par)
    mem = Memory(0.0, 0.0, nan, 0.0, nan, 0.0, 0.0, nan, nan, 0.0, 0.0)
    place = Place(0.0, 0.0, 0.0, 0.0, nan)
    anchor = place
    seen = [place]  # the last `latency + 1` places
    seen_r = [(0.0, 0.0)]
    seen.pop()
    seen_r.pop()
    traced, gusty, rated = trace.shape[0] > 0, gust_x.shape[0] > 0, rate_error.shape[0] > 0
    ms = bias = u2 = restarts = refused = 0.0
    least, settle, tail, u = 1e300, 0.0, 0, 0.0
    for n in range(setup.steps):
        t = world.t
        psi = world.psi + setup.heading_error + setup.heading_drift * t
        # All five: numba does not know the defaults of a NamedTuple.
        motion = Motion(setup.believed * airspeed(t, plant), world.u, psi, NAN, NAN)
        place = onward(place, t, motion)
        if n == 0:
            anchor = place
        seen.append(place)
        seen_r.append(range_and_rate(world, plant))
        if len(seen) > setup.latency + 1:
            seen.pop(0)
            seen_r.pop(0)
        i = n - setup.latency
        if i >= 0 and i % setup.range_every == 0 and not missing(seen[0].t_s, gaps):
            r, r_dot = seen_r[0]
            j = i // setup.range_every
            r_dot = r_dot + rate_error[j] if rated else nan
            z = Reading(max(r + range_error[j], 0.0), r_dot, setup.sigma_r)
            mem = OBSERVE(bank, mem, between(anchor, seen[0], motion), z, est_par)
            anchor = seen[0]
            restarts += mem.verdict == 2.0
            refused += mem.verdict == 1.0
        u, r_est = 0.0, nan
        if mem.known > 0.0:
            moved = between(anchor, place, motion)
            est = CARRY(bank, mem, moved, est_par)
            u, r_est = limited(ESCAPE(LAW(est, law_par), est, RIVALS(bank, moved), law_par), plant), est.r
        if traced:
            note(trace, n, world, r_est, u)
        world = fly(world, u, plant, gust_x[n] if gusty else 0.0, gust_y[n] if gusty else 0.0)
        e = hypot(world.x - world.tx, world.y - world.ty) - setup.r_a
        least = min(least, e + setup.r_a)
        if abs(e) > setup.band:
            settle = world.t
        if 2 * n >= setup.steps:
            ms += e * e
            bias += e
            u2 += u * u
            tail += 1
    if settle == world.t:
        settle = nan
    return Outcome(ms / tail, bias / tail, u2 / tail, settle, least, restarts, refused)


def note(trace: Floats, n: int, world: World, r_est: float, u: float) -> None:
    """Write a step down. One element at a time: a whole row costs the compiler seconds."""
    trace[n, 0] = world.t
    trace[n, 1] = world.x
    trace[n, 2] = world.y
    trace[n, 3] = world.tx
    trace[n, 4] = world.ty
    trace[n, 5] = r_est
    trace[n, 6] = world.psi
    trace[n, 7] = u


def missing(t: float, gaps: Floats) -> bool:
    """Return whether no range comes at t: `gaps` has rows (from, to)."""
    for k in range(gaps.shape[0]):  # noqa: SIM110 (the compiler takes no generator)
        if gaps[k, 0] <= t < gaps[k, 1]:
            return True
    return False
