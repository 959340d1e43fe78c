"""The plant against closed forms and small steps."""

import math

import pytest

from circumnav_mav.study.plant import Plant, World, fly, limited, range_and_rate

CALM = Plant(
    V=12.0,
    dt=0.5,
    lag=0.0,
    limit=0.5,
    wind_x=0.0,
    wind_y=0.0,
    target_turn=0.0,
    gust=0.0,
    gust_s=5.0,
    speed_step=0.0,
    step_s=100.0,
)
START = World(0.0, -100.0, 20.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_held_turn_is_a_circle():
    world, u = START, 0.3
    for _ in range(40):
        world = fly(world, u, CALM, 0.0, 0.0)
    R, psi = CALM.V / u, 0.7 + u * 20.0
    assert world.x == pytest.approx(-100.0 + R * (math.sin(psi) - math.sin(0.7)))
    assert world.y == pytest.approx(20.0 - R * (math.cos(psi) - math.cos(0.7)))
    assert world.t == pytest.approx(20.0)


def test_straight_on_with_wind_and_a_moving_target():
    plant = CALM._replace(wind_x=2.0, wind_y=-1.0)
    world = START._replace(tvx=1.0, tvy=0.5)
    for _ in range(10):
        world = fly(world, 0.0, plant, 0.0, 0.0)
    assert (world.x, world.y) == pytest.approx((-100 + 5 * (12 * math.cos(0.7) + 2), 20 + 5 * (12 * math.sin(0.7) - 1)))
    assert (world.tx, world.ty) == pytest.approx((5.0, 2.5))


def test_a_lagging_turn_is_that_of_small_steps():
    plant = CALM._replace(lag=0.5, dt=0.05)
    world = START
    x, y, psi, u, h = -100.0, 20.0, 0.7, 0.0, 1e-4
    for n in range(100):
        command = 0.5 * math.sin(0.2 * n)
        world = fly(world, command, plant, 0.0, 0.0)
        for _ in range(500):
            u += (command - u) * h / 0.5
            psi += u * h
            x += 12.0 * math.cos(psi) * h
            y += 12.0 * math.sin(psi) * h
    assert (world.x, world.y, world.psi, world.u) == pytest.approx((x, y, psi, u), abs=5e-3)


def test_a_target_in_a_curve_goes_round():
    plant = CALM._replace(target_turn=2.0 * math.pi / 50.0)
    world = START._replace(tvx=3.0)
    for _ in range(100):
        world = fly(world, 0.0, plant, 0.0, 0.0)
    assert (world.tx, world.ty) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (world.tvx, world.tvy) == pytest.approx((3.0, 0.0), abs=1e-9)


def test_gusts_have_the_spread_that_they_are_given():
    import random

    draw = random.Random(4)
    plant = CALM._replace(gust=1.5, dt=1.0)
    world, squares = START, []
    for _ in range(20000):
        world = fly(world, 0.0, plant, draw.gauss(0, 1), draw.gauss(0, 1))
        squares.append(world.gx**2)
    assert math.sqrt(sum(squares) / len(squares)) == pytest.approx(1.5, rel=0.05)


def test_the_rate_is_the_derivative_of_the_range():
    plant = CALM._replace(wind_x=2.0, wind_y=-1.0, dt=1e-4)
    world = START._replace(tvx=1.0, tvy=0.5, gx=0.4)
    later = fly(world, 0.0, plant, 0.0, 0.0)
    rate = (range_and_rate(later, plant)[0] - range_and_rate(world, plant)[0]) / 1e-4
    assert range_and_rate(world, plant)[1] == pytest.approx(rate, abs=1e-3)


def test_the_limit_holds_both_ways_and_an_infinite_one_does_not():
    assert (limited(0.9, CALM), limited(-0.9, CALM), limited(0.4, CALM)) == (0.5, -0.5, 0.4)
    assert limited(9.0, CALM._replace(limit=math.inf)) == 9.0
