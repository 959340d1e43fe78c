"""The multirotor's motion against closed forms and the figures measured on PX4 (PX4.md, section 4)."""

from __future__ import annotations

import math
import random

import pytest

from sitl_stub.kinematics import angle_rates, body_rates
from tests.stub.rig import Rig, first_time, flying, product, quaternion


def offboard_at(velocity: tuple[float, float, float], yaw_rate: float = 0.0, **fields: float) -> Rig:
    rig = flying(**fields)
    rig.enter_offboard(lambda _: rig.local())
    rig.run(1.0)
    rig.streaming = lambda _: rig.local(velocity=velocity, yaw_rate=yaw_rate)
    return rig


@pytest.mark.parametrize(("share", "measured_s"), [(0.5, 0.59), (0.63, 0.76), (0.9, 1.31)])
def test_velocity_step(share: float, measured_s: float) -> None:
    rig = offboard_at((5.0, 0.0, 0.0))
    taken_s = first_time(rig, lambda: rig.stub.truth().speed_m_s >= share * 5.0, 5.0)
    assert taken_s == pytest.approx(measured_s, rel=0.15)


@pytest.mark.parametrize(("share", "measured_s"), [(0.63, 0.455), (0.9, 0.75)])
def test_yaw_rate_step(share: float, measured_s: float) -> None:
    rig = offboard_at((5.0, 0.0, 0.0), 0.25)
    taken_s = first_time(rig, lambda: -rig.stub.truth().turn_rate_rad_s >= share * 0.2445, 5.0)
    assert taken_s == pytest.approx(measured_s, rel=0.15)


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "sideslip_deg", "radius_m"),
    [(5.0, 0.25, -8.4, 21.0), (5.0, -0.25, 8.4, 21.0), (5.0, 0.5, -17.0, 10.3), (10.0, 0.25, -8.1, 41.3)],
)
def test_steady_turn(speed: float, yaw_rate: float, sideslip_deg: float, radius_m: float) -> None:
    """A turning nose with velocity along it: the track lags, the circle is V / yaw rate."""
    rig = offboard_at((speed, 0.0, 0.0), yaw_rate)
    rig.run(10.0)
    truth = rig.stub.truth()
    # Compass angles are clockwise, Truth's counter-clockwise: sideslip (course - yaw) changes its sign.
    slip_deg = -math.degrees(math.remainder(truth.course_rad - truth.heading_rad, 2 * math.pi))
    assert slip_deg == pytest.approx(sideslip_deg, rel=0.15)
    assert truth.speed_m_s == pytest.approx(speed, rel=0.03)
    places = []
    for _ in range(round(2 * math.pi / abs(0.978 * yaw_rate) / 0.1)):
        rig.run(0.1)
        places.append((rig.stub.truth().east_m, rig.stub.truth().north_m))
    east, north = (sum(c) / len(places) for c in zip(*places, strict=True))
    radii = [math.hypot(e - east, n - north) for e, n in places]
    assert sum(radii) / len(radii) == pytest.approx(radius_m, rel=0.05)


def test_velocity_turned_ahead_of_the_nose_takes_the_sideslip_out() -> None:
    u = 0.25
    rig = offboard_at((5.0 * math.cos(0.6 * u), 5.0 * math.sin(0.6 * u), 0.0), u)
    rig.run(15.0)
    truth = rig.stub.truth()
    assert abs(math.degrees(math.remainder(truth.course_rad - truth.heading_rad, 2 * math.pi))) < 1.0


@pytest.mark.parametrize("asked", [12.5, 15.0])
def test_speed_is_clipped_at_MPC_XY_VEL_MAX(asked: float) -> None:
    rig = offboard_at((asked, 0.0, 0.0))
    rig.run(8.0)
    assert rig.stub.truth().speed_m_s == pytest.approx(12.0, abs=0.05)


@pytest.mark.parametrize("tilt_deg", [20.0, 45.0])
def test_it_tilts_and_pulls_no_further_than_MPC_TILTMAX_AIR(tilt_deg: float) -> None:
    """A reversal of 24 m/s: what moves it is g tan(tilt) at most, and the air; from 12 to 0 that takes a known time."""
    rig = offboard_at((12.0, 0.0, 0.0), params={"MPC_TILTMAX_AIR": tilt_deg})
    rig.run(12.0)
    most_m_s2, drag_per_s = 9.80665 * math.tan(math.radians(tilt_deg)), 0.15
    rig.streaming = lambda _: rig.local(velocity=(-12.0, 0.0, 0.0))
    began_s, stopped_s, tilts_deg, north = rig.now_s, math.inf, [], rig.stub.autopilot.vehicle.vn
    assert north == pytest.approx(12.0, abs=0.05)
    while rig.now_s < began_s + 15.0:
        rig.run(0.01)
        now = rig.stub.autopilot.vehicle.vn
        assert abs(now - north + drag_per_s * now * 0.01) <= most_m_s2 * 0.01 * 1.005  # it holds at the end of a step
        stopped_s = min(stopped_s, rig.now_s - began_s) if now <= 0.0 else stopped_s
        tilts_deg.append(math.degrees(abs(rig.stub.truth().pitch_rad)))
        north = now
    assert max(tilts_deg) == pytest.approx(tilt_deg, abs=0.01)
    assert north == pytest.approx(-12.0, abs=0.05)
    closed_form_s = math.log1p(drag_per_s * 12.0 / most_m_s2) / drag_per_s
    assert closed_form_s < stopped_s < closed_form_s + 0.6  # which begins where the tilt has been built up


