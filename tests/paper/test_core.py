"""The study's core against closed forms, the plain core, and a program in C."""

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from circumnav_mav.guidance.kernel import Estimate
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study import paper_core as core
from circumnav_mav.study import paper_run as run
from circumnav_mav.study.kernels import compiled
from circumnav_mav.study.noise import normals
from circumnav_mav.study.scenarios import SCENARIOS
from circumnav_mav.study.simulate import Pilot, simulate
from tests.paper import bench_core

WINDY = run.Plant(wind_x_m_s=0.2, wind_y_m_s=-0.1)


def paper_case(k, plant=None, stream=0):
    return run.case("hashemi2013", {"k": k}, plant or run.Plant(), stream)


def states(count, seed=5):
    rng = np.random.default_rng(seed)
    return zip(
        *rng.uniform(-40, 40, (2, count)).tolist(),
        rng.uniform(-9, 9, count).tolist(),
        rng.normal(0, 0.7, count).tolist(),
        rng.uniform(0.1, 3.0, count).tolist(),
        strict=True,
    )


def test_one_step_of_the_compiled_core_is_that_of_the_plain_one():
    compiled_law = compiled(LAWS["hashemi2013"].turn_rate, side_by_side=True)
    advance = compiled(core.advance, side_by_side=True)
    for x, y, psi, nu, k in states(5000):
        one = paper_case(k, WINDY)
        (x1, y1, psi1), r, r_dot, u = core.plain_step(
            LAWS["hashemi2013"].turn_rate, one.parameters, (x, y, psi), nu, 0.0, one.plant.kernel
        )
        assert compiled_law(Estimate(r, r_dot + nu, 1.0), one.parameters) == pytest.approx(u, abs=1e-12, rel=0)
        after = advance(x, y, math.cos(psi), math.sin(psi), u, 1.0, 0.5, 0.2, -0.1)
        assert after == pytest.approx((x1, y1, math.cos(psi1), math.sin(psi1)), abs=1e-12, rel=0)


def test_own_sine_and_cosine_are_those_of_the_library():
    sin_cos = compiled(core.sin_cos, side_by_side=True)
    for angle in np.concatenate([np.linspace(-8, 8, 4001), np.linspace(-900, 900, 997), [0.0, 1e-300]]).tolist():
        assert sin_cos(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=1e-15 + 1e-16 * abs(angle))


def test_a_full_turn_comes_back_and_no_turn_goes_straight():
    assert core.advance(3.0, 4.0, 0.6, 0.8, math.tau / 2.5, 7.0, 2.5, 0.0, 0.0) == pytest.approx(
        (3.0, 4.0, 0.6, 0.8), abs=1e-14
    )
    assert core.advance(3.0, 4.0, 0.6, 0.8, 0.0, 5.0, 2.0, 0.5, 0.0) == pytest.approx((10.0, 12.0, 0.6, 0.8))


