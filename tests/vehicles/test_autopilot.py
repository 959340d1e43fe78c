"""What is read from the autopilot's messages: turn rate, airspeed, height, and whether it is the right one."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from circumnav_mav.mavlink.autopilot import Autopilot, true_per_calibrated
from circumnav_mav.mavlink.codec import Decoder, Message, Splitter
from circumnav_mav.mavlink.dialect import by_name
from circumnav_mav.mavlink.height import Height
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.fitness import Fitness

CAPTURES = Path(__file__).parents[2].parent / "shared" / "captures"


def recorded(name: str, messages: set[str]):
    """Yield (t_s, message) of a recorded flight, as the app's own codec reads it."""
    path = CAPTURES / name
    if not path.exists():
        pytest.skip(f"needs the recording {name} in ../shared/captures")
    data = path.read_bytes()
    splitter, decoder, at = Splitter(), Decoder(messages), 0
    while at + 20 <= len(data):
        t_s = int.from_bytes(data[at : at + 8], "big") / 1e6
        if data[at + 8] != 0xFD:  # ArduPilot's boot text before the first frame
            at += 1
            continue
        length = 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        for frame in splitter.feed(data[at + 8 : at + 8 + length], whole=True):
            message = decoder.decode(frame)
            if message is not None:
                yield t_s, message
        at += 8 + length


@pytest.mark.parametrize(
    ("name", "least_deg"), [("ap_plane_scenario.tlog", 20.0), ("px4_v1.16.0_airplane_offboard.tlog", 12.0)]
)
def test_the_turn_rate_is_the_headings_also_in_a_bank(name, least_deg):
    """Against the change of the recorded heading: ATTITUDE.yawspeed alone is the body's and falls short in a bank."""
    ap, rows = Autopilot(), []
    for t_s, message in recorded(name, {"HEARTBEAT", "ATTITUDE"}):
        if ap.on_message(message, t_s) and message.name == "ATTITUDE":
            rows.append((message.fields.time_boot_ms / 1e3, ap.roll_rad, ap.yaw_rad, ap.yaw_rate_rad_s, message.fields))
    errors, naive, windows = [], [], 0
    step = 40
    for i in range(0, len(rows) - step, step):
        window = rows[i : i + step + 1]
        rolls = [abs(math.degrees(r[1])) for r in window]
        dt = window[-1][0] - window[0][0]
        if min(rolls) < least_deg or max(rolls) - min(rolls) > 3.0 or not 0.1 < dt < 3.0:
            continue
        turned = math.remainder(window[-1][2] - window[0][2], 2 * math.pi) / dt
        errors.append(sum(r[3] for r in window) / len(window) - turned)
        naive.append(sum(r[4].yawspeed for r in window) / len(window) - turned)
        windows += 1
    assert windows >= 8
    rms = math.sqrt(sum(e * e for e in errors) / windows)
    assert rms < 0.012, (rms, windows)
    if name.startswith("ap_plane"):
        assert rms < 0.2 * math.sqrt(sum(e * e for e in naive) / windows)


@pytest.mark.parametrize(("amsl_m", "ratio"), [(0.0, 1.0), (1000.0, 1.0497), (3000.0, 1.1607), (5000.0, 1.2897)])
def test_true_airspeed_by_the_standard_atmosphere(amsl_m, ratio):
    """1 / sqrt(sigma) from the ISA tables."""
    assert true_per_calibrated(amsl_m) == pytest.approx(ratio, abs=5e-4)


def test_the_recorded_airplane_flies_its_true_airspeed_over_still_ground():
    """PX4's simulator has no wind: mean ground speed = true airspeed, which VFR_HUD's calibrated one falls short of."""
    ap, air, ground, shown = Autopilot(), [], [], []
    start_s = None
    for t_s, message in recorded("px4_v1.16.0_airplane_offboard.tlog", {"HEARTBEAT", "VFR_HUD", "LOCAL_POSITION_NED"}):
        start_s = start_s or t_s
        if not ap.on_message(message, t_s) or not 72.0 < t_s - start_s < 140.0:
            continue
        if message.name == "VFR_HUD":
            air.append(ap.airspeed_m_s)
            shown.append(message.fields.airspeed)
        elif message.name == "LOCAL_POSITION_NED":
            ground.append(math.hypot(message.fields.vx, message.fields.vy))
    flown = sum(ground) / len(ground)
    assert sum(air) / len(air) == pytest.approx(flown, rel=0.01)
    assert sum(shown) / len(shown) < 0.98 * flown


# -- height ---------------------------------------------------------------------------------------------------------


def test_the_best_source_is_taken_and_its_loss_makes_no_jump():
    height = Height()
    for i in range(100):
        t = i * 0.1
        height.take("VFR_HUD", 489.0 + 50.0, t, on_ground=False)
        height.take("GLOBAL_POSITION_INT", 48.0, t, on_ground=False)
    assert height.source == "GLOBAL_POSITION_INT"
    assert height.at(10.0, 2.0) == 48.0
    for i in range(100, 130):
        height.take("VFR_HUD", 489.0 + 50.5, i * 0.1, on_ground=False)
    assert height.source == "VFR_HUD"
    assert height.at(13.0, 2.0) == pytest.approx(48.0)
    height.take("VFR_HUD", 489.0 + 52.5, 13.0, on_ground=False)
    assert height.at(13.0, 2.0) == pytest.approx(50.0)


