"""`circumnav tune`: what it finds is better on noise it has not seen, is the same for a seed, and flies as a file."""

import itertools
import json
import math
from dataclasses import replace

import pytest

from circumnav_mav.config_file import parse
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import tune, tune_report
from circumnav_mav.study.aircraft import Aircraft, Gains, fresh_gains, gains_of
from circumnav_mav.study.from_log import Seen
from circumnav_mav.study.tune import Score
from circumnav_mav.study.tune_spaces import MEANINGS, NOTHING_TO_TUNE, SPACES

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
    pytest.importorskip("optuna", reason="needs the extra circumnav-mav[study]")
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
    said = Aircraft.of(parse(TEXT + "study: {wind_m_s: 0.5, range_rate_hz: 4, turn_lag_s: 0.7}"))
    assert (said.wind_m_s, said.range_rate_hz, said.lag_s, said.told_lag_s) == (0.5, 4.0, 0.7, AIRCRAFT.lag_s)
    assert Aircraft.of(CONFIG, wind_m_s=0.0).wind_m_s == 0.0
    assert Aircraft.of(CONFIG, wind_m_s=4.0).wind_m_s == 4.0
    for much in (4.01, 4.99, 5.0, math.nan):
        with pytest.raises(ValueError, match=r"0 to 4 m/s, 0\.8 of the speed of 5 m/s.*hardly come back"):
            Aircraft.of(CONFIG, wind_m_s=much, range_rate_hz=5.0)
        with pytest.raises(ValueError, match="hardly come back"):
            AIRCRAFT.as_seen(Seen(None, None, None, much, ()))
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
    assert [done for done, _ in seen] == [*range(1, 10), 15, 17]
    assert {total for _, total in seen} == {17}


@pytest.mark.parametrize("name", [*LAWS, *ESTIMATORS])
def test_every_law_and_estimator_has_a_space_or_a_reason(name):
    assert (name in SPACES) != (name in NOTHING_TO_TUNE)
    if name in SPACES:
        known = LAWS[name].options if name in LAWS else ESTIMATORS[name].options
        for option, (least, greatest) in SPACES[name].items():
            assert option in known and option in MEANINGS
            assert 0.0 < least < greatest
            assert math.isnan(known[option]) or least <= known[option] <= greatest, "the default is not searched"


@pytest.mark.parametrize("name", SPACES)
def test_every_corner_of_a_space_can_be_flown(name):
    for corner in itertools.product(*SPACES[name].values()):
        options = dict(zip(SPACES[name], corner, strict=True))
        if name in LAWS:
            context = LawContext(80.0, 15.0, 0.46, 0.5)
            LAWS[name].parameters({**LAWS[name].options, **options}, context)
        else:
            ESTIMATORS[name].parameters({**ESTIMATORS[name].options, **options}, EstimatorContext(80.0, 15.0, 0.46))


def test_a_law_that_takes_the_lag_out_is_told_the_lag_of_this_aircraft():
    slow = replace(AIRCRAFT, lag_s=0.8123)
    assert fresh_gains("tangent", "drift", slow).law_options == {"lag_s": 0.812}
    assert fresh_gains("tangent", "drift", AIRCRAFT).law_options == {}
    assert fresh_gains("hashemi2013", "direct", slow).law_options == {}
    _, told = fresh_gains("tangent", "drift", slow).parameters(slow.scenarios()[0])
    assert told.lag == 0.812  # and so in flight, where the law is told that of the class unless the file says


def test_the_file_is_one_that_fly_takes_and_the_rest_of_it_stays(tuned):
    text = tune_report.yaml_text(TEXT, tuned, seed=1)
    back = parse(text)
    assert back.law.name == tuned.best.law
    assert back.law.options == tuned.best.law_options
    assert back.estimator.options == tuned.best.estimator_options
    assert back.orbit == CONFIG.orbit
    assert "# my plane" in text and "speed_m_s: 5}   # m" in text
    assert "circumnav tune" in text and "rms" in text
    assert gains_of(back, AIRCRAFT) == tuned.best