def test_wind_pushes_and_is_taken_up() -> None:
    """The velocity loop rejects wind: a hovering multirotor tilts against it and stays."""
    rig = flying(wind_north_m_s=8.0)
    rig.enter_offboard(lambda _: rig.local())
    rig.run(20.0)
    truth = rig.stub.truth()
    assert truth.speed_m_s < 0.05
    assert truth.airspeed_m_s == pytest.approx(8.0, abs=0.1)
    assert abs(truth.pitch_rad) > math.radians(3.0)


def test_frame_1_holds_a_height() -> None:
    rig = flying(height_m=25.0, height_drift_m_s=0.04, local_z_error_m=0.0)
    rig.enter_offboard(lambda _: rig.local(frame=1, mask=1507, place=(0, 0, -30.0), velocity=(5.0, 0.0, 0.0)))
    rig.run(15.0)
    assert rig.stub.truth().height_m == pytest.approx(30.0, abs=0.2)


def test_position_is_held() -> None:
    rig = flying(local_z_error_m=0.0)
    rig.enter_offboard(lambda _: rig.local(frame=1, mask=0b110111111000, place=(40.0, -20.0, -20.0)))
    rig.run(30.0)
    truth = rig.stub.truth()
    assert (truth.north_m, truth.east_m, truth.height_m) == pytest.approx((40.0, -20.0, 20.0), abs=0.2)


def test_mirror() -> None:
    """Turning left is turning right in a mirror."""
    right, left = offboard_at((5.0, 0.0, 0.0), 0.3), offboard_at((5.0, 0.0, 0.0), -0.3)
    for rig in (right, left):
        rig.run(12.0)
    a, b = right.stub.truth(), left.stub.truth()
    assert (a.north_m, a.east_m) == pytest.approx((b.north_m, -b.east_m), abs=1e-6)


def test_coarse_steps_fly_the_same_way() -> None:
    """Steps are exact for a constant input, so 10 ms and 20 ms agree."""
    fine, coarse = offboard_at((4.0, 1.0, 0.0), 0.2), offboard_at((4.0, 1.0, 0.0), 0.2, step_s=0.02)
    for rig in (fine, coarse):
        rig.run(30.0, dt_s=0.02)
    a, b = fine.stub.truth(), coarse.stub.truth()
    assert math.hypot(a.north_m - b.north_m, a.east_m - b.east_m) < 0.5


def test_position_is_the_integral_of_velocity() -> None:
    rig = offboard_at((5.0, 0.0, 0.0), 0.2)
    before = rig.stub.truth()
    north = east = 0.0
    for _ in range(1000):
        a = rig.stub.truth()
        rig.run(0.01)
        b = rig.stub.truth()
        north += 0.005 * (a.speed_m_s * math.sin(a.course_rad) + b.speed_m_s * math.sin(b.course_rad))
        east += 0.005 * (a.speed_m_s * math.cos(a.course_rad) + b.speed_m_s * math.cos(b.course_rad))
    after = rig.stub.truth()
    assert (after.north_m - before.north_m, after.east_m - before.east_m) == pytest.approx((north, east), abs=1e-3)


def test_heights_wander_with_velocity_setpoints() -> None:
    """vz = 0 is only a velocity: +4.5 / -2 m in 30 s were seen, and 0 to 1.2 m in other runs."""
    ends = []
    for seed in range(1, 9):
        rig = flying(seed=seed, height_drift_m_s=0.04)
        rig.enter_offboard(lambda _, rig=rig: rig.local(velocity=(5.0, 0.0, 0.0)))
        rig.run(30.0)
        ends.append(rig.stub.truth().height_m - 30.0)
    assert 0.3 < max(map(abs, ends)) < 4.5


# -- SET_ATTITUDE_TARGET -----------------------------------------------------------------------------------------

HOVER = 0.489


def yawing(kind: str) -> Rig:
    rig = flying()
    rig.stream_period_s = 0.02
    rig.enter_offboard(lambda _: rig.attitude(0.0, 0.0, 0.0, HOVER))
    rig.run(3.0)
    began_s = rig.now_s
    shown: list[float] = []

    def setpoint(now_s: float) -> object:
        yaw = 0.25 * (now_s - began_s)
        shown.append(rig.stub.autopilot.vehicle.yaw)
        present = shown[-2] if len(shown) > 1 else 0.0  # from ATTITUDE, a tick old
        return {
            "mask 7, yaw integrated": rig.attitude(0.0, 0.0, yaw, HOVER),
            "mask 3, yaw integrated": rig.attitude(0.0, 0.0, yaw, HOVER, mask=3, yaw_rate=0.25),
            "mask 3, present yaw": rig.attitude(0.0, 0.0, present, HOVER, mask=3, yaw_rate=0.25),
            "mask 7, present yaw": rig.attitude(0.0, 0.0, present, HOVER),
        }[kind]

    rig.streaming = setpoint
    return rig