def test_the_barometer_alone_counts_from_the_ground_it_was_heard_on():
    height = Height()
    height.take("VFR_HUD", 489.0, 0.0, on_ground=True)
    height.take("VFR_HUD", 519.0, 20.0, on_ground=False)
    assert height.at(20.0, 2.0) == 30.0
    assert height.from_home
    airborne = Height()
    airborne.take("VFR_HUD", 519.0, 0.0, on_ground=False)
    assert airborne.at(0.0, 2.0) == 0.0
    assert not airborne.from_home


def test_a_height_that_is_not_heard_is_not_known():
    height = Height()
    assert math.isnan(height.at(0.0, 2.0))
    height.take("VFR_HUD", math.nan, 0.0, on_ground=True)
    assert math.isnan(height.at(0.0, 2.0))
    height.take("VFR_HUD", 1.0, 0.0, on_ground=True)
    assert math.isnan(height.at(2.1, 2.0))


# -- the right autopilot ---------------------------------------------------------------------------------------------


def autopilot(kind: int, vehicle_type: int, flags: int | None = 0x37F, *, lacks: tuple[str, ...] = ()) -> Autopilot:
    ap = Autopilot()
    say(ap, "HEARTBEAT", custom_mode=0, type=vehicle_type, autopilot=kind)
    for name in ("ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "VFR_HUD"):
        if name not in lacks:
            say(ap, name)
    if flags is not None:
        say(ap, "ESTIMATOR_STATUS" if kind == 12 else "EKF_STATUS_REPORT", flags=flags)
    return ap


def say(ap: Autopilot, name: str, **fields: float) -> None:
    layout = by_name(name)
    values = tuple(fields.get(f, 0 if n == 1 else (0,) * n) for f, n in zip(layout.fields, layout.lengths, strict=True))
    assert ap.on_message(Message(name, 1, 1, 0, layout.make(values)), 1.0)


PX4, ARDUPILOT, PLANE, QUAD, ROVER = 12, 3, 1, 2, 10
FITS = [
    ("px4_multirotor", PX4, QUAD),
    ("px4_multirotor_attitude", PX4, QUAD),
    ("px4_fixed_wing", PX4, PLANE),
    ("px4_fixed_wing_position", PX4, PLANE),
    ("arducopter", ARDUPILOT, QUAD),
    ("arduplane", ARDUPILOT, PLANE),
    ("px4_rover", PX4, ROVER),
]


def fitness(name: str) -> Fitness:
    return Fitness(VEHICLES[name], VEHICLES.values())


@pytest.mark.parametrize(("name", "kind", "vehicle_type"), FITS)
def test_each_class_fits_its_own_autopilot_and_no_other(name, kind, vehicle_type):
    assert fitness(name).unfit(autopilot(kind, vehicle_type), 1.0) is None
    for _, other_kind, other_type in FITS:
        if (other_kind, other_type) != (kind, vehicle_type):
            unfit = fitness(name).unfit(autopilot(other_kind, other_type), 1.0)
            assert unfit is not None
            assert unfit.final
            assert "set vehicle.class to" in unfit.text


def test_every_class_is_in_the_table_above():
    assert sorted(name for name, *_ in FITS) == sorted(VEHICLES)


@pytest.mark.parametrize(
    ("name", "kind", "vehicle_type", "lacks"),
    [
        ("px4_multirotor", PX4, QUAD, "LOCAL_POSITION_NED"),
        ("px4_fixed_wing", PX4, PLANE, "VFR_HUD"),
        ("arduplane", ARDUPILOT, PLANE, "ATTITUDE"),
    ],
)
def test_a_message_that_does_not_come_is_named_and_asked_for_again(name, kind, vehicle_type, lacks):
    judge, ap = fitness(name), autopilot(kind, vehicle_type, lacks=(lacks,))
    unfit = judge.unfit(ap, 1.0)
    assert unfit is not None
    assert not unfit.final
    assert f"no {lacks} from the autopilot" in unfit.text
    assert judge.ask_again(ap, 1.0) == []
    assert lacks in judge.ask_again(ap, 6.5)
    say(ap, lacks)
    assert judge.unfit(ap, 1.0) is None
    assert judge.ask_again(ap, 20.0) == []


@pytest.mark.parametrize("flags", [0xA7, 0x01, 0x400])  # on the ground without GPS (both autopilots); none; not started
def test_a_velocity_that_the_estimator_does_not_have_is_said_in_words(flags):
    unfit = fitness("px4_multirotor").unfit(autopilot(PX4, QUAD, flags), 1.0)
    assert unfit is not None
    assert "no horizontal velocity" in unfit.text
    assert "px4_multirotor_attitude flies" in unfit.text
    assert fitness("px4_multirotor_attitude").unfit(autopilot(PX4, QUAD, flags), 1.0) is None


@pytest.mark.parametrize(("name", "kind", "vehicle_type"), FITS)
@pytest.mark.parametrize(
    "flags", [0x3FF, 0x37F, 0x33F]
)  # recorded: PX4 on the ground with GPS, and in flight; ArduPilot
def test_what_an_autopilot_with_a_position_shows_is_fit(name, kind, vehicle_type, flags):
    assert fitness(name).unfit(autopilot(kind, vehicle_type, flags), 1.0) is None


def test_a_plane_without_an_airspeed_sensor_is_not_flown():
    ap = autopilot(PX4, PLANE)
    say(ap, "VFR_HUD", airspeed=math.nan)
    unfit = fitness("px4_fixed_wing").unfit(ap, 1.0)
    assert unfit is not None
    assert "airspeed sensor" in unfit.text


def test_a_recorded_px4_on_the_ground_is_fit_to_take_off():
    judge, ap, start_s = fitness("px4_multirotor"), Autopilot(), None
    for t_s, message in recorded("px4_v1.16.0_quadx_kdv015_offboard.tlog", set(ap.messages)):
        start_s = start_s or t_s
        ap.on_message(message, t_s)
        if t_s - start_s > 8.0:
            break
    assert not ap.armed
    assert judge.unfit(ap, t_s) is None


def test_once_fit_it_stays_fit_in_flight():
    judge, ap = fitness("px4_multirotor"), autopilot(PX4, QUAD)
    assert judge.unfit(ap, 1.0) is None
    assert judge.unfit(ap, 100.0) is None, "what is lost in flight is not this table's affair"


HELD_MODE, CHOSEN = 0x00060000, 0x03040000


def shown(custom_mode: int, name: str = "HEARTBEAT") -> object:
    if name == "CURRENT_MODE":
        return by_name(name).make((custom_mode, custom_mode, 0))
    return by_name(name).make((custom_mode, 2, 12, 0x80, 4, 3))


@pytest.mark.parametrize("rate_hz", [20, 50, 408, 800])
@pytest.mark.parametrize("after_s", [0.05, 0.2, 0.31, 0.35, 0.4, 0.5, 0.59, 0.7, 1.0])
def test_a_choice_of_mode_is_believed_however_long_after_the_mode_before_it(rate_hz, after_s):
    """Every frame has a sequence number, and every second one is read; 408 a second is PX4's rate."""
    ap, seq, frames = Autopilot(), 0, max(1, round(rate_hz * after_s))
    ap.on_message(Message("HEARTBEAT", 1, 1, 0, shown(HELD_MODE)), 0.0)
    attitude = by_name("ATTITUDE").make((0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for seq in range(2, frames, 2):
        ap.on_message(Message("ATTITUDE", 1, 1, seq % 256, attitude), seq / rate_hz)
    ap.on_message(Message("CURRENT_MODE", 1, 1, frames % 256, shown(CHOSEN, "CURRENT_MODE")), frames / rate_hz)
    assert ap.custom_mode == CHOSEN


@pytest.mark.parametrize("silent_s", [0.1, 0.2, 0.3, 0.35, 0.5, 0.6, 0.9])
def test_a_choice_of_mode_is_believed_after_an_outage(silent_s):
    ap, lost = Autopilot(), round(408 * silent_s)
    ap.on_message(Message("HEARTBEAT", 1, 1, 0, shown(HELD_MODE)), 0.0)
    ap.on_message(Message("HEARTBEAT", 1, 1, lost % 256, shown(CHOSEN)), silent_s)
    assert ap.custom_mode == CHOSEN


@pytest.mark.parametrize("late", [1, 10, 40, 120])
def test_a_mode_that_was_overtaken_is_not_news(late):
    """At 408 frames a second, by up to 0.29 s."""
    ap = Autopilot()
    attitude = by_name("ATTITUDE").make((0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    ap.on_message(Message("HEARTBEAT", 1, 1, 0, shown(HELD_MODE)), 0.0)
    for seq in range(1, 300):
        ap.on_message(Message("ATTITUDE", 1, 1, seq % 256, attitude), seq / 408)
    newest = Message("CURRENT_MODE", 1, 1, 300 % 256, shown(HELD_MODE, "CURRENT_MODE"))
    ap.on_message(newest, 300 / 408)
    ap.on_message(Message("HEARTBEAT", 1, 1, (300 - late) % 256, shown(CHOSEN)), 301 / 408)
    assert ap.custom_mode == HELD_MODE


@pytest.mark.parametrize("name", ["px4_v1.16.0_quadx_kdv015_offboard.tlog", "ap_plane_scenario.tlog"])
def test_of_a_recorded_flight_no_mode_is_dropped(name):
    ap, modes = Autopilot(), 0
    for t_s, message in recorded(name, {"HEARTBEAT", "CURRENT_MODE", "ATTITUDE"}):
        if ap.on_message(message, t_s) and message.name != "ATTITUDE":
            modes += 1
            assert ap.mode_s == t_s
    assert modes > 50