@pytest.mark.parametrize(
    "text",
    [
        "",
        "law: {name: hashemi2013}\n",
        "law:\n  name: hashemi2013\n\n  kappa: 2\n# after\norbit: {radius_m: 30}\n",
        "orbit: {radius_m: 30}\nlaw: {name: hashemi2013,\n  kappa: 2}\nloop: {rate_hz: 20}",
        "law:  # a comment\n  # another\n  name: hashemi2013",
        "law:\n  name: hashemi2013\n# at column 0\n  kappa: 2\n\n# after\norbit: {radius_m: 30}\n",
        '"law": {"name": "hashemi2013", "kappa": 2}\norbit: {radius_m: 30}\n',
        "'law':\n  name: hashemi2013\n  # after\norbit: {radius_m: 30}\n",
        "law : {name: hashemi2013}\norbit: {radius_m: 30}\n",
        "{law: {name: hashemi2013, kappa: 2}, orbit: {radius_m: 30}}",
        "{orbit: {radius_m: 30}}",
        '{"orbit": {"radius_m": 30},\n "law": {"name": "hashemi2013"},  # after\n "loop": {"rate_hz": 20}}\n',
        "\ufefflaw: {name: hashemi2013}\norbit: {radius_m: 30}\n",
        "\ufefforbit: {radius_m: 30}\n",
        "law: {name: hashemi2013,\nkappa: 2}\norbit: {radius_m: 30}\n",
        "law: {name: hashemi2013,\n# at column 0\nkappa: 2\n}  # gone\n# after\norbit: {radius_m: 30}\n",
        "---\n  orbit: {radius_m: 30}\n  law:\n    name: hashemi2013\n  loop: {rate_hz: 20}\n...\n",
        "---\norbit: {radius_m: 30}\n# after\n...\n",
        "# only this: law: {name: none}, after\n",
        "orbit: {radius_m: 30}\nlaw:\n  name: hashemi2013\n  kappa:\n    2  # gone\n",
        "orbit:\n  radius_m: 30\nlaw:\n    name: hashemi2013\n    # after",
    ],
)
def test_a_section_is_replaced_wherever_it_stands(text):
    new = tune_report.replaced(text, "law", "hashemi2013", {"kappa": 4.5})
    config = parse("# a heading\n" + new)
    assert config.law.options == {"kappa": 4.5}
    assert config.orbit == parse(text).orbit
    assert config.loop == parse(text).loop
    assert ("after" in new) is ("after" in text)
    assert "gone" not in new


@pytest.mark.parametrize(
    "text",
    [
        "study: &a {wind_m_s: 1}\nlaw: *b\n",
        "law: &a {name: hashemi2013}\nestimator: *a\n",
        "{loop: &a {rate_hz: 20}, law: *a, orbit: {radius_m: 30}}",
    ],
)
def test_a_form_that_cannot_be_edited_safely_is_refused_in_one_line(text):
    with pytest.raises(ValueError, match="write law out plainly") as refused:
        tune_report.replaced(text, "law", "hashemi2013", {"kappa": 4.5})
    assert "\n" not in str(refused.value)


def test_a_file_that_would_not_load_is_not_written():
    too_little = Gains("hashemi2013", "direct", {"kappa": 0.5}, {}, AIRCRAFT)
    with pytest.raises(ValueError, match=r"with its gains:\d+: law.*kappa") as refused:
        tune_report.configured(TEXT, too_little, AIRCRAFT)
    assert "\n" not in str(refused.value)
    assert parse(tune_report.configured("\ufeff" + TEXT, gains_of(CONFIG, AIRCRAFT), AIRCRAFT)).law == CONFIG.law


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        "# no more\n",
        "study: {wind_m_s: 2, range_rate_hz: 10}  # kept\norbit: {radius_m: 20}\n",
        "study:\n  turn_lag_s: null  # kept\nranging:\n  sigma_m: 0.3  # kept\n",
        "{orbit: {radius_m: 20}, law: {name: hashemi2013}}",
    ],
)
@pytest.mark.parametrize(
    ("wind_m_s", "range_rate_hz", "seen"),
    [
        (None, None, Seen(0.87654, 4.9876, 0.71234, 1.98765, ())),
        (1.23456, 7.1, Seen(1e-5, None, None, None, ())),
        (0.0, None, Seen(None, None, None, None, ())),
    ],
)
def test_the_aircraft_read_back_from_the_file_is_the_one_that_was_tuned_for(tuned, text, wind_m_s, range_rate_hz, seen):
    config = parse(text)
    aircraft = Aircraft.of(config, wind_m_s, range_rate_hz).as_seen(seen)
    found = replace(tuned, aircraft=aircraft)
    new = tune_report.yaml_text(text, found, seed=1)
    assert Aircraft.of(parse(new)) == aircraft
    assert new.count("# kept") == text.count("# kept")
    assert parse(new).orbit == config.orbit


def test_the_front_holds_what_nothing_beats_in_all_four():
    def one(calm, worst, effort, settle, lost=0.0):
        return Gains("hashemi2013", "direct"), Score(calm, worst, effort, settle, lost)

    present = one(3.0, 3.0, 1.0, 9.0, lost=0.1)
    kept = [one(2.0, 3.0, 2.0, 9.0), one(3.0, 2.0, 2.1, 9.0), one(3.0, 3.0, 2.2, 5.0), one(1.0, 1.0, 4.0, 9.0)]
    beaten = [one(2.0, 3.0, 2.05, 9.0), one(3.0, 3.0, 2.2, 9.0), one(1.0, 1.0, 4.0, 9.5), one(3.0, 3.0, 1.0, 9.0, 0.11)]
    assert tune.pareto([present, *kept, *beaten]) == [present, *kept]
    assert tune.pareto([present, *kept, *beaten, one(3.0, 3.0, 1.0, 9.0)])[0][1].lost == 0.0