@pytest.mark.parametrize(
    ("kind", "steady"),
    [
        ("mask 7, yaw integrated", 0.25),
        ("mask 3, yaw integrated", 0.25),
        ("mask 3, present yaw", 0.2369),
        ("mask 7, present yaw", 0.0),
    ],
)
def test_yaw_of_attitude_setpoints(kind: str, steady: float) -> None:
    rig = yawing(kind)
    rig.run(6.0)
    rates = []
    for _ in range(100):
        rig.run(0.05)
        rates.append(-rig.stub.truth().turn_rate_rad_s)
    assert sum(rates) / len(rates) == pytest.approx(steady, abs=0.012)


def test_feed_forward_makes_the_yaw_faster() -> None:
    slow, fast = yawing("mask 7, yaw integrated"), yawing("mask 3, yaw integrated")
    times = [first_time(r, lambda r=r: -r.stub.truth().turn_rate_rad_s >= 0.63 * 0.25, 4.0) for r in (slow, fast)]
    assert times[1] == pytest.approx(0.38, rel=0.25)
    assert times[0] > 1.3 * times[1]


@pytest.mark.parametrize(("roll", "pitch", "north", "east"), [(0.1, 0.0, 0, 1), (0.0, -0.1, 1, 0), (0.0, 0.1, -1, 0)])
def test_tilt_accelerates_that_way(roll: float, pitch: float, north: int, east: int) -> None:
    rig = flying(start_heading_rad=math.pi / 2)
    rig.enter_offboard(lambda _: rig.attitude(roll, pitch, 0.0, HOVER))
    rig.run(2.0)
    truth = rig.stub.truth()
    vn, ve = truth.speed_m_s * math.sin(truth.course_rad), truth.speed_m_s * math.cos(truth.course_rad)
    # g tan(0.1) pushes, the air holds back: v = a / k (1 - exp(-k t)), less the time that tilting takes
    expected = 9.80665 * math.sin(0.1) / 0.15 * (1.0 - math.exp(-0.15 * 1.9))
    assert (vn, ve) == pytest.approx((north * expected, east * expected), abs=0.15)


def test_attitude_mode_drifts_with_the_wind() -> None:
    rig = flying(wind_east_m_s=6.0)
    rig.enter_offboard(lambda _: rig.attitude(0.0, 0.0, 0.0, HOVER))
    rig.run(40.0)
    truth = rig.stub.truth()
    assert truth.speed_m_s == pytest.approx(6.0, abs=0.3)
    assert truth.course_rad == pytest.approx(0.0, abs=0.05)


def test_gusts_have_the_size_asked_for() -> None:
    rig = Rig(gust_sigma_m_s=2.0, gust_tau_s=1.0)
    winds = []
    for _ in range(600):
        rig.run(1.0, dt_s=1.0)
        winds.append(rig.stub.truth().wind_east_m_s)
    mean = sum(winds) / len(winds)
    assert math.sqrt(sum((w - mean) ** 2 for w in winds) / len(winds)) == pytest.approx(2.0, rel=0.15)


def test_a_wrong_compass_turns_body_velocities() -> None:
    error = math.radians(20.0)
    rig = flying(compass_error_rad=error, streams=(30,))
    rig.enter_offboard(lambda _: rig.local(velocity=(5.0, 0.0, 0.0)))
    rig.run(6.0)
    truth = rig.stub.truth()
    assert rig.all("ATTITUDE")[-1].yaw == pytest.approx(error, abs=0.01)
    assert math.remainder(truth.course_rad - truth.heading_rad, 2 * math.pi) == pytest.approx(-error, abs=0.01)


@pytest.mark.parametrize("seed", range(20))
def test_body_rates_are_those_of_the_turning_quaternion(seed: int) -> None:
    """Truth: twice the vector part of q* dq, by a central difference of quaternions that the test makes itself."""
    draw = random.Random(seed)
    roll, pitch, yaw = draw.uniform(-3.0, 3.0), draw.uniform(-1.2, 1.2), draw.uniform(-3.0, 3.0)
    rates = tuple(draw.uniform(-2.0, 2.0) for _ in range(3))
    h = 1e-5
    a, b = (quaternion(roll + s * h * rates[0], pitch + s * h * rates[1], yaw + s * h * rates[2]) for s in (-1.0, 1.0))
    w, x, y, z = quaternion(roll, pitch, yaw)
    turned = product((w, -x, -y, -z), tuple((q - p) / h for p, q in zip(a, b, strict=True)))[1:]
    assert body_rates(roll, pitch, *rates) == pytest.approx(turned, abs=1e-6)
    assert angle_rates(roll, pitch, *turned) == pytest.approx(rates, abs=1e-5)