def test_a_vehicle_started_on_its_orbit_stays_on_it_without_noise():
    """At (r_a, theta = pi/2) u is -V / r_a: an exact arc of the circle itself, to rounding, however coarse the hold."""
    plant = run.Plant(sigma_m_s=0.0, hold_s=3.0, x_m=10.0, y_m=0.0, heading_rad=-math.pi / 2)
    rows = run.fly(paper_case(0.3, plant), seed=1, first=0, count=1)
    assert rows["mse_all"][0] < 1e-20
    assert rows["u2_all"][0] == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize("delay_s", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("k", [0.1, 0.9])
def test_whole_runs_without_noise_are_those_of_the_plain_core(k, delay_s):
    plant = replace(WINDY, sigma_m_s=0.0, delay_s=delay_s, tail=0.3, x_m=-17.0, y_m=4.0, heading_rad=0.4)
    one = paper_case(k, plant)
    law, state, asked, flown = LAWS["hashemi2013"].turn_rate, (-17.0, 4.0, 0.4), [], 0.0
    errors, rates, turns = [], [], []
    for n in range(plant.steps):
        _, r, r_dot, u = core.plain_step(law, one.parameters, state, 0.0, flown, plant.kernel)
        asked.append(u)
        late = n - round(delay_s / plant.hold_s)
        flown = asked[late] if late >= 0 else 0.0
        state, _, _, _ = core.plain_step(lambda _est, _par, u=flown: u, None, state, 0.0, 0.0, plant.kernel)
        errors.append(r - 10.0)
        rates.append(r_dot)
        turns.append(u)
    [row] = run.fly(one, seed=1, first=0, count=1)
    for when, from_ in (("all", 0), ("tail", 700 - 210)):
        assert row[f"bias_{when}"] == pytest.approx(np.mean(errors[from_:]), rel=1e-7)
        assert row[f"mse_{when}"] == pytest.approx(np.mean(np.square(errors[from_:])), rel=1e-7)
        assert row[f"rdot2_{when}"] == pytest.approx(np.mean(np.square(rates[from_:])), rel=1e-7)
        assert row[f"u2_{when}"] == pytest.approx(np.mean(np.square(turns[from_:])), rel=1e-7)


def test_statistics_of_noisy_runs_agree_with_the_plain_core_within_four_standard_errors():
    """The plain core flies other noise, so that only the statistics can agree."""
    one = paper_case(1.0, WINDY)
    fast = run.fly(one, seed=11, first=0, count=512)
    plain = np.empty(40, run.RESULT)
    for index in range(len(plain)):
        trace = run.trace(one, seed=12, run=index)
        for when, rows in (("all", trace), ("tail", trace[350:])):
            plain[f"mse_{when}"][index] = np.mean((rows["r_m"] - 10.0) ** 2)
            plain[f"bias_{when}"][index] = np.mean(rows["r_m"] - 10.0)
            plain[f"rdot2_{when}"][index] = np.mean(rows["r_dot_m_s"] ** 2)
            plain[f"u2_{when}"][index] = np.mean(rows["u_rad_s"] ** 2)
    for name in run.RESULT.names:
        error = math.hypot(*(np.std(some[name], ddof=1) / math.sqrt(len(some)) for some in (fast, plain)))
        assert abs(np.mean(fast[name]) - np.mean(plain[name])) < 4.0 * error, name


def test_a_program_in_c_flies_the_same_trajectories(tmp_path):
    program = bench_core.build_c(tmp_path)
    if program is None:
        pytest.skip("no C compiler (gcc or cc) on this machine")
    noise, file = 0.5 * normals(3, 0, 0, 37, 400), tmp_path / "noise.bin"
    noise.tofile(file)
    for k in (0.25, 1.0, 2.95):
        _, *means = bench_core.read_c(bench_core.start_c(program, file, 37, 400, k, 0.0))
        start = np.repeat(np.array([[-20.0], [0.0], [1.0], [0.0]]), 37, axis=1)
        rows = run.fly_in(paper_case(k), start, noise)
        ours = [rows[f"{what}_all"].mean() for what in ("bias", "mse", "rdot2", "u2")]
        assert ours == pytest.approx(means, rel=1e-9)


def test_results_do_not_depend_on_workers_tasks_or_company():
    cases = [paper_case(1.0), paper_case(0.4, WINDY, stream=1)]
    one, two = run.sweep(cases, 150, 7, workers=1), run.sweep(cases, 150, 7, workers=2)
    assert np.array_equal(one, two)
    assert np.array_equal(run.sweep(cases, 20, 7), one[:, :20])
    assert np.array_equal(run.fly(cases[1], 7, first=140, count=3), one[1, 140:143])
    assert not np.array_equal(one, run.sweep(cases, 150, 8))
    assert len(np.unique(one["mse_all"])) == one.size


def test_tasks_fly_the_same_in_other_processes():
    cases = [paper_case(1.0)]
    with ProcessPoolExecutor(1) as pool:
        assert np.array_equal(run.sweep(cases, 5, 7, executor=pool), run.sweep(cases, 5, 7))


def test_noise_is_normal_and_rows_are_strangers():
    draws = normals(2, 3, 0, 400, 500)
    n = draws.size
    assert abs(draws.mean()) < 4 / math.sqrt(n)
    assert abs(draws.var() - 1) < 4 * math.sqrt(2 / n)
    assert abs((draws**4).mean() - 3) < 4 * math.sqrt(96 / n)
    assert np.abs(np.corrcoef(draws[:40]) - np.eye(40)).max() < 5 / math.sqrt(500)
    assert abs((draws[:, 1:] * draws[:, :-1]).mean()) < 4 / math.sqrt(n)
    for other in (normals(2, 4, 0, 400, 500), normals(3, 3, 0, 400, 500), normals(2, 3, 0, 400, 500, channel=1)):
        assert abs(np.corrcoef(draws.ravel(), other.ravel())[0, 1]) < 4 / math.sqrt(n)


@pytest.mark.parametrize(("first", "count"), [(0, 1), (10, 2), (15, 2), (16, 16), (31, 40), (399, 1)])
def test_the_noise_of_a_run_hangs_on_the_run_alone(first, count):
    assert np.array_equal(normals(2, 3, first, count, 50), normals(2, 3, 0, 400, 50)[first : first + count])


def test_saved_results_load_again_bit_for_bit(tmp_path):
    rows = run.sweep([paper_case(1.0)], 4, 1)
    run.save(tmp_path / "rows.npz", rows, {"seed": 1, "k": [1.0]})
    back, about = run.load(tmp_path / "rows.npz")
    assert np.array_equal(back, rows)
    assert back.dtype == run.RESULT
    assert about == {"seed": 1, "k": [1.0]}


@pytest.mark.parametrize(
    ("options", "plant", "word"),
    [
        ({"k": 0.05}, run.Plant(), "kappa"),
        ({}, run.Plant(x_m=0.0, y_m=0.0), "start"),
        ({}, run.Plant(duration_s=0.1), "last"),
        ({}, run.Plant(tail=0.0), "tail"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_words(options, plant, word):
    with pytest.raises(ValueError, match=word):
        run.case("hashemi2013", options, plant)


def test_progress_ends_at_all():
    seen = []
    run.sweep([paper_case(1.0)], 2 * run.CHUNK + 1, 1, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_a_law_on_an_estimator_flies_as_the_other_runner_flies_it():
    """Scenario P of `compare` and a case with an estimator are one situation, in other noise: four standard errors."""
    one = run.case("hashemi2013", {"kappa": 10.0}, run.Plant(), estimator="direct")
    ours = run.fly(one, seed=3, first=0, count=80)
    theirs = simulate(SCENARIOS["P_calm"], Pilot("hashemi2013", "direct", {"kappa": 10.0}), 80, 3)
    for mine, other in (("mse_tail", "tail_ms"), ("bias_tail", "tail_bias"), ("u2_tail", "tail_u2")):
        error = math.hypot(ours[mine].std(ddof=1), theirs[other].std(ddof=1)) / math.sqrt(80)
        assert abs(ours[mine].mean() - theirs[other].mean()) < 4.0 * error, mine
    assert np.array_equal(ours, run.sweep([one], 80, 3, workers=2)[0])
    assert np.array_equal(ours[5:8], run.fly(one, seed=3, first=5, count=3))


def test_the_trace_of_a_run_on_an_estimator_is_that_of_the_plant():
    """Each arc is that of the turn rate written down, and the range rate that of the ranges, by geometry."""
    plant = replace(WINDY, x_m=-12.0, y_m=5.0)
    one = run.case("hashemi2013", {"kappa": 4.0}, plant, estimator="raw")
    rows = run.trace(one, seed=2)
    psi, u = rows["psi_rad"], rows["u_rad_s"]
    assert np.diff(psi) == pytest.approx(0.5 * u[:-1], abs=1e-12)
    chord = 2.0 * np.sin(0.25 * u[:-1]) / u[:-1]
    step = np.diff(rows["x_m"]), np.diff(rows["y_m"])
    assert step[0] == pytest.approx(chord * np.cos(psi[:-1] + 0.25 * u[:-1]) + 0.1, abs=1e-9)
    assert step[1] == pytest.approx(chord * np.sin(psi[:-1] + 0.25 * u[:-1]) - 0.05, abs=1e-9)
    vx, vy = np.cos(psi) + 0.2, np.sin(psi) - 0.1
    assert rows["r_m"] == pytest.approx(np.hypot(rows["x_m"], rows["y_m"]))
    assert rows["r_dot_m_s"] * rows["r_m"] == pytest.approx(rows["x_m"] * vx + rows["y_m"] * vy)
    assert abs(rows["r_m"][350:].mean() - 10.0) < 1.0


def test_a_law_that_an_estimator_does_not_serve_is_refused_in_words():
    with pytest.raises(ValueError, match="which estimator polar does not tell"):
        run.case("tangent", {}, run.Plant(), estimator="polar")
    with pytest.raises(ValueError, match="which the paper's plant does not tell"):
        run.case("tangent", {}, run.Plant())


def test_a_trace_with_a_delay_and_no_estimator_is_refused():
    one = run.case("hashemi2013", {"k": 1.0}, run.Plant(delay_s=0.5))
    with pytest.raises(ValueError, match=r"no delay, and 0\.5 s"):
        run.trace(one, 1)
