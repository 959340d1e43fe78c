"""Every vehicle class: THE sign flip, the numbers measured on PX4 and ArduPilot, and what must never leave."""

from __future__ import annotations

import math
import random

import pytest

from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.setpoints import SetpointError, SetpointLimits, attitude, position_target
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.plug import Options
from circumnav_mav.types import TurnRateSetpoint

G = 9.80665
NAN = math.nan
CLASSES = sorted(VEHICLES)
V = 12.0
LEVEL = VehicleState(
    roll_rad=0.0,
    pitch_rad=-0.02,
    yaw_rad=1.0,
    yaw_rate_rad_s=0.0,
    height_m=100.0,
    climb_m_s=0.0,
    airspeed_m_s=V,
    throttle=0.8,
    speed_m_s=V,
    course_rad=1.0,
    north_m=10.0,
    east_m=-20.0,
    down_m=-100.0,
    in_air=True,
)


def encoder(name: str, *, speed: float = V, bank_deg: float = 30.0, turn_rate: float = 0.4, lead: float | None = None):
    vehicle = VEHICLES[name]
    limits = SetpointLimits(turn_rate, speed)
    lead_s = vehicle.lead_s if lead is None else lead
    made = vehicle.encoder(Options(limits, speed, math.radians(bank_deg), lead_s, math.radians(-3.0), 0.7))
    assert not made.lacks
    return made


def steady(name: str, turn_rate: float, state: VehicleState = LEVEL, *, for_s: float = 0.0, **options):
    """Return the fields after a while of the same setpoint and the same state."""
    made = encoder(name, **options)
    speed = options.get("speed", V)
    t_s = 1.0
    encoded = made.encode(TurnRateSetpoint(t_s, turn_rate, speed, 100.0), state, t_s)
    while t_s < 1.0 + for_s:
        t_s += 0.02
        encoded = made.encode(TurnRateSetpoint(t_s, turn_rate, speed, 100.0), state, t_s)
    assert encoded is not None
    return encoded[1]


def roll_of(q) -> float:
    w, x, y, z = q
    return math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))


def yaw_of(q) -> float:
    w, x, y, z = q
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def pitch_of(q) -> float:
    w, x, y, z = q
    return math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))


def clockwise(name: str, fields) -> float:
    """Return something that is positive where the message turns the vehicle clockwise, from the message alone."""
    if "q" in fields:
        return roll_of(fields["q"])
    if fields["type_mask"] == 3072:  # centripetal acceleration to the right of the velocity
        return fields["vx"] * fields["afy"] - fields["vy"] * fields["afx"]
    if name == "px4_rover":  # it ignores the yaw rate: the velocity points where to turn
        return fields["vy"]
    return fields["yaw_rate"]


