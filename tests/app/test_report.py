"""The figures of a flight against hand-made ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from circumnav_mav.config import Config
from circumnav_mav.report import Track, draw, lines, settling, summarise
from circumnav_mav.runtime.app import Result

RESULT = Result("completed", "the end", "finished", engaged_s=10.0, duration_s=110.0, ticks=5500, missed_ticks=3)


def track(error) -> Track:
    t_s = np.arange(10.0, 110.0, 0.1)
    return Track("truth", t_s, np.array([error(t) for t in t_s]))


def test_settling_counts_from_engagement_to_the_last_entry_of_the_band():
    # Outside until 30 s, inside to 50 s, outside once more until 60 s: settled at 60 s, 50 s after engagement.
    settle_s, rms_m, worst_m = settling(Config(), track(lambda t: 9.0 if t < 30 or 50 < t < 60 else 1.0))
    assert settle_s == pytest.approx(50.0, abs=0.11)
    assert (rms_m, worst_m) == (1.0, 1.0)


def test_the_tail_is_the_last_half_after_settling():
    # Settled at once, at 10 s; the track ends at 109.9 s, so the tail begins at 59.95 s.
    _, rms_m, worst_m = settling(Config(), track(lambda t: 2.0 if t < 59.9 else 0.5))
    assert (rms_m, worst_m) == (0.5, 0.5)


def test_an_orbit_that_ends_outside_never_settled():
    assert settling(Config(), track(lambda t: 1.0 if t < 100 else 9.0)) == (None, None, None)
    assert settling(Config(), track(lambda t: math.nan)) == (None, None, None)


def test_the_band_is_not_narrower_than_three_sigmas():
    noisy = Config.model_validate({"ranging": {"sigma_m": 3.0}})
    assert settling(noisy, track(lambda t: 8.9))[0] == 0.0
    assert settling(Config(), track(lambda t: 8.9))[0] is None


def test_the_json_has_the_documented_fields_and_null_for_what_is_not_there(tmp_path):
    ticks = {
        "t_s": ["1", "2"],
        "phase": ["ready", "ready"],
        "lateness_s": ["0.001", "0.002"],
        "sample_age_s": ["1", "2"],
    }
    summary = summarise(Config(), RESULT, {**ticks, "r_m": ["nan", "60"]}, None)
    path = tmp_path / "out.json"
    summary.write(path)
    read = json.loads(path.read_text())
    assert set(read) == {
        *("outcome", "text", "phase", "error_from", "orbit_radius_m", "settle_time_s", "tail_rms_error_m"),
        *(
            "tail_max_error_m",
            "ticks",
            "missed_ticks",
            "tick_lateness_p99_s",
            "sample_age_p99_s",
            "limited",
            "rejected",
            "duration_s",
            "target",
        ),
    }
    assert (read["settle_time_s"], read["sample_age_p99_s"], read["error_from"]) == (None, None, "estimate")
    assert read["tick_lateness_p99_s"] == pytest.approx(0.00199)
    assert any("never settled" in line for line in lines(summary))


def test_what_was_taken_from_the_law_is_a_share_of_the_engaged_ticks():
    ticks = {
        "t_s": ["1", "2", "3", "4", "5"],
        "phase": ["ready", "acquiring", "orbiting", "coasting", "released"],
        "r_m": ["60"] * 5,
        "lateness_s": ["0"] * 5,
        "sample_age_s": ["0"] * 5,
        "saturated": ["0", "1", "1", "0", "0"],
        "slewed": ["0", "1", "0", "0", "0"],
        "barrier": ["0", "0", "0", "0", "0"],
        "way_out": ["1", "1", "0", "0", "0"],
    }
    summary = summarise(Config(), RESULT, ticks, None)
    assert summary.limited == {"saturated": 0.6667, "slewed": 0.3333, "barrier": 0.0, "way_out": 0.3333}
    assert any("saturated 66.7%, slewed 33.3%, barrier 0.0%, way_out 33.3%" in line for line in lines(summary))


def test_the_place_of_the_target_is_the_last_that_was_known_while_engaged():
    columns = {
        "target_lat_deg": ["nan", "47.5", "47.6", "nan", "47.9"],
        "target_lon_deg": ["nan", "8.5", "8.6", "nan", "8.9"],
        "target_east_m": ["nan", "10", "-20", "nan", "99"],
        "target_north_m": ["nan", "5", "30", "nan", "99"],
        "target_sigma_m": ["nan", "4", "2.5", "nan", "9"],
        "drift_east_m_s": ["nan", "1", "1.5", "nan", "9"],
        "drift_north_m_s": ["nan", "0", "-0.5", "nan", "9"],
        "drift_sigma_m_s": ["nan", "nan", "nan", "nan", "9"],
    }
    ticks = {
        "t_s": ["1", "2", "3", "4", "5"],
        "phase": ["ready", "acquiring", "orbiting", "coasting", "released"],
        "r_m": ["60"] * 5,
        "sample_age_s": ["0"] * 5,
    }
    summary = summarise(Config(), RESULT, ticks | columns, None)
    assert summary.target is not None
    assert (summary.target["t_s"], summary.target["target_east_m"], summary.target["drift_sigma_m_s"]) == (3, -20, None)
    (line,) = [line for line in lines(summary) if line.startswith("target")]
    assert line == (
        "target     -20 m east, +30 m north ± 2.5 m (47.600000, 8.600000) of the aircraft at 3.0 s; "
        "drift +1.5 m/s east, -0.5 m/s north"
    )
    assert summarise(Config(), RESULT, ticks, None).target is None
    unknown = {name: ["nan"] * 5 for name in columns}
    assert summarise(Config(), RESULT, ticks | unknown, None).target is None


def test_the_figures_are_json_whatever_was_never_known(tmp_path):
    summary = replace(summarise(Config(), RESULT, {}, None), duration_s=math.nan, target={"t_s": math.inf})
    summary.write(tmp_path / "f.json")
    text = (tmp_path / "f.json").read_text()
    figures = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert figures["duration_s"] is None and figures["target"] == {"t_s": None} and figures["phase"] == RESULT.phase


def test_a_flight_without_a_truth_is_drawn_too(tmp_path):
    ticks = {
        name: ["1.0", "2.0"] for name in ("t_s", "range_m", "r_m", "turn_rate_flown_rad_s", "turn_rate_sent_rad_s")
    }
    draw(tmp_path / "f.png", Config(), ticks, None, "title")
    assert (tmp_path / "f.png").read_bytes()[:4] == b"\x89PNG"
