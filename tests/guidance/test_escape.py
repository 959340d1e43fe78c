"""The way out near a target whose bearing is still several: turns, risks, and when the law is overruled."""

from __future__ import annotations

import random
from math import cos, exp, hypot, inf, nan, sin

import pytest

from circumnav_mav.guidance.computer import GuidanceComputer, GuidanceSettings, Status
from circumnav_mav.guidance.estimators import drift
from circumnav_mav.guidance.estimators.drift_gaussian import again
from circumnav_mav.guidance.kernel import (
    NOBODY,
    Estimate,
    EstimatorContext,
    LawContext,
    Memory,
    Motion,
    Moved,
    Reading,
    Rival,
)
from circumnav_mav.guidance.laws.escape import CHANGE, HARMLESS, TURN, depth, escape, full_turn, risk
from circumnav_mav.study.noise import draw
from circumnav_mav.study.plant import Plant, World, fly
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.types import RangeSample

V, LIMIT, LAG, ROOM = 15.0, 0.458, 0.5, 64.0
FULL = (ROOM, LIMIT, LAG)


def rival(ahead_m: float, left_m: float, share: float = 1.0, drift_m_s=(0.0, 0.0), sigma_m: float = 0.0) -> Rival:
    """A target as a vehicle sees it that flies east, in a drift towards (ahead, left)."""
    return NOBODY._replace(
        share=share, px=ahead_m, py=left_m, wx=drift_m_s[0], wy=drift_m_s[1], xx=sigma_m**2, yy=sigma_m**2
    )


def seen(r: float = 100.0, u: float = 0.0) -> Estimate:
    return Estimate(r=r, V=V, u=u, psi=0.0)


def mirrored(h: Rival) -> Rival:
    return h._replace(py=-h.py, wy=-h.wy, xy=-h.xy, xv=-h.xv, yu=-h.yu, uv=-h.uv)


@pytest.mark.parametrize("u", [-LIMIT, 0.1, LIMIT])
def test_without_rivals_or_far_away_the_law_flies(u):
    assert escape(u, seen(), [], *FULL) == u
    assert escape(u, seen(r=600.0), [rival(600.0, 0.0)], *FULL) == u


def test_as_long_as_one_turn_is_harmless_the_law_flies_even_the_other():
    """A target abeam on the left, on the circle: to the left is into it, to the right is out."""
    rivals = [rival(0.0, 80.0)]
    assert risk(1.0, seen(80.0), rivals, *FULL) > 10 * HARMLESS
    assert risk(-1.0, seen(80.0), rivals, *FULL) <= HARMLESS
    for u in (LIMIT, 0.19, -LIMIT):
        assert escape(u, seen(80.0), rivals, *FULL) == u


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_with_no_harmless_turn_left_the_safer_one_is_flown_whatever_the_law_says(side):
    """Two targets ahead in a tail wind, one a little to either side: away from the likelier."""
    wind = (7.0, 0.0)
    rivals = [rival(80.0, -15.0 * side, 0.8, wind), rival(80.0, 15.0 * side, 0.2, wind)]
    safer, other = risk(side, seen(81.0), rivals, *FULL), risk(-side, seen(81.0), rivals, *FULL)
    assert HARMLESS < safer < CHANGE * other
    for u in (LIMIT, -LIMIT, 0.0):
        assert escape(u, seen(81.0), rivals, *FULL) == side * LIMIT


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_under_way_is_kept_until_the_other_is_much_safer(side):
    """To change costs the way that stopping one turn and building up the other take; so it must be worth it."""
    wind, turning = (7.0, 0.0), side * 0.12
    even = [rival(80.0, 15.0, 0.5, wind), rival(80.0, -15.0, 0.5, wind)]
    assert min(risk(s, seen(81.0, turning), even, *FULL) for s in (1.0, -1.0)) > HARMLESS
    assert escape(-side * LIMIT, seen(81.0, turning), even, *FULL) == side * LIMIT
    into = [rival(70.0, 35.0 * side, 0.9, wind), rival(70.0, -15.0 * side, 0.1, wind)]
    assert risk(-side, seen(78.0, turning), into, *FULL) > HARMLESS
    assert risk(-side, seen(78.0, turning), into, *FULL) < CHANGE * risk(side, seen(78.0, turning), into, *FULL)
    assert escape(side * LIMIT, seen(78.0, turning), into, *FULL) == -side * LIMIT


