"""`circumnav study`: what it writes, what it draws, and that its numbers are those of its runs."""

import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from circumnav_mav.study import paper, paper_figures, paper_run
from circumnav_mav.study.paper_figures import PICTURES

SMALL = paper.Options(runs=24, seed=3, gains_rad_m=(0.1, 0.4, 1.0))


@pytest.fixture(scope="module")
def result():
    return paper.run(SMALL)


def test_the_json_has_the_lists_that_were_asked_for(result, tmp_path):
    paper.write_json(result, tmp_path / "study.json")
    told = json.loads((tmp_path / "study.json").read_text())
    for air in ("calm", "wind"):
        assert told[air]["k"] == [0.1, 0.4, 1.0]
        for name in ("mse_all", "mse_tail", "rdot2_all", "rdot2_tail", "u2_tail", "bias_tail"):
            assert len(told[air][name]) == 3
            assert all(math.isfinite(value) for value in told[air][name])
    assert told["options"]["runs"] == 24


def test_defaults_are_the_papers():
    options = paper.Options()
    assert len(options.gains_rad_m) == 20
    assert (options.gains_rad_m[0], options.gains_rad_m[-1]) == (0.1, 2.95)
    assert (options.runs, options.start_m, options.heading_rad, options.window) == (500, (-20.0, 0.0), 0.0, 0.5)
    calm, wind = options.plant("calm"), options.plant("wind")
    assert (calm.V_m_s, calm.r_a_m, calm.sigma_m_s, calm.hold_s, calm.duration_s) == (1.0, 10.0, 0.5, 0.5, 350.0)
    assert (wind.wind_x_m_s, wind.wind_y_m_s) == pytest.approx((0.25 / math.sqrt(2), 0.25 / math.sqrt(2)))


def test_means_and_intervals_are_those_of_single_runs_flown_by_the_plain_core(result):
    one = SMALL.cases()[4]  # wind, k = 0.4
    tails = []
    for run in range(SMALL.runs):
        r = paper_run.trace(one, SMALL.seed, run)["r_m"][350:]
        tails.append(np.mean((r - 10.0) ** 2))
    assert result.mean("wind", "mse_tail")[1] == pytest.approx(np.mean(tails), rel=1e-6)
    assert result.ci95("wind", "mse_tail")[1] == pytest.approx(
        2.06866 * np.std(tails, ddof=1) / math.sqrt(24),
        rel=1e-5,  # Student's t, 23 degrees of freedom
    )


def test_intervals_hold_the_mean_of_many_other_runs(result):
    """19 of 20 intervals should; with 3 gains, 2 airs and 6 statistics none may miss by more than 4 standard errors."""
    other = paper.run(replace(SMALL, runs=200, seed=99))
    for air in paper.AIRS:
        for field in paper.FIELDS:
            error = np.hypot(result.ci95(air, field), other.ci95(air, field)) / 1.96
            assert np.all(np.abs(result.mean(air, field) - other.mean(air, field)) < 4.5 * error), (air, field)


def test_intervals_of_two_runs_are_as_wide_as_two_runs_leave_them(result):
    """Student's t with one degree of freedom is 12.7062, where the normal law has 1.96."""
    two = replace(result, rows=result.rows[:, :, :2])
    first, second = two.rows["mse_tail"][0, 0]
    assert two.ci95("calm", "mse_tail")[0] == pytest.approx(12.7062 * abs(first - second) / 2.0, rel=1e-5)


def test_results_save_and_load(result, tmp_path):
    paper.save(result, tmp_path / "study.npz")
    back = paper.load(tmp_path / "study.npz")
    assert back.options == result.options
    assert np.array_equal(back.rows, result.rows)
    assert back.table("wind") == result.table("wind")
    assert len(back.table("calm")) == 4


def test_gains_that_differ_are_told_apart(result):
    close = replace(result, options=replace(SMALL, gains_rad_m=(0.171, 0.175, 1.0)))
    assert [row[0] for row in close.table("calm")[1:]] == ["0.171", "0.175", "1"]


def test_no_json_is_written_of_what_is_no_number(result, tmp_path):
    rows = result.rows.copy()
    rows["mse_all"][0, 0, 0] = math.nan
    with pytest.raises(ValueError, match="not finite"):
        paper.write_json(replace(result, rows=rows), tmp_path / "a.json")
    assert not (tmp_path / "a.json").exists()


def test_every_figure_is_drawn_twice_and_reads_as_a_picture(result, tmp_path):
    files = paper_figures.draw(result, tmp_path / "figures")
    assert len(files) == 24
    for file in files:
        if file.suffix == ".svg":
            assert ET.parse(file).getroot().tag.endswith("svg")
        else:
            assert file.read_bytes().startswith(b"\x89PNG")
            assert file.stat().st_size > 8000


def words_of(figure):
    [axes] = figure.axes
    return axes.get_title(), {text.get_text() for text in axes.get_legend().get_texts()}


def test_figures_of_the_papers_law_are_named_as_its_own(result):
    for picture in PICTURES:
        assert words_of(paper_figures.painted(picture, result))[0].startswith(f"Figure {picture.number}: ")
    assert words_of(paper_figures.painted(PICTURES[3], result))[1] >= {"$r_s$", "$r_{i-}$"}
    assert "2 k V = π" in words_of(paper_figures.painted(PICTURES[6], result))[1]


@pytest.mark.parametrize(("law", "estimator"), [("cao2013_smooth", None), ("hashemi2013", "direct")])
def test_figures_of_another_law_or_estimator_say_so(law, estimator):
    other = paper.run(replace(SMALL, runs=2, law=law, estimator=estimator, gains_rad_m=(0.4, 1.0)))
    told = f"estimator {estimator}" if estimator else "the true range and a noisy range rate"
    of_the_paper = law == "hashemi2013"
    for picture in PICTURES[2:]:
        title, labels = words_of(paper_figures.painted(picture, other))
        assert "Figure" not in title and f"{law} on {told}" in title
        assert of_the_paper or not labels & {"$r_s$", "$r_{i-}$", "2 k V = π"}
        assert of_the_paper or "r_{i-}" not in title
    outer = words_of(paper_figures.painted(PICTURES[0], other))[0]
    assert ("hashemi2013_outer on estimator direct" in outer) if estimator else outer.startswith("Figure 1: ")


def test_a_picture_of_a_gain_that_the_law_does_not_take_says_so():
    other = paper.run(replace(SMALL, runs=2, law="pd_bias", gains_rad_m=(0.4, 1.0)))
    [axes] = paper_figures.painted(PICTURES[4], other).axes
    assert "kappa must be above 1" in axes.texts[0].get_text()


def test_ticks_follow_figures_far_below_the_papers(result):
    low = result.rows.copy()
    for name in ("mse_all", "mse_tail"):
        low[name] *= 1e-3
    [axes] = paper_figures.painted(PICTURES[6], replace(result, rows=low)).axes
    bottom, top = axes.get_ylim()
    assert sum(bottom <= tick <= top for tick in axes.get_yticks()) >= 3


def test_figures_are_numbered_as_in_the_paper():
    assert [picture.number for picture in PICTURES] == list(range(1, 13))


@pytest.mark.parametrize(
    "options", [replace(SMALL, runs=1), replace(SMALL, window=0.0), replace(SMALL, start_m=(0, 0))]
)
def test_nonsense_is_refused_in_words(options):
    with pytest.raises(ValueError, match=r"runs|tail|start"):
        paper.run(options)
