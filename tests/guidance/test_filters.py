"""Estimator kernels against linear algebra, geometry and chi-square bounds."""

import math
import random

import numpy as np
import pytest
from scipy.stats import chi2

from circumnav_mav.guidance.estimators import ESTIMATORS, direct, drift, drift_gaussian, polar
from circumnav_mav.guidance.kernel import NAN, EstimatorContext, Memory, Moved, Reading

CONTEXT = EstimatorContext(80.0, 15.0, 0.46)
TRIANGLE = np.triu_indices(5)


def drift_hypothesis(rng):
    """A random mean and covariance, as kernel and as numpy."""
    a = rng.normal(size=(5, 5)) * np.array([8.0, 8.0, 2.0, 2.0, 0.05])[:, None]
    P = a @ a.T
    mean = np.array([rng.uniform(-300, 300), rng.uniform(50, 300), *rng.normal(size=2), 0.03])
    return drift_gaussian.Drift(*mean, *P[TRIANGLE], 1.0, 0.0), mean, P


def matrix(h):
    P = np.zeros((5, 5))
    P[TRIANGLE] = h[5:20]
    return P + P.T - np.diag(np.diag(P)), np.array(h[:5])


def test_drift_predicts_as_the_matrix_equations_do():
    rng = np.random.default_rng(1)
    par = drift.parameters({}, CONTEXT)
    for _ in range(20):
        h, mean, P = drift_hypothesis(rng)
        dx, dy, dt = [*rng.normal(size=2).tolist(), 0.3]
        F = np.eye(5)
        F[0, 2] = F[1, 3] = -dt
        F[0, 4], F[1, 4] = -dx, -dy
        Q = np.diag([par.q_p, par.q_p, par.q_w, par.q_w, par.q_s]) * dt
        leg = drift_gaussian.Leg(dx, dy, dt, par.q_p * dt, par.q_w * dt, par.q_s * dt)
        got, state = matrix(drift_gaussian.predict(h, leg))
        assert got == pytest.approx(F @ P @ F.T + Q, rel=1e-9, abs=1e-9)
        assert state == pytest.approx(F @ mean - np.array([dx, dy, 0, 0, 0]), rel=1e-9)


def polar_turn(P, swing):
    T = np.eye(5)
    T[:2, :2] = [[math.cos(swing), -math.sin(swing)], [math.sin(swing), math.cos(swing)]]
    return T @ P @ T.T


@pytest.mark.parametrize("what", ["range", "rate"])
def test_drift_updates_as_the_matrix_equations_do_in_polar_coordinates(what):
    rng = np.random.default_rng(2)
    for _ in range(20):
        h, mean, P = drift_hypothesis(rng)
        m = Moved(0.1, 1.5, 0.0, 0.0, 15.0, 0.0, 0.7)

        def measure(x, m=m):
            p, w, s = x[:2], x[2:4], x[4]
            v = (1 + s) * m.V * np.array([math.cos(m.psi), math.sin(m.psi)]) + w
            return float(np.hypot(*p)) if what == "range" else float(-(v @ p) / np.hypot(*p))

        H = np.array([(measure(mean + d) - measure(mean - d)) / 2e-5 for d in np.eye(5) * 1e-5])
        S = H @ P @ H + 0.25
        error = 0.5 * math.sqrt(S)
        K = P @ H / S
        step = K * error
        r, bearing = np.hypot(*mean[:2]), math.atan2(mean[1], mean[0])
        along = step[0] * math.cos(bearing) + step[1] * math.sin(bearing)
        swing = (step[1] * math.cos(bearing) - step[0] * math.sin(bearing)) / r
        want = mean + step
        want[:2] = (r + along) * np.array([math.cos(bearing + swing), math.sin(bearing + swing)])
        if what == "range":
            new, nis, missed_by, _ = drift_gaussian.use_range(h, drift_gaussian.STILL, measure(mean) + error, 0.25, 9.0)
            assert (nis, missed_by) == pytest.approx((error**2 / S, error), rel=1e-6)
        else:
            new = drift_gaussian.use_rate(h, measure(mean) + error, m, 0.25, 9.0)
        got, state = matrix(new)
        assert state == pytest.approx(want, rel=1e-6, abs=1e-6)
        assert got == pytest.approx(polar_turn(P - np.outer(K, H @ P), swing), rel=1e-5, abs=1e-5)
        assert new.log_weight == pytest.approx(-0.5 * (error**2 / S + math.log(S)), rel=1e-6)


def test_a_reading_beyond_the_gate_costs_and_does_not_move():
    h, _, _ = drift_hypothesis(np.random.default_rng(3))
    hit, nis, _, _ = drift_gaussian.use_range(h, drift_gaussian.STILL, math.hypot(h.px, h.py) + 1e4, 1.0, 4.0)
    assert nis > 16.0
    assert hit[:-1] == h[:-1]
    assert hit.log_weight < h.log_weight - 7.9


