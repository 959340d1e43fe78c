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
