"""The clock conversion against a simulated device whose clock, delays, reboots and steps are known."""

from __future__ import annotations

import random

import pytest

from circumnav_mav.ranging.stamps import StampClock


def run(clock, measured_s, offset_s, delays_s, drift=0.0):
    """Return the error [s] of each conversion: converted minus true time of measurement, both on our clock."""
    errors = []
    for t_s, delay_s in zip(measured_s, delays_s, strict=True):
        stamp_s = (t_s - offset_s) * (1.0 + drift)
        errors.append(clock.to_ours(stamp_s, t_s + delay_s) - t_s)
    return errors


def test_the_varying_part_of_the_delay_is_taken_out():
    rng = random.Random(1)
    times = [10.0 + 0.1 * n for n in range(3000)]
    delays = [0.02 + rng.expovariate(1 / 0.05) for _ in times]
    errors = run(StampClock(), times, 1234.5, delays)
    settled = errors[200:]
    assert max(settled) - 0.02 < 0.005
    assert min(settled) > 0.02 - 1e-9
    assert sum(delays[200:]) / len(settled) > 0.06


@pytest.mark.parametrize("drift", [-50e-6, 50e-6])
def test_a_drifting_clock_is_followed(drift):
    times = [10.0 + 0.1 * n for n in range(20_000)]
    errors = run(StampClock(), times, 5.0, [0.02] * len(times), drift)
    assert all(abs(error - 0.02) <= 50e-6 * 61.0 for error in errors)


def test_never_after_the_arrival_and_never_backwards():
    rng = random.Random(2)
    clock, last_s = StampClock(), 0.0
    for n in range(5000):
        measured_s, arrival_s = 10.0 + 0.1 * n, 10.0 + 0.1 * n + rng.random() * 0.09
        ours_s = clock.to_ours(measured_s - 3.0, arrival_s)
        assert last_s <= ours_s <= arrival_s
        last_s = ours_s


def test_a_reboot_is_followed_after_three_stamps():
    clock = StampClock()
    run(clock, [10.0 + 0.1 * n for n in range(100)], 0.0, [0.02] * 100)
    errors = run(clock, [30.0 + 0.1 * n for n in range(5)], 29.9, [0.02] * 5)
    assert errors[0] < -1.0 and errors[1] < -1.0
    assert errors[2:] == pytest.approx([0.02] * 3)


def test_one_old_packet_is_no_reboot():
    clock = StampClock()
    run(clock, [10.0 + 0.1 * n for n in range(100)], 0.0, [0.02] * 100)
    assert clock.to_ours(12.0, 20.02) == pytest.approx(12.02)
    assert clock.to_ours(20.1, 20.12) == pytest.approx(20.12)


def test_a_clock_that_steps_forward_is_followed_at_once():
    clock = StampClock()
    run(clock, [10.0 + 0.1 * n for n in range(100)], 0.0, [0.02] * 100)
    assert clock.to_ours(5000.0, 20.02) == pytest.approx(20.02)


def test_wrong_units_never_make_a_sample_look_newer_than_it_is():
    clock = StampClock()
    for n in range(100):
        assert clock.to_ours(n * 100.0, 10.0 + 0.1 * n) <= 10.0 + 0.1 * n


HZ = 10.0


def ages(clock, measured_s, stamps_s, delays_s):
    """Return the age [s] on arrival of each sample, as the clock has it."""
    arrivals = [t_s + delay_s for t_s, delay_s in zip(measured_s, delays_s, strict=True)]
    return [a_s - clock.to_ours(stamp_s, a_s) for stamp_s, a_s in zip(stamps_s, arrivals, strict=True)]


def jittered(times, seed=3):
    rng = random.Random(seed)
    return [0.02 + rng.expovariate(1 / 0.02) for _ in times]


@pytest.mark.parametrize("paused", [False, True], ids=["set back", "paused"])
@pytest.mark.parametrize("lost_s", [0.4, 1.5, 20.0])
@pytest.mark.parametrize("hz", [2.0, 10.0, 50.0])
def test_a_clock_that_lost_time_is_doubted_within_seconds(lost_s, hz, paused):
    """Set back: the samples go on. Paused: the device stood still, samples and all, as a simulator does."""
    times = [10.0 + n / hz for n in range(int(60 * hz))]
    after = len(times) // 2
    stamps = [t_s - (lost_s if n >= after else 0.0) for n, t_s in enumerate(times)]
    if paused:
        times = [t_s + (lost_s if n >= after else 0.0) for n, t_s in enumerate(times)]
        stamps = [10.0 + n / hz for n in range(len(times))]
    clock = StampClock()
    late = ages(clock, times, stamps, jittered(times))
    assert max(late[after + int(3 * hz) :]) < 0.25
    assert clock.doubts <= 1
    assert not clock.doubts or clock.lost_s == pytest.approx(lost_s, abs=0.1)