@pytest.mark.parametrize("error", [0.3, 1e4])
def test_a_range_at_the_end_of_a_leg_is_the_leg_and_then_the_range(error):
    h, _, _ = drift_hypothesis(np.random.default_rng(4))
    leg = drift_gaussian.Leg(1.5, -0.7, 0.3, 0.01, 0.002, 1e-6)
    there = drift_gaussian.predict(h, leg)
    z = math.hypot(there.px, there.py) + error
    at_once, nis, missed_by, _ = drift_gaussian.use_range(h, leg, z, 1.0, 4.0)
    then, *judged, _ = drift_gaussian.use_range(there, drift_gaussian.STILL, z, 1.0, 4.0)
    assert at_once == pytest.approx(then, rel=1e-9)
    assert [nis, missed_by] == pytest.approx(judged, rel=1e-9)
    assert missed_by == pytest.approx(error)


@pytest.mark.parametrize("far_m", [0.0, 1e4])
def test_a_refused_range_leaves_the_ring_as_the_leg_does(far_m):
    """Whether beyond the gate of a hypothesis or not: an unlikely one has no say in the refusal."""
    par, leg = drift.parameters({}, CONTEXT), drift_gaussian.Leg(1.5, -0.7, 0.3, 0.01, 0.002, 1e-6)
    long, other = (drift.ring_member(300.0, bearing, 1.0, par, -bearing) for bearing in (0.4, 2.0))
    short = drift_gaussian.cut(other)[0]
    middle, left, right = drift_gaussian.cut(drift_gaussian.predict(long, leg))
    bank = [long, short]
    used, nis, carried, _ = drift.tried(bank, leg, 300.0 + far_m, 1.0, par.gate)
    assert not np.allclose(used, [middle, drift_gaussian.predict(short, leg), left, right])
    drift.carry_only(bank, leg, used, nis, carried, par.gate)
    assert np.array(bank) == pytest.approx(np.array([middle, drift_gaussian.predict(short, leg), left, right]))


def test_what_is_too_long_is_said_and_cut_in_three_that_keep_the_mean_and_the_covariance():
    par = drift.parameters({}, CONTEXT)
    h = drift.ring_member(300.0, 0.4, 1.0, par, 0.0)
    bank = drift_gaussian.cut(h)
    too_long = [drift_gaussian.use_range(one, drift_gaussian.STILL, 300.0, 1.0, 4.0)[3] for one in (h, *bank)]
    assert too_long == [True, False, False, False]
    assert sum(b.xx + b.yy for b in bank) < 3 * 0.55 * (h.xx + h.yy)
    weights = np.exp([b.log_weight for b in bank])
    assert weights.sum() == pytest.approx(1.0, abs=2e-3)
    bearings = np.array([math.atan2(b.py, b.px) for b in bank])
    inside = [polar_turn(matrix(b)[0], -a) for b, a in zip(bank, bearings, strict=True)]
    mean = weights @ bearings
    variance = weights @ [P[1, 1] / 300.0**2 + (a - mean) ** 2 for P, a in zip(inside, bearings, strict=True)]
    assert mean == pytest.approx(0.4, abs=1e-3)
    assert math.sqrt(variance) == pytest.approx(math.pi / drift.RING, rel=0.01)