def test_it_is_the_same_in_a_mirror():
    chance = random.Random(3)
    changed = 0
    for _ in range(300):
        rivals = [
            rival(
                chance.gauss(70.0, 40.0),
                chance.gauss(0.0, 50.0),
                chance.random(),
                (chance.gauss(0, 5), chance.gauss(0, 5)),
            )
            for _ in range(4)
        ]
        rivals = [
            h._replace(xx=300.0, yy=300.0, uu=9.0, vv=9.0, xu=9.0, yv=9.0)._replace(
                **{key: chance.gauss(0.0, most) for key, most in (("xy", 90.0), ("xv", 9.0), ("yu", 9.0), ("uv", 2.0))}
            )
            for h in rivals
        ]
        u, flown = chance.uniform(-LIMIT, LIMIT), chance.uniform(-LIMIT, LIMIT)
        there = escape(u, seen(90.0, flown), rivals, *FULL)
        back = escape(-u, seen(90.0, -flown), [mirrored(h) for h in rivals], *FULL)
        assert back == pytest.approx(-there)
        changed += there != u
    assert 30 < changed < 300


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("lag", "u"), [(0.5, 0.0), (0.5, -0.3), (1.0, 0.458), (0.0, 0.0)])
def test_a_full_turn_is_the_one_that_the_plant_flies(side, lag, u):
    """The study's plant integrates the same turn in steps of 5 ms."""
    plant = Plant(V, 0.005, lag, inf, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, inf)
    world = World(0.0, 0.0, 0.0, 0.3, u, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    est = Estimate(r=100.0, V=V, u=u, psi=0.3)
    for t, x, y in full_turn(side, est, LIMIT, lag)[1:]:
        while world.t < t - 1e-9:
            world = fly(world, side * LIMIT, plant._replace(dt=min(0.005, t - world.t)), 0.0, 0.0)
        assert hypot(world.x - x, world.y - y) < 1.0  # points, with chords of 0.28 rad between them
    assert t == pytest.approx(TURN / LIMIT)


def test_the_depth_is_the_mean_over_the_gaussian_of_a_hypothesis():
    """Against 1,000 draws of place and drift a case, each flown past: near, but three places are coarse."""
    chance, coarse = random.Random(8), 0
    for _ in range(20):
        h = rival(
            chance.uniform(20.0, 120.0), chance.uniform(-60.0, 60.0), 1.0, (chance.gauss(0, 4), chance.gauss(0, 4))
        )
        h = h._replace(xx=15.0**2, yy=15.0**2, uu=2.0**2, vv=2.0**2)
        path = full_turn(1.0, seen(), LIMIT, LAG)
        if inside_now(h):
            continue
        total = 0.0
        for _ in range(1000):
            one = h._replace(
                px=chance.gauss(h.px, 15.0),
                py=chance.gauss(h.py, 15.0),
                wx=chance.gauss(h.wx, 2.0),
                wy=chance.gauss(h.wy, 2.0),
            )
            least = min(hypot(one.px - x - one.wx * t, one.py - y - one.wy * t) for t, x, y in path)
            total += max(1.0 - least / ROOM, 0.0) ** 2
        coarse += abs(depth(h, path, ROOM) - total / 1000) > 0.12
    assert coarse <= 2


def inside_now(h: Rival) -> bool:
    return hypot(h.px, h.py) < ROOM


def test_what_the_vehicle_is_in_already_is_no_risk_and_deeper_is():
    """From 30 m, a turn away and one past the target: only what lies below 30 m counts."""
    path = full_turn(1.0, seen(30.0), LIMIT, LAG)
    assert depth(rival(-30.0, 0.0), path, ROOM) == 0.0
    beside = rival(15.0, 26.0)
    least = min(hypot(beside.px - x, beside.py - y) for _, x, y in path)
    assert least < 25.0 and hypot(15.0, 26.0) == pytest.approx(30.0, abs=0.1)
    now = (1.0 - hypot(15.0, 26.0) / ROOM) ** 2
    assert depth(beside, path, ROOM) == pytest.approx((1.0 - least / ROOM) ** 2 - now)


def test_an_unsure_drift_blurs_where_the_target_will_be_and_what_goes_with_the_place_can_undo_it():
    """(p - w t) has the variance xx - 2 t xu + t^2 uu; on a course straight past, the target 100 m abeam at the end."""
    path = [(0.0, 0.0, 0.0), (5.0, 75.0, 0.0)]
    still = rival(75.0, 80.0)
    assert depth(still, path, ROOM) == 0.0
    blurred = still._replace(yy=100.0, vv=25.0)  # 10 m and 5 m/s: 27 m in 5 s
    together = blurred._replace(yv=49.0)  # nearly all of it moves with the place
    apart = blurred._replace(yv=-49.0)
    near = [80.0 - 1.3 * (100.0 - 10.0 * h.yv + 625.0) ** 0.5 for h in (together, blurred, apart)]
    for h, r in zip((together, blurred, apart), near, strict=True):
        assert depth(h, path, ROOM) == pytest.approx(0.3 * max(1.0 - r / ROOM, 0.0) ** 2)
    assert near[0] > ROOM - 5.0 > near[1] > near[2]


@pytest.mark.parametrize("field", ["r", "V", "psi", "u"])
@pytest.mark.parametrize("bad", [nan, inf])
def test_what_is_not_finite_becomes_no_turn(field, bad):
    """It goes on to the limits, which refuse it, and say so."""
    rivals = [rival(60.0, 5.0), rival(60.0, -5.0)]
    assert abs(escape(0.1, seen(60.0), rivals, *FULL)) == LIMIT
    assert escape(0.1, seen(60.0)._replace(**{field: bad}), rivals, *FULL) == 0.1
    assert escape(bad, seen(60.0), rivals, *FULL) is bad


def test_rivals_are_the_likely_hypotheses_where_they_are_at_the_tick():
    """While the ring is open; the leader is where `carry` has it, and what is hardly believed is left out."""
    par = drift.parameters({}, EstimatorContext(80.0, V, LIMIT))
    bank, mem = drift.begin(par), Memory()
    mem = drift.observe(bank, mem, Moved(0.0, 0.0, 0.0, 0.0, V, 0.0, 0.0), Reading(150.0, nan, 1.0), par)
    bank[3] = again(bank[3], 1.0, -20.0)
    bank[5] = bank[5]._replace(wx=2.0, wy=-3.0, s=0.1, log_weight=-1.0)
    later = Moved(0.4, 6.0, 0.3, 0.1, V, 0.25, 0.1)
    rivals = drift.rivals(bank, later)
    assert len(rivals) == len(bank) - 1
    lead = drift.carry(bank, mem, later, par)
    assert (rivals[0].px, rivals[0].py, rivals[0].wx) == (lead.px, lead.py, lead.wx)
    assert sorted(h.share for h in rivals) == pytest.approx([exp(-1.0)] + [1.0] * (len(bank) - 2))
    adrift, was = rivals[4], bank[5]  # the fourth is left out
    assert adrift.px == pytest.approx(
        was.px - 1.1 * later.ahead * cos(0.0) + 1.1 * later.left * sin(0.0) - 2.0 * later.dt
    )
    assert adrift.py == pytest.approx(was.py - 1.1 * later.left + 3.0 * later.dt)
    others = [h for h in rivals if h is not adrift]
    assert {round(hypot(h.px + later.ahead, h.py + later.left)) for h in others} == {150}


def test_a_bank_that_agrees_has_no_rivals():
    par = drift.parameters({}, EstimatorContext(80.0, V, LIMIT))
    bank = [drift.ring_member(100.0, 0.3, 1.0, par, -float(i)) for i in range(6)]
    assert drift.rivals(bank, Moved(0.0, 0.0, 0.0, 0.0, V, 0.0, 0.0)) == []


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize(("seed", "index"), [(339, 606), (398, 930)])
def test_the_computer_flies_the_way_out_on_either_orbit(seed, index, clockwise):
    """Entries of the study's R_wind7 that need it, flown by what flies; and their mirror images."""
    scenario = SCENARIOS["R_wind7"]
    chance, mirror = draw(scenario, seed, index), 1.0 if clockwise else -1.0
    context = LawContext(scenario.r_a_m, V, scenario.limit_rad_s, scenario.lag_s)
    computer = GuidanceComputer(
        GuidanceSettings("tangent", {}, "drift", {}, context, clockwise, inf, 1.0, 20.0, scenario.sigma_r_m)
    )
    world, least = chance.start, inf
    for n in range(round(30.0 / scenario.control_s)):
        motion, r = Motion(V, mirror * world.u, mirror * world.psi), hypot(world.x, world.y)
        if n % scenario.range_every == 0:
            sample = RangeSample(
                world.t, r + chance.range_error_m[n // scenario.range_every], sigma_m=scenario.sigma_r_m
            )
            computer.on_sample(sample, motion, nan, nan)
        held = Status(heard=True, held=True, released=False, ending=False, why="", motion=motion)
        decision = computer.tick(world.t, held)
        u = decision.setpoint.turn_rate_rad_s if decision.setpoint else 0.0
        world = fly(world, mirror * u, chance.plant, 0.0, 0.0)
        least = min(least, hypot(world.x, world.y))
    assert least > 0.5 * scenario.r_a_m
