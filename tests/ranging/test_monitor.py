"""The monitor on streams whose rate, jitter, delay and noise are known."""

from __future__ import annotations

import math
import random

import pytest

from circumnav_mav.ranging.counts import Counts
from circumnav_mav.ranging.monitor import Monitor
from circumnav_mav.types import RangeSample, Rejected


def test_rate_jitter_delay_and_noise():
    rng = random.Random(3)
    counts = Counts()
    monitor = Monitor(counts, 100.0)
    for n in range(400):
        arrival_s = 100.05 + 0.05 * n + rng.gauss(0.0, 0.004)
        range_m = 80.0 + 5.0 * (0.05 * n) + 0.2 * (0.05 * n) ** 2 + rng.gauss(0.0, 0.3)
        sample = RangeSample(arrival_s - 0.03, range_m)
        counts.add(sample)
        monitor.add(sample, arrival_s)
    status = monitor.status(120.05)
    assert status.rate_hz == pytest.approx(20.0, rel=0.02)
    assert status.jitter_s == pytest.approx(0.004 * math.sqrt(2.0), rel=0.2)
    assert status.delay_s == pytest.approx(0.03)
    assert status.noise_m == pytest.approx(0.3, rel=0.25)
    assert status.age_s == pytest.approx(120.05 - sample.t_s)
    assert status.longest_gap_s < 0.12
    assert status.accepted == 400
    assert status.last == sample


def test_a_sensor_that_falls_silent_is_seen():
    monitor = Monitor(Counts(), 0.0)
    for n in range(100):
        monitor.add(RangeSample(0.1 * n, 50.0), 0.1 * n)
    assert monitor.status(9.9).rate_hz == pytest.approx(10.0, rel=0.02)
    assert math.isnan(monitor.status(9.9).delay_s), "dated by their arrival: nothing tells how late they are"
    assert monitor.status(12.9).longest_gap_s == pytest.approx(3.0)
    late = monitor.status(40.0)
    assert late.rate_hz == 0.0
    assert late.age_s == pytest.approx(40.0 - 9.9)
    assert late.longest_gap_s >= 10.0
    assert late.last is not None


def test_nothing_yet_is_nan_and_not_an_error():
    status = Monitor(Counts(), 5.0).status(5.0)
    assert math.isnan(status.rate_hz)
    assert math.isnan(status.age_s)
    assert math.isnan(status.noise_m)
    assert status.last is None
    assert Monitor(Counts(), 5.0).status(6.0).rate_hz == 0.0


def test_rejections_are_shown_by_reason_with_the_last_words():
    counts = Counts()
    monitor = Monitor(counts, 0.0)
    for n in range(3):
        rejected = Rejected(0.1 * n, "stale", f"{n} s old")
        counts.add(rejected)
        monitor.add(rejected, 0.1 * n)
    status = monitor.status(1.0)
    assert status.rejected == {"stale": 3}
    assert status.details == {"stale": "2 s old"}
    assert counts.total_rejected == 3


def test_memory_is_bounded():
    monitor = Monitor(Counts(), 0.0)
    for n in range(20_000):
        monitor.add(RangeSample(0.0001 * n, 50.0), 0.0001 * n)
    assert monitor.status(2.0).rate_hz > 1000.0