def test_the_search_keeps_what_nothing_beats(tuned):
    """By brute force over every pair of candidates that it flew."""
    front = [score for _, score in tune.pareto(tuned.flown)]
    for _, score in tuned.flown:
        if score.lost <= tuned.flown[0][1].lost:
            wishes = (*score.objectives, score.lost)
            assert any(all(a <= b for a, b in zip((*one.objectives, one.lost), wishes, strict=True)) for one in front)
    assert len(front) >= 1


def test_a_score_punishes_effort_beyond_the_present_and_lost_runs():
    good = Score(1.0, 2.0, 1.0, 50.0, 0.0)
    assert good._replace(effort=1.2).value(1.0) > good._replace(effort=1.2).value(1.3) > good.value(1.3)
    assert good._replace(effort=0.0).value(1.0) == good.value(1.0)
    assert good._replace(lost=0.1).value(1.0) > good.value(1.0) + 0.9
    dearer, worse = good._replace(effort=1.01), good._replace(rms_worst_m=2.0 * 4.0 / 3.0)
    assert math.isclose(dearer.value(1.0), worse.value(1.0), abs_tol=0.01)  # a soft limit, as tune() says
    assert math.isclose(good.value(1.0), 0.7 * math.log(2.0) + 0.5 * math.log(51.0))


def test_a_search_finds_the_trade_between_two_known_wishes():
    """x^2 against (x - 2)^2 over [0.1, 10]: the set that nothing beats is 0.1 <= x <= 2, and a limit is kept."""
    pytest.importorskip("optuna", reason="needs the extra circumnav-mav[study]")
    from circumnav_mav.study.nsga import search

    seen: list[float] = []

    def judge(point):
        seen.append(point["x"])
        return (point["x"] ** 2, (point["x"] - 2.0) ** 2), {"limit": point["x"] - 1.0}

    search(judge, {"x": (0.1, 10.0)}, wishes=2, evaluations=160, seed=3)
    assert len(seen) == 160 and 0.1 <= min(seen) < 0.15 and max(seen[:16]) > 5.0
    assert sum(x <= 1.0 for x in seen[80:]) > 64  # a search that chances upon them finds 40


def test_the_figures_are_written_as_json(tuned):
    told = json.loads(tune_report.to_json(tuned, seed=1))
    assert told["aircraft"]["wind_m_s"] == 1.0
    assert told["after"]["rms_worst_m"] == tuned.after.rms_worst_m
    assert [one["effort"] for one in told["pareto"]] == [score.effort for _, score in tune.pareto(tuned.flown)]
    assert told["after"]["law"] == {"name": tuned.best.law, **tuned.best.law_options}
    table = tune_report.table(tuned)
    assert len(table) == 1 + min(12, len(told["pareto"])) and len(set(map(len, table))) == 1


def test_the_plot_is_drawn(tuned, tmp_path):
    tune_report.draw(tuned, tmp_path / "pareto.png")
    assert (tmp_path / "pareto.png").read_bytes().startswith(b"\x89PNG")


def test_the_words_say_what_was_gained(tuned):
    def last(worst, calm):
        after = before._replace(rms_worst_m=worst, rms_calm_m=calm, settle_s=20.0)
        return list(tune_report.lines(replace(tuned, before=before, after=after)))[-1]

    before = Score(1.0, 2.0, 1.5, 50.0, 0.0)
    assert last(1.0, 2.0) == "the worst error is 2 times smaller, that in calm 2 times larger, at +0.0% of effort"
    assert "the worst error is 1.13 times larger, that in calm 1.25 times smaller" in last(2.0 / 0.887, 0.8)
    assert "the worst error is as it was, that in calm as it was" in last(2.0, 1.0001)
    *_, said = tune_report.lines(replace(tuned, best=tuned.present, after=tuned.before))
    assert "best that were found" in said


@pytest.mark.parametrize("change", [{"rms_worst_m": 2.0 / 0.887}, {"lost": 0.2}, {"effort": 2.0}, {}])
def test_what_loses_on_the_fresh_runs_is_not_written_and_no_gain(tuned, change):
    before = Score(1.0, 2.0, 1.5, 50.0, 0.0)
    lost = replace(tuned, before=before, after=before._replace(**change))
    assert not lost.won and tuned.won
    *_, said = tune_report.lines(lost)
    assert "loses to the present gains" in said and "smaller" not in said
    text = tune_report.yaml_text(TEXT, lost, seed=1)
    assert gains_of(parse(text), AIRCRAFT) == tuned.present != tuned.best
    assert text.startswith("# Gains not bettered by `circumnav tune`") and TEXT in text
    assert json.loads(tune_report.to_json(lost, seed=1))["written"] == "before"