def test_a_lost_second_is_said():
    times = [10.0 + n / HZ for n in range(400)]
    clock = StampClock()
    ages(clock, times[:200], times[:200], jittered(times[:200]))
    assert clock.words == ""
    later = [t_s + 1.5 for t_s in times[200:]]
    ages(clock, later, times[200:], jittered(later))
    assert clock.doubts == 1 and "lost 1.5" in clock.words


def test_a_gained_second_is_followed_at_once():
    times = [10.0 + n / HZ for n in range(600)]
    stamps = [t_s + (1.0 if n >= 300 else 0.0) for n, t_s in enumerate(times)]
    clock = StampClock()
    assert max(ages(clock, times, stamps, jittered(times))) < 0.25
    assert clock.doubts == 0


@pytest.mark.parametrize("rate", [0.95, 0.98, 0.99, 0.999, 1.0, 1.001, 1.02, 1.05])
@pytest.mark.parametrize("hz", [2.0, 10.0, 50.0])
def test_a_clock_at_another_rate_is_followed(rate, hz):
    """The true delay is 20 ms and up; the age seen stays within 0.25 s of what varies of it."""
    times = [10.0 + n / hz for n in range(int(120 * hz))]
    delays = jittered(times)
    clock = StampClock()
    seen = ages(clock, times, [7.0 + rate * t_s for t_s in times], delays)
    over = [age_s - (delay_s - 0.02) for age_s, delay_s in zip(seen, delays, strict=True)]
    assert max(over) < 0.25
    settled = over[int(30 * hz) :]
    assert max(settled) < 0.12
    assert min(settled) > -0.15
    assert clock.doubts == 0


def test_a_clock_that_becomes_slow_is_followed_and_said():
    times = [10.0 + n / HZ for n in range(3000)]
    stamps = [t_s - 0.05 * max(0.0, t_s - 100.0) for t_s in times]
    clock = StampClock()
    seen = ages(clock, times, stamps, jittered(times))
    assert max(seen) < 0.6
    assert max(seen[1200:]) < 0.3
    assert clock.rate == pytest.approx(0.05, abs=0.002) and clock.words


def test_jitter_alone_is_never_doubted():
    for seed in range(20):
        rng = random.Random(seed)
        times = [10.0 + n / HZ for n in range(1200)]
        clock = StampClock()
        ages(clock, times, times, [0.02 + rng.expovariate(1 / 0.1) for _ in times])
        assert clock.doubts == 0 and clock.rate == 0.0


@pytest.mark.parametrize("growth", [0.15, 0.3, 1.0])
def test_a_growing_backlog_is_seen_as_age(growth):
    """A line that carries less than the device says: each sample waits longer than the one before it."""
    times = [10.0 + n / HZ for n in range(400)]
    delays = [0.02 + growth * max(0.0, t_s - 30.0) for t_s in times]
    clock = StampClock()
    seen = ages(clock, times, times, delays)
    assert clock.doubts == 0
    assert all(age_s == pytest.approx(delay_s - 0.02) for age_s, delay_s in zip(seen, delays, strict=True))


def test_a_backlog_that_runs_empty_is_seen_as_age():
    """Held up for 3 s, then all that waited comes at twice the pace."""
    times = [10.0 + n / HZ for n in range(400)]
    delays = [max(0.02, 3.02 - 0.5 * (t_s - 30.0)) if t_s >= 30.0 else 0.02 for t_s in times]
    clock = StampClock()
    seen = ages(clock, times, times, delays)
    assert clock.doubts == 0
    assert all(age_s == pytest.approx(delay_s - 0.02) for age_s, delay_s in zip(seen, delays, strict=True))


def test_one_stamp_from_the_future_is_outlived():
    times = [10.0 + n / HZ for n in range(400)]
    stamps = [t_s + (5.0 if n == 200 else 0.0) for n, t_s in enumerate(times)]
    late = ages(StampClock(), times, stamps, jittered(times))
    assert max(late[230:]) < 0.25