def test_polar_moves_as_a_point_seen_from_the_vehicle():
    par = polar.parameters({}, CONTEXT)
    rng = random.Random(4)
    for _ in range(30):
        r, theta = rng.uniform(20, 200), rng.uniform(-3, 3)
        ahead, left, turn = rng.uniform(-5, 9), rng.uniform(-5, 5), rng.uniform(-1, 1)
        m = Moved(0.0, ahead, left, turn, 15.0, 0.0, NAN)

        def after(r, theta, ahead=ahead, left=left, turn=turn):
            sight = complex(r * math.cos(theta), -r * math.sin(theta)) - complex(ahead, left)
            sight *= complex(math.cos(turn), -math.sin(turn))
            return np.array([abs(sight), -math.atan2(sight.imag, sight.real)])

        h = polar.predict(polar.Polar(r, theta, 2.0, 0.01, 0.04, 1.0, 0.0), m, par)
        want = after(r, theta)
        assert h.r == pytest.approx(want[0])
        assert math.remainder(h.theta - want[1], 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
        columns = []
        for d in ((1e-6, 0.0), (0.0, 1e-6)):
            change = after(r + d[0], theta + d[1]) - want
            change[1] = math.remainder(change[1], 2 * math.pi)
            columns.append(change / 1e-6)
        J = np.array(columns).T
        P = J @ np.array([[2.0, 0.01], [0.01, 0.04]]) @ J.T
        assert (h.prr, h.prt, h.ptt) == pytest.approx((P[0, 0], P[0, 1], P[1, 1]), rel=1e-4, abs=1e-6)


def test_direct_moves_as_the_polar_form_does():
    r, r_dot, V, u, dt = 90.0, -3.0, 10.0, -0.2, 1e-4
    par = direct.parameters({}, EstimatorContext(r_a=50.0, V=V, turn_rate_limit=0.8, side=1.0))
    for side in (1.0, -1.0):
        theta = side * math.acos(-r_dot / V)
        m = Moved(dt, V * dt, 0.5 * V * u * dt * dt, u * dt, V, u, NAN)
        h = direct.predict(direct.Side(r, r_dot, 1.0, 0.0, 1.0, 1.0, side), m, par)
        theta_dot = V * math.sin(theta) / r + u  # the paper's polar form
        assert (h.r - r) / dt == pytest.approx(r_dot, rel=1e-4)
        assert (h.r_dot - r_dot) / dt == pytest.approx(V * math.sin(theta) * theta_dot, rel=1e-3)


class World:
    """A truth driven by exactly the noise that the drift filter believes in, flown on a circle beside the target."""

    def __init__(self, seed, q_p=0.0, q_w=0.0, q_s=0.0):
        self.rng = np.random.default_rng(seed)
        self.p, self.w, self.s = np.array([90.0, 30.0]), self.rng.normal(size=2) * 2.0, self.rng.normal() * 0.05
        self.psi, self.q = 0.3, (q_p, q_w, q_s)
        self.V, self.u, self.dt = 15.0, -0.19, 0.1

    def step(self):
        """Fly 0.1 s and return how far by own reckoning."""
        half = 0.5 * self.u * self.dt
        chord = self.V * self.dt * math.sin(half) / half
        d = chord * np.array([math.cos(self.psi + half), math.sin(self.psi + half)])
        self.psi += self.u * self.dt
        kick = [self.rng.normal(size=n) * math.sqrt(q * self.dt) for q, n in zip(self.q, (2, 2, 1), strict=True)]
        self.p = self.p - (1 + self.s) * d - self.w * self.dt + kick[0]
        self.w, self.s = self.w + kick[1], self.s + kick[2][0]
        return Moved(self.dt, chord * math.cos(half), chord * math.sin(half), 2 * half, self.V, self.u, self.psi)

    def reading(self):
        return Reading(float(np.hypot(*self.p)) + self.rng.normal(), NAN, 1.0)


def test_drift_knows_how_wrong_it_is():
    """NEES and NIS of 40 runs of 60 s: inside the 99.9 % bounds of chi-square."""
    par = drift.parameters({}, CONTEXT)
    nees, nis = [], []
    for seed in range(40):
        world = World(seed, par.q_p, par.q_w, par.q_s)
        bank, mem = drift.begin(par), Memory()
        moved = Moved(0.0, 0.0, 0.0, 0.0, 15.0, 0.0, world.psi)
        for n in range(600):
            mem = drift.observe(bank, mem, moved, world.reading(), par)
            if n >= 300 and n % 3 == 0 and not math.isnan(mem.nis):
                nis.append(mem.nis)
            moved = world.step()
        calm = max((h for h in bank if h.stir == 1.0), key=lambda h: h.log_weight)
        noise = np.array([par.q_p, par.q_w, par.q_s]) * moved.dt
        P, mean = matrix(drift_gaussian.predict(calm, drift_gaussian.Leg(*displacement(moved), moved.dt, *noise)))
        bearing = math.atan2(mean[1], mean[0])
        swing = math.remainder(math.atan2(world.p[1], world.p[0]) - bearing, 2 * math.pi)
        local = np.array([np.hypot(*world.p) - np.hypot(*mean[:2]), swing * np.hypot(*mean[:2])])
        error = np.concatenate([local, world.w - mean[2:4], [world.s - mean[4]]])
        nees.append(error @ np.linalg.solve(polar_turn(P, -bearing), error))
    assert_chi_square(nees, 5)
    assert_chi_square(nis, 1)


def displacement(m):
    psi = m.psi - m.turn
    c, s = math.cos(psi), math.sin(psi)
    return m.ahead * c - m.left * s, m.ahead * s + m.left * c


def assert_chi_square(values, degrees):
    low, high = chi2.ppf([0.0005, 0.9995], degrees * len(values)) / len(values)
    assert low < np.mean(values) < high


def test_polar_knows_how_wrong_it_is():
    """The same for polar, in a truth that moves and is driven as its model says."""
    par = polar.parameters({}, CONTEXT)
    nees, nis = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        r, theta = 95.0, 1.8
        chord, half = 1.5, -0.0095
        moved = Moved(0.1, chord * math.cos(half), chord * math.sin(half), 2 * half, 15.0, -0.19, NAN)
        bank, mem = polar.begin(par), Memory()
        for n in range(400):
            if n > 0:
                sight = complex(r * math.cos(theta) - moved.ahead, -r * math.sin(theta) - moved.left)
                theta = -math.atan2(sight.imag, sight.real) + moved.turn
                r = abs(sight) + rng.normal() * math.sqrt(par.q_r * 0.1)
                theta += rng.normal() * math.sqrt(par.q_theta * 0.1)
            mem = polar.observe(bank, mem, moved, Reading(r + rng.normal(), NAN, 1.0), par)
            if n >= 200 and not math.isnan(mem.nis):
                nis.append(mem.nis)
        calm = max((h for h in bank if h.stir == 1.0), key=lambda h: h.log_weight)
        error = np.array([calm.r - r, math.remainder(calm.theta - theta, 2 * math.pi)])
        nees.append(error @ np.linalg.solve([[calm.prr, calm.prt], [calm.prt, calm.ptt]], error))
    assert_chi_square(nees, 2)
    assert_chi_square(nis, 1)


def test_direct_knows_how_wrong_it_is():
    """The same for direct: the polar form in complex numbers, its range rate driven by the white noise of the model."""
    par = direct.parameters({}, CONTEXT)
    V, dt = 15.0, 0.1
    moved = Moved(dt, 1.5, 0.0, -0.019, V, -0.19, NAN)
    noise = np.linalg.cholesky(par.q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    nees, nis = [], []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        r, r_dot = 80.0, 0.0
        bank, mem = direct.begin(par), Memory()
        for n in range(90):
            if n > 0:
                sight = r * np.exp(-1j * math.acos(-r_dot / V)) - moved.ahead  # target ahead and to the right
                theta = moved.turn - np.angle(sight)
                r, r_dot = np.array([abs(sight), -V * math.cos(theta)]) + noise @ rng.normal(size=2)
                r_dot = min(max(r_dot, -0.95 * V), 0.95 * V)
            mem = direct.observe(bank, mem, moved, Reading(r + rng.normal(), NAN, 1.0), par)
            if n >= 45 and n % 3 == 0 and not math.isnan(mem.nis):
                nis.append(mem.nis)
        h = bank[direct.best_of(bank)]
        error = np.array([h.r - r, h.r_dot - r_dot])
        nees.append(error @ np.linalg.solve([[h.prr, h.prv], [h.prv, h.pvv]], error))
    assert_chi_square(nees, 2)
    assert_chi_square(nis, 1)


def test_raw_claims_the_variance_of_its_reading_and_has_no_innovation():
    kernels = ESTIMATORS["raw"]
    par, rng = kernels.parameters({}, CONTEXT), np.random.default_rng(1)
    bank, errors = kernels.begin(par), []
    for _ in range(300):
        mem = kernels.observe(
            bank, Memory(), Moved(0.1, 1.5, 0.0, 0.0, 15.0, 0.0, NAN), Reading(80.0 + 2.0 * rng.normal(), NAN, 2.0), par
        )
        assert math.isnan(mem.nis)
        errors.append((bank[0].r - 80.0) ** 2 / kernels.covariance(bank)[0])
    assert_chi_square(errors, 1)


@pytest.mark.parametrize("name", ["direct", "polar", "drift"])
def test_the_sigma_of_range_covers_the_error(name):
    """In a calm world without process noise the claim must be on the safe side, and not by a factor of four."""
    kernels = ESTIMATORS[name]
    par = kernels.parameters({}, CONTEXT)
    ratios = []
    for seed in range(15):
        world = World(seed)
        world.w, world.s = np.zeros(2), 0.0
        bank, mem = kernels.begin(par), Memory()
        moved = Moved(0.0, 0.0, 0.0, 0.0, 15.0, 0.0, world.psi)
        for _ in range(300):
            mem = kernels.observe(bank, mem, moved, world.reading(), par)
            r = np.hypot(*world.p)
            moved = world.step()
        est = kernels.carry(bank, mem, moved._replace(dt=0.0, ahead=0.0, left=0.0, turn=0.0), par)
        ratios.append((est.r - r) ** 2 / kernels.covariance(bank)[0])
    assert 0.05 < np.mean(ratios) < 1.6


def test_a_filter_drawn_below_zero_tells_a_law_of_no_negative_range():
    par = ESTIMATORS["direct"].parameters({}, CONTEXT)
    bank = [direct.Side(-0.3, 1.0, 0.1, 0.0, 0.1, 0.0, side) for side in (1.0, -1.0)]
    assert direct.carry(bank, Memory(known=1.0), Moved(0.0, 0.0, 0.0, 0.0, 15.0, 0.0, NAN), par).r == 0.0
