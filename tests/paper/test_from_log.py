"""What a record tells of an aircraft, against records made by hand with known noise, lag and wind."""

import csv

import numpy as np
import pytest

from circumnav_mav.config_file import parse
from circumnav_mav.flight_record import TickRecord
from circumnav_mav.study import from_log
from circumnav_mav.study.aircraft import Aircraft


def write(file, *, sigma=0.8, every=10, dead_s=0.2, lag_s=0.5, wind=2.0, outliers=0.1, duration_s=200.0, turning=True):
    """Write a record of a plane at 12 m/s that weaves about a circle: 50 ticks a second, 5 ranges a second."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, duration_s, 0.02)
    sent = (0.15 + 0.1 * np.sign(np.sin(0.6 * t))) if turning else np.zeros_like(t)
    flown, state = np.empty_like(t), 0.0
    for n in range(len(t)):
        late = n - round(dead_s / 0.02)
        state += 0.02 / lag_s * ((sent[late] if late >= 0 else 0.0) - state)
        flown[n] = state
    heading = 1.0 + np.cumsum(flown) * 0.02
    speed = np.hypot(12 * np.cos(heading) + wind, 12 * np.sin(heading))
    truth = 80 + 15 * np.sin(0.1 * t) + 3 * np.cos(0.4 * t)
    noisy = truth + sigma * rng.normal(size=len(t)) + (rng.random(len(t)) < outliers) * rng.exponential(30, len(t))
    shown = np.round(noisy[(np.arange(len(t)) // every) * every], 2)
    with file.open("w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(TickRecord._fields)
        for n in range(len(t)):
            values = dict.fromkeys(TickRecord._fields, "") | {
                "t_s": t[n], "range_m": shown[n], "turn_rate_sent_rad_s": sent[n],
                "turn_rate_flown_rad_s": flown[n], "speed_m_s": speed[n],
            }  # fmt: skip
            rows.writerow(values.values())


def test_noise_rate_lag_and_wind_are_read_out_of_a_record(tmp_path):
    write(tmp_path / "ticks.csv")
    seen = from_log.look(tmp_path)
    assert seen.reasons == ()
    assert seen.sigma_r_m == pytest.approx(0.8, rel=0.25)  # one range in ten is an echo
    assert seen.range_rate_hz == pytest.approx(5.0, rel=0.01)
    assert seen.lag_s == pytest.approx(0.7, abs=0.06)
    assert seen.wind_m_s == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("sigma", [0.1, 3.0])
def test_noise_without_echoes_is_read_closely(tmp_path, sigma):
    write(tmp_path / "ticks.csv", sigma=sigma, outliers=0.0)
    one_error = 0.043  # of the estimate from 1,000 ranges, over 150 records of plain noise
    assert from_log.look(tmp_path / "ticks.csv").sigma_r_m == pytest.approx(sigma, rel=4.0 * one_error)


def test_what_a_record_does_not_show_is_said(tmp_path):
    write(tmp_path / "ticks.csv", turning=False, duration_s=8.0)
    seen = from_log.look(tmp_path)
    assert (seen.sigma_r_m, seen.lag_s, seen.wind_m_s) == (None, None, None)
    assert [reason.split(":")[0] for reason in seen.reasons] == ["range noise", "turn-rate lag", "wind"]


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", ",".join(TickRecord._fields) + "\n"])
def test_what_is_no_record_is_refused_in_words(tmp_path, text):
    (tmp_path / "ticks.csv").write_text(text)
    with pytest.raises(ValueError, match=r"ticks.csv"):
        from_log.look(tmp_path)
    with pytest.raises(ValueError, match="cannot read"):
        from_log.look(tmp_path / "none")
    (tmp_path / "flight.tlog").write_bytes(b"\x00\x06\x1b\xfd\x09\xff\xfe")
    with pytest.raises(ValueError, match=r"flight\.tlog: it is not text.* the ticks\.csv"):
        from_log.look(tmp_path / "flight.tlog")


def test_an_aircraft_takes_what_was_seen_and_keeps_the_rest():
    aircraft = Aircraft.of(parse("orbit: {radius_m: 60, speed_m_s: 12}"), wind_m_s=3.0, range_rate_hz=10.0)
    seen = from_log.Seen(0.9, 4.0, None, None, ("turn-rate lag: ...", "wind: ..."))
    new = aircraft.as_seen(seen)
    assert (new.sigma_r_m, new.range_rate_hz, new.lag_s, new.wind_m_s) == (0.9, 4.0, aircraft.lag_s, 3.0)
    with pytest.raises(ValueError, match="wind"):
        aircraft.as_seen(from_log.Seen(None, None, None, 13.0, ()))