@pytest.mark.parametrize("name", CLASSES)
def test_counter_clockwise_inside_is_clockwise_negative_on_the_wire(name):
    assert clockwise(name, steady(name, -0.2)) > 0.0
    assert clockwise(name, steady(name, +0.2)) < 0.0
    assert clockwise(name, steady(name, 0.0)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", CLASSES)
def test_whatever_is_heard_or_not_what_leaves_is_finite_and_within_its_limits(name):
    """Random states with random gaps, gusts and jumps, for two minutes of ticks each."""
    draw = random.Random(7)
    for flight in range(5):
        made = encoder(name)
        for tick in range(1500):
            wild = VehicleState(
                *(NAN if draw.random() < 0.1 else draw.uniform(-1.0, 1.0) * size for size in SIZES), in_air=True
            )
            setpoint = TurnRateSetpoint(tick * 0.02, draw.uniform(-0.4, 0.4), draw.choice((0.0, V)), 100.0)
            encoded = made.encode(setpoint, wild, tick * 0.02)
            if encoded is None:
                continue
            message, fields = encoded
            for key, value in fields.items():
                values = value if isinstance(value, tuple) else (value,)
                assert all(math.isfinite(v) for v in values), (flight, tick, key, value, wild)
            if message == "SET_ATTITUDE_TARGET":
                assert abs(roll_of(fields["q"])) <= math.radians(30.0) + 1e-9
                assert abs(pitch_of(fields["q"])) <= math.radians(20.0) + 1e-9
                assert 0.0 <= fields["thrust"] <= 1.0
                if name != "arduplane":
                    assert not fields["type_mask"] & 64, "THROTTLE_IGNORE is thrust zero on PX4"


SIZES = (1.0, 0.5, math.pi, 0.5, 300.0, 8.0, 30.0, 1.0, 30.0, math.pi, 1e4, 1e4, 300.0)


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("bad", [NAN, math.inf, 0.41, -0.41])
def test_a_turn_rate_that_is_not_finite_or_past_the_limit_raises(name, bad):
    with pytest.raises(SetpointError):
        encoder(name).encode(TurnRateSetpoint(1.0, bad, V, 100.0), LEVEL, 1.0)


# -- what was measured ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("turn_rate", "roll_deg"), [(0.10, 7.0), (0.20, 13.8), (0.30, 20.2)])
def test_px4_airplane_banks_as_measured(turn_rate, roll_deg):
    """PX4.md 5.1, V = 12."""
    fields = steady("px4_fixed_wing", -turn_rate)
    assert fields["type_mask"] == 7
    assert math.degrees(roll_of(fields["q"])) == pytest.approx(roll_deg, abs=0.06)


@pytest.mark.parametrize(
    ("turn_rate", "roll_deg"), [(0.05, 6.40), (0.10, 12.64), (0.20, 24.16), (0.30, 33.94), (0.40, 41.90)]
)
def test_arduplane_banks_as_measured_in_a_coordinated_turn(turn_rate, roll_deg):
    """ARDUPILOT.md 3, V = 22; the mask that leaves pitch and throttle to TECS."""
    coordinated = LEVEL._replace(roll_rad=math.radians(roll_deg), yaw_rate_rad_s=turn_rate, airspeed_m_s=22.0)
    fields = steady("arduplane", -turn_rate, coordinated, speed=22.0, bank_deg=45.0)
    assert fields["type_mask"] == 254
    assert math.degrees(roll_of(fields["q"])) == pytest.approx(roll_deg, abs=0.02)
    assert pitch_of(fields["q"]) == 0.0


def test_arduplane_learns_that_a_bank_turns_less_and_banks_more():
    """The simulated plane gives 0.745 of a coordinated turn: 0.2 rad/s then takes the bank of 0.268 rad/s."""
    roll = math.radians(24.16)
    lazy = LEVEL._replace(roll_rad=roll, yaw_rate_rad_s=0.745 * G * math.tan(roll) / 22.0, airspeed_m_s=22.0)
    fields = steady("arduplane", -0.2, lazy, for_s=30.0, speed=22.0, bank_deg=45.0)
    assert roll_of(fields["q"]) == pytest.approx(math.atan(22.0 * 0.2 / 0.745 / G), abs=0.005)


def test_arduplane_never_believes_that_a_bank_does_nothing():
    stuck = LEVEL._replace(roll_rad=0.4, yaw_rate_rad_s=0.0, airspeed_m_s=22.0)
    fields = steady("arduplane", -0.2, stuck, for_s=60.0, speed=22.0, bank_deg=45.0)
    assert roll_of(fields["q"]) <= math.atan(22.0 * 0.2 / 0.6 / G) + 1e-9


def test_arduplane_gets_its_heading_and_height_once_as_control_begins():
    heading, height = encoder("arduplane").engaged(LEVEL._replace(yaw_rad=math.radians(-90.0)), 95.0)
    assert (heading.command, heading.frame, heading.params[0]) == (43002, 3, 1.0)
    assert heading.params[1] == pytest.approx(270.0)
    assert (height.command, height.frame) == (43001, 3)
    assert height.params[2] == 0.0, "with a rate it climbs at 3 % of it"
    assert height.params[6] == 95.0
    assert [c.command for c in encoder("arduplane").engaged(LEVEL, NAN)] == [43002], "no height: none is sent"


def test_arducopter_sends_what_it_flew_with():
    """The recorded setpoint of ARDUPILOT.md 7 (V = 5, 0.25 rad/s): frame 8, mask 1479; the lead is ours."""
    fields = steady("arducopter", -0.25, speed=5.0, lead=0.0)
    assert (fields["coordinate_frame"], fields["type_mask"]) == (8, 1479)
    assert (fields["vx"], fields["vy"], fields["vz"]) == (5.0, 0.0, 0.0)
    ahead = steady("arducopter", -0.25, speed=5.0)
    assert math.atan2(ahead["vy"], ahead["vx"]) == pytest.approx(0.155, abs=0.001)  # the lag measured at 20 Hz


def test_arducopter_turns_the_heading_as_asked_though_it_is_tilted():
    """At roll 6.5 and pitch -12.8 degrees the heading turned at 0.2585 for 0.25 asked."""
    tilted = LEVEL._replace(roll_rad=math.radians(6.5), pitch_rad=math.radians(-12.8))
    asked = steady("arducopter", -0.25, tilted, speed=5.0)["yaw_rate"]
    assert asked * 0.2585 / 0.25 == pytest.approx(0.25, rel=0.003)


def test_px4_rover_steers_by_the_direction_of_its_velocity():
    """PX4.md 6: the yaw rate is ignored, rate = RO_YAW_P (3) x direction, to the right is y."""
    fields = steady("px4_rover", -0.3, speed=2.0)
    assert math.atan2(fields["vy"], fields["vx"]) == pytest.approx(0.1)
    assert math.hypot(fields["vx"], fields["vy"]) == pytest.approx(2.0)
    assert fields["vz"] == 0.0


def test_multirotor_attitude_sends_the_present_yaw_and_the_rate_beside_it():
    fields = steady("px4_multirotor_attitude", -0.25, speed=5.0)
    assert fields["type_mask"] == 3
    assert yaw_of(fields["q"]) == pytest.approx(1.0)
    assert fields["body_yaw_rate"] == 0.25
    assert roll_of(fields["q"]) == pytest.approx(math.atan(5.0 * 0.25 / G))
    assert pitch_of(fields["q"]) == pytest.approx(math.radians(-3.0))
    vertical = fields["thrust"] * math.cos(roll_of(fields["q"])) * math.cos(pitch_of(fields["q"]))
    assert vertical == pytest.approx(0.7), "the tilt takes nothing from what carries the vehicle"


def test_without_an_attitude_nothing_leaves_that_needs_one():
    for name in ("px4_multirotor_attitude", "px4_fixed_wing"):
        blind = LEVEL._replace(roll_rad=NAN, pitch_rad=NAN, yaw_rad=NAN)
        assert encoder(name).encode(TurnRateSetpoint(1.0, 0.1, V, 100.0), blind, 1.0) is None


def test_a_curved_path_goes_through_the_vehicle_and_bends_by_the_turn_rate():
    """PX4.md 5.2: position own x, own y, z; velocity V(cos, sin); acceleration V u (-sin, cos), u clockwise."""
    f = steady("px4_fixed_wing_position", -0.2)
    assert (f["coordinate_frame"], f["type_mask"]) == (1, 3072)
    assert (f["x"], f["y"], f["z"]) == (10.0, -20.0, -100.0)
    speed = math.hypot(f["vx"], f["vy"])
    assert speed == pytest.approx(V)
    assert (f["vx"] * f["afx"] + f["vy"] * f["afy"]) == pytest.approx(0.0, abs=1e-9)
    curvature = (f["vx"] * f["afy"] - f["vy"] * f["afx"]) / speed**3
    assert curvature == pytest.approx(0.2 / V)


def test_a_curved_path_runs_ahead_of_the_course_by_a_little_only():
    f = steady("px4_fixed_wing_position", -0.3, for_s=10.0)
    ahead = math.atan2(f["vy"], f["vx"]) - LEVEL.course_rad
    assert ahead == pytest.approx(0.15), "on the leash, to the right"


# -- the height and airspeed loop -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "key", "sign"),
    [
        ({"height_m": 95.0}, "pitch", +1),
        ({"height_m": 105.0}, "pitch", -1),
        ({"airspeed_m_s": 11.5}, "thrust", +1),
        ({"airspeed_m_s": 13.0}, "thrust", -1),
        ({"climb_m_s": 1.0}, "pitch", -1),
    ],
)
def test_the_airplane_loop_pushes_the_right_way(change, key, sign):
    def read(fields):
        return pitch_of(fields["q"]) if key == "pitch" else fields["thrust"]

    before, after = (steady("px4_fixed_wing", 0.0, s) for s in (LEVEL, LEVEL._replace(**change)))
    assert math.copysign(1, read(after) - read(before)) == sign


