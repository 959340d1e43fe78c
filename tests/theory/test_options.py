"""Options of laws and estimators: what cannot fly is refused, what is odd is told, and `tune` stays within both."""

from __future__ import annotations

from math import inf, isnan

import pytest

from circumnav_mav.check import findings
from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.guidance import sampling
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import EstimatorContext, LawContext, Memory, Moved, Reading
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.study.tune_spaces import SPACES

PLUGS = {**LAWS, **ESTIMATORS}
CONTEXTS = {
    **dict.fromkeys(LAWS, LawContext(80.0, 15.0, 0.5, 0.5)),
    **dict.fromkeys(ESTIMATORS, EstimatorContext(80.0, 15.0, 0.5)),
}
BOUNDS = [(name, key) for name, plug in PLUGS.items() for key in plug.bounds]


def build(name, **options):
    plug = PLUGS[name]
    return plug.parameters({**plug.options, **options}, CONTEXTS[name])


@pytest.mark.parametrize(("name", "key"), BOUNDS)
def test_a_value_outside_its_bound_is_refused_with_its_reason_and_one_inside_is_not(name, key):
    bound = PLUGS[name].bounds[key]
    for good in (bound.least, bound.most):
        if 0.0 < good < inf:
            build(name, **{key: good})
    for bad, words in ((bound.least * 0.99, bound.small), (bound.most * 1.01, bound.large)):
        if bad < inf:
            with pytest.raises(ValueError, match=f"^{key} must be ") as caught:
                build(name, **{key: bad})
            assert bad == 0.0 or str(caught.value).endswith(words)
            assert len(str(caught.value)) < 200 and (bad == 0.0 or words)


@pytest.mark.parametrize(("name", "key"), BOUNDS)
def test_what_stands_in_for_a_missing_option_is_sensible_and_odd_is_less_than_refused(name, key):
    bound, default = PLUGS[name].bounds[key], PLUGS[name].options[key]
    assert bound.least <= bound.low <= bound.high <= bound.most
    assert isnan(default) or (not bound.fault(default) and not bound.odd(default))
    assert bool(bound.small) >= (bound.low > 0.0) and bool(bound.large) >= (bound.high < inf)


def test_tune_searches_nothing_that_is_refused():
    searched = 0
    for name, space in SPACES.items():
        for key, ends in space.items():
            for value in ends:
                searched += 1
                build(name, **{key: value})
                if key in PLUGS[name].bounds:
                    assert not PLUGS[name].bounds[key].fault(value)
    assert searched > 20


PLANE = "vehicle: {class: px4_fixed_wing}\norbit: {radius_m: 80, speed_m_s: 15}\n"
DIRECT, DRIFT = "estimator: {name: direct, ", PLANE + "estimator: {name: drift, "


@pytest.mark.parametrize(
    ("text", "severity", "words"),
    [
        (DIRECT + "gate_sigmas: 1.5}", "warning", "estimator.gate_sigmas = 1.5 refuses good ranges: 5 % of them"),
        (DIRECT + "gate_sigmas: 20}", "warning", "estimator.gate_sigmas = 20 hardly refuses an echo"),
        (DIRECT + "accel_m_s2: 5}", "warning", "above 4.39 the estimate is not fit to fly on"),
        (DIRECT + "accel_m_s2: 7}", "error", "above 4.39 the estimate is not fit to fly on"),
        (DRIFT + "alarm_nis: 16}", "warning", "estimator.alarm_nis = 16 is never reached"),
        (DRIFT + "gate_sigmas: 3, alarm_nis: 9.5}", "warning", "with at most gate_sigmas squared, 9;"),
        (DRIFT + "gust_share: 0.2}", "warning", "forgets the drift sooner than ranges show it (0.003 unless given)"),
        (PLANE + "law: {name: tangent, reach_s: 40}", "warning", "a lap takes 33.5 s: the circle is reached late"),
        (PLANE + "law: {name: tangent, reach_s: 110}", "error", "flights end beside the circle"),
        (PLANE + "law: {name: tangent, gain_per_s: 0.01}", "warning", "takes 100 s to turn a heading error away"),
        (PLANE + "law: {name: tangent, gain_per_s: 0.005}", "error", "flights are lost; give more"),
        ("law: {name: sliding_mode, closing_share: 0.1}", "warning", "closes in so slowly that any wind stops it"),
    ],
)
def test_check_tells_what_is_odd(text, severity, words):
    (told,) = (finding for finding in findings(parse(text)) if finding.topic == "option")
    assert told.severity == severity and words in told.text


@pytest.mark.parametrize("text", ["", PLANE, DRIFT + "gate_sigmas: 4.5}", DIRECT + "gate_sigmas: 3, accel_m_s2: 1}"])
def test_nothing_is_said_of_what_is_sensible(text):
    assert not [finding for finding in findings(parse(text)) if finding.topic == "option"]


def test_a_rate_that_is_measured_needs_no_filter_to_know_it():
    text = "ranging: {source: omnipresense, endpoint: /dev/ttyUSB0}\n" + DIRECT + "accel_m_s2: 100}"
    assert not [finding for finding in findings(parse(text)) if finding.topic == "option"]


def test_every_odd_option_of_a_file_is_a_fault_at_once():
    with pytest.raises(ConfigError) as caught:
        parse(DRIFT + "gate_sigmas: 0.001,\n  alarm_nis: 0.5, gust_share: 3,\n  scale_sigma: 5}", "c.yaml")
    places = [line.split(": ")[:2] for line in caught.value.lines()]
    assert sorted(places) == [
        ["c.yaml:3", "estimator.gate_sigmas"],
        ["c.yaml:4", "estimator.alarm_nis"],
        ["c.yaml:4", "estimator.gust_share"],
        ["c.yaml:5", "estimator.scale_sigma"],
    ]


@pytest.mark.parametrize("sigma_m", [0.3, 1.0])
@pytest.mark.parametrize("period_s", [0.1, 1.0])
def test_above_the_greatest_acceleration_the_rate_is_never_known(sigma_m, period_s):
    """The filter itself, on a target that it flies straight towards, for 300 readings."""
    plug, V = ESTIMATORS["direct"], 15.0
    most = sampling.most_accel_m_s2(V, sigma_m, period_s)
    known = []
    for share in (0.7, 1.5):
        par = plug.parameters({"accel_m_s2": share * most, "sigma_m": sigma_m}, EstimatorContext(80.0, V, 0.5))
        bank, mem, r = plug.begin(par), Memory(), 10_000.0
        for _ in range(300):
            r -= V * period_s
            mem = plug.observe(bank, mem, Moved(period_s, V * period_s, 0.0, 0.0, V, 0.0, 0.0), Reading(r), par)
        known.append(mem.known)
    assert known == [1.0, 0.0]
