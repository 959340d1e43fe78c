"""`circumnav tune`: what it finds is better on noise it has not seen, is the same for a seed, and flies as a file."""

import math
from dataclasses import replace

import pytest

from circumnav_mav.config import parse
from circumnav_mav.study import tune, tune_report
from circumnav_mav.study.tune import Aircraft, Gains, Score

TEXT = """# my plane
ranging: {sigma_m: 1.0}
orbit: {radius_m: 20, speed_m_s: 5}   # m
law: {name: hashemi2013, kappa: 1.0}
limits:
  turn_rate_rad_s: 1.0
"""
CONFIG = parse(TEXT)
AIRCRAFT = Aircraft.of(CONFIG, wind_m_s=1.0, range_rate_hz=5.0)


def small(**options):
    return tune.tune(CONFIG, AIRCRAFT, evaluations=8, runs=2, fresh_runs=6, keep_pair=True, **options)


@pytest.fixture(scope="module")
def tuned():
    return small()


def test_the_aircraft_is_that_of_the_configuration():
    assert (AIRCRAFT.V_m_s, AIRCRAFT.r_a_m, AIRCRAFT.turn_rate_limit_rad_s, AIRCRAFT.sigma_r_m) == (5.0, 20.0, 1.0, 1.0)
    calm, half, windy = AIRCRAFT.scenarios()
    assert (calm.wind_m_s, windy.wind_m_s, calm.range_every) == (0.0, 1.0, 4)
    assert (half.wind_m_s, half.believed_speed) == (0.5, 1.05)
    assert Aircraft.of(CONFIG).wind_m_s == 1.0  # a fifth of the speed
    with pytest.raises(ValueError, match="wind"):
        Aircraft.of(CONFIG, wind_m_s=5.0, range_rate_hz=5.0)
    with pytest.raises(ValueError, match="rate"):
        Aircraft.of(CONFIG, wind_m_s=1.0, range_rate_hz=0.0)


def test_what_was_found_is_better_on_fresh_noise_than_a_gain_of_one(tuned):
    assert tuned.best != tuned.present
    assert tuned.after.rms_worst_m < tuned.before.rms_worst_m
    assert tuned.best.estimator == "direct"


def test_the_same_seed_finds_the_same_whatever_the_workers(tuned):
    again = small(workers=1)
    assert again.flown == tuned.flown
    assert again.after == tuned.after
    assert small(seed=2).flown != tuned.flown


def test_progress_ends_at_all():
    seen = []
    small(progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (8, 8)


def test_the_file_is_one_that_fly_takes_and_the_rest_of_it_stays(tuned):
    text = tune_report.yaml_text(TEXT, tuned, seed=1)
    back = parse(text)
    assert back.law.name == tuned.best.law
    assert back.law.options == tuned.best.law_options
    assert back.estimator.options == tuned.best.estimator_options
    assert back.orbit == CONFIG.orbit
    assert "# my plane" in text and "speed_m_s: 5}   # m" in text
    assert "circumnav tune" in text and "rms" in text
    assert tune.gains_of(back, AIRCRAFT) == tuned.best


@pytest.mark.parametrize(
    "text",
    [
        "",
        "law: {name: hashemi2013}\n",
        "law:\n  name: hashemi2013\n\n  kappa: 2\n# after\norbit: {radius_m: 30}\n",
        "orbit: {radius_m: 30}\nlaw: {name: hashemi2013,\n  kappa: 2}\nloop: {rate_hz: 20}",
        "law:  # a comment\n  # another\n  name: hashemi2013",
    ],
)
def test_a_section_is_replaced_wherever_it_stands(text):
    block = tune_report.section("law", "hashemi2013", {"kappa": 4.5})
    new = tune_report.replaced(text, "law", block)
    config = parse(new)
    assert config.law.options == {"kappa": 4.5}
    assert config.orbit == parse(text).orbit
    assert config.loop == parse(text).loop
    assert ("# after" in new) is ("# after" in text)


def test_the_front_holds_what_nothing_beats():
    def one(error, effort, lost=0.0):
        return Gains("hashemi2013", "direct"), Score(error, error, effort, 1.0, lost)

    flown = [one(3.0, 1.0), one(2.0, 1.5), one(2.5, 1.6), one(1.0, 3.0), one(0.5, 0.4, lost=0.5), one(1.0, 4.0)]
    assert tune.pareto(flown) == [flown[0], flown[1], flown[3]]


def test_a_score_punishes_effort_beyond_the_present_and_lost_runs():
    good = Score(1.0, 2.0, 1.0, 50.0, 0.0)
    assert good._replace(effort=1.2).value(1.0) > good._replace(effort=1.2).value(1.3) > good.value(1.3)
    assert good._replace(effort=0.0).value(1.0) == good.value(1.0)
    assert good._replace(lost=0.1).value(1.0) > good.value(1.0) + 0.9
    assert math.isclose(good.value(1.0), 0.7 * math.log(2.0) + 0.5 * math.log(51.0))


def test_the_plot_is_drawn(tuned, tmp_path):
    tune_report.draw(tuned, tmp_path / "pareto.png")
    assert (tmp_path / "pareto.png").read_bytes().startswith(b"\x89PNG")


def test_the_words_say_what_was_gained(tuned):
    *_, last = tune_report.lines(tuned)
    assert "times smaller" in last
    *_, last = tune_report.lines(replace(tuned, best=tuned.present))
    assert "best that were found" in last