def test_speed_goes_before_height():
    """Near the stall the nose goes down, however far below its height the airplane is."""
    slow = LEVEL._replace(height_m=50.0, airspeed_m_s=9.0)
    assert pitch_of(steady("px4_fixed_wing", 0.0, slow)["q"]) < math.radians(-3.0)


@pytest.mark.parametrize("name", ["px4_fixed_wing", "px4_multirotor_attitude"])
def test_trims_are_learned_in_the_air_alone(name):
    vehicle = VEHICLES[name]
    options = Options(SetpointLimits(0.4, V), V, 0.5, 0.0, math.radians(-3.0) if vehicle.wants_pitch else NAN, NAN)
    made = vehicle.encoder(options)
    stay = TurnRateSetpoint(1.0, 0.0, 0.0, NAN)
    ground = LEVEL._replace(in_air=False, throttle=0.0, airspeed_m_s=0.0)
    for tick in range(200):
        assert made.encode(stay, ground, tick * 0.02) is None
    assert made.lacks
    for tick in range(200, 400):
        made.encode(stay, LEVEL, tick * 0.02)
    assert not made.lacks
    flying = made.encode(TurnRateSetpoint(9.0, 0.0, V, 100.0), LEVEL, 9.0)
    assert flying is not None
    lift = flying[1]["thrust"] * (math.cos(pitch_of(flying[1]["q"])) if vehicle.wants_pitch else 1.0)
    assert lift == pytest.approx(0.8 * (math.cos(LEVEL.pitch_rad) if vehicle.wants_pitch else 1.0), abs=0.01)


# -- the last check before the wire ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong", [{"thrust": NAN}, {"thrust": 1.01}, {"thrust": -0.1}, {"roll_rad": NAN}, {"pitch_rad": 1.1}]
)
def test_px4_checks_no_attitude_so_we_do(wrong):
    right = {"roll_rad": 0.1, "pitch_rad": 0.0, "yaw_rad": 3.0, "thrust": 0.5}
    attitude(1.0, 7, **right)
    with pytest.raises(SetpointError):
        attitude(1.0, 7, **{**right, **wrong})


def test_a_nan_in_a_position_target_raises():
    with pytest.raises(SetpointError):
        position_target(1.0, 8, 1479, vx=NAN)
