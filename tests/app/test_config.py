"""The configuration: every fault at once, on its line, in words; the shipped files load."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from circumnav_mav.config import Config, guidance_settings
from circumnav_mav.config_file import ConfigError, load, parse
from circumnav_mav.endpoint import parse as parse_endpoint
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws.hashemi2013 import DEFAULT_KAPPA
from circumnav_mav.mavlink.vehicles import VEHICLES

ROOT = Path(__file__).parents[2]


def faults(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "c.yaml")
    return list(caught.value.lines())


def test_an_empty_file_is_the_defaults():
    assert parse("") == Config()


def test_every_fault_is_reported_at_once_with_its_line():
    lines = faults("orbit:\n  radius_m: -3\n  speed: 5\nlaw: {name: hashimi}\nengage: always\n")
    assert [line.split(": ")[0] for line in lines] == ["c.yaml:2", "c.yaml:3", "c.yaml:4", "c.yaml:5"]
    assert "orbit.radius_m" in lines[0] and "-3" in lines[0]
    assert "did you mean 'speed_m_s'" in lines[1]
    assert "did you mean 'hashemi2013'" in lines[2]
    assert "'pilot' or 'auto'" in lines[3]


LINES = "ranging:\n  source: lines\n  endpoint: /dev/ttyUSB0\n"
TOGETHER = {
    "of a pattern": (
        "  pattern: 'D=[0-9]+'\n  range_unit: furlong\n  rate_unit: 3\n  id_base: 1\n  ignore: '*'\n",
        [f"{n}: ranging.{key}" for n, key in enumerate(("pattern", "range_unit", "rate_unit", "id_base", "ignore"), 4)],
    ),
    "of paths, beside a misspelt key": (
        "  json: {range: data..d, foo: x}\n  range_units: m\n  time_unit: min\n",
        ["4: ranging.json", "4: ranging.json", "5: ranging.range_units", "6: ranging.time_unit"],
    ),
    "beside a wrong number": (
        "  pattern: '('\n  bias_m: abc\n  min_m: 50\n  max_m: 3\n  coast_s: 0.1\n",
        ["4: ranging.pattern", "5: ranging.bias_m", "6: ranging.min_m", "8: ranging.coast_s"],
    ),
    "and none that a misspelt or a wrong key alone explains": (
        "  patern: '(?P<range>.)'\n  max_age_s: x\n  latency_s: 1.5\n  min_m: 50\n  max_m: y\n",
        ["4: ranging.patern", "5: ranging.max_age_s", "8: ranging.max_m"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", TOGETHER)
def test_no_fault_of_the_ranging_section_hides_another(case):
    text, places = TOGETHER[case]
    found = [line.removeprefix("c.yaml:").split(": ") for line in faults(LINES + text)]
    assert [": ".join(parts[:2]) for parts in found] == places


def test_a_wrong_source_or_another_section_hides_no_numbers_that_contradict_each_other():
    found = faults("ranging: {source: nix, foo: 3, min_m: 5, max_m: 1, beacon_id: 70000}\norbit: {radius_m: abc}\n")
    assert [line.split(": ")[1] for line in found] == ["ranging.source", "ranging.min_m", "orbit.radius_m"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("orbit: {radius_m: .nan}", "finite"),
        ("orbit: {radius_m: fifty}", "number"),
        ("orbit: {radius_m: 4, speed_m_s: 5}", "limits.turn_rate_rad_s"),
        ("law: {kappa: 0.9}", "no orbit exists below 1"),
        ("law: {kappa: .inf}", "finite"),
        ("law: {name: tangent}\nestimator: {name: direct}", "which only drift gives"),
        ("law: {kapa: 2}", "did you mean 'kappa'"),
        ("law: {kappa: 3, k: 0.06}", "not both"),
        ("estimator: {sigma_m: 2}", "estimator.sigma_m: set ranging.sigma_m instead"),
        ("ranging: {target_height_m: ground}", "target_height_m: must be a height in m, auto or null, not 'ground'"),
        ("ranging: {target_height_m: .nan}", "target_height_m: must be a height in m, auto or null, not nan"),
        ("ranging: {target_height_m: true}", "target_height_m: must be a height in m, auto or null, not True"),
        ("ranging: {target_height_m: auto}", "target_height_m: auto needs estimator drift, not direct"),
        ("estimator: {gate_sigma: 3}", "did you mean 'gate_sigmas'"),
        ("vehicle: {link: serial}", "udpin://"),
        ("vehicle: {link: 'udpout://:14580'}", "address"),
        ("vehicle: {class: boat}", "px4_multirotor"),
        ("ranging: {max_age_s: 0.01}", "stale"),
        ("vehicle: {system_id: 42}\nranging: {from: [42, 1]}", "autopilot that is flown"),
        ("ranging: {from: [300, 1]}", "255"),
        ("engage: auto", "height_m"),
        ("orbit: {direction: clockwize}", "did you mean 'clockwise'"),
        ("orbit: {radius_m: 50, radius_m: 60}", "given twice"),
        ("orbit: [1, 2", "not YAML"),
        ("- 1", "sections"),
        ("wombat: 1", "no such key"),
        ("loop: {rate_hz: 5000}", "400"),
        ("orbit: &a {b: *a}", "c.yaml:1: orbit.b: an alias that contains itself"),
        ("orbit: &a {<<: *a}", "contains itself"),
        ("ranging: &a {source: lines, json: [*a]}", "contains itself"),
        ("orbit: " + "[" * 5000, "nested too deeply"),
        ("ranging: {latency_s: 1.0, max_age_s: 1.0}", "every range would be stale"),
        ("ranging: {latency_s: 2, max_age_s: 3}", "ranging.latency_s: 2 s: what was flown is remembered for 2 s"),
        ("ranging: {coast_s: 0.9, max_age_s: 1.0}", "is below max_age_s"),
        ("orbit: {radius_m: true}", "must be a number, not true"),
        ("law: {kappa: yes}", "must be a number, not true"),
        ("ranging: {sensor_id: false}", "must be a number, not false"),
        ("ranging: {from: [true, 158]}", "must be a number, not true"),
    ],
)
def test_faults_say_what_and_what_to_do(text, words):
    assert any(words in line for line in faults(text)), faults(text)


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("estimator: {name: drift, gate_sigmas: 0}", ["estimator.gate_sigmas"]),
        (
            "estimator: {name: direct, accel_m_s2: -1, gate_sigmas: 0}",
            ["estimator.gate_sigmas", "estimator.accel_m_s2"],
        ),
        ("estimator: {name: drift, gate_sigmas: 0, gat: 1}", ["estimator.gat", "estimator.gate_sigmas"]),
        ("law: {name: tangent, reach_s: -1, gain_per_s: 0}", ["law.reach_s", "law.gain_per_s"]),
        ("law: {name: sliding_mode, slope: 0, closing_share: 1}", ["law.slope", "law.closing_share"]),
        ("law: {name: pd_bias, kappa: 3, damping: 5}", ["law.kappa"]),
        ("law: {k: 1.0e-9}", ["law.k"]),
        ("law: {k: 1.0e+308}", ["law.k"]),
        ("law: {kappa: 3, k: 0.06}", ["law.kappa"]),
        ("orbit: {radius_m: 4, speed_m_s: 5}\nlaw: {name: tangent}", ["orbit.radius_m"]),
        ("orbit: {radius_m: 4, speed_m_s: 5}\nlaw: {name: tangent, reach_s: 0}", ["orbit.radius_m", "law.reach_s"]),
    ],
)
def test_each_option_that_cannot_fly_is_named_once(text, places):
    assert [line.split(": ")[1] for line in faults(text)] == places


def test_an_alias_may_be_used_twice_and_ages_may_meet():
    config = parse("orbit: {radius_m: &r 60, r_max_m: 100}\nranging: {max_age_s: &s 2, coast_s: *s, latency_s: 1.9}\n")
    assert config.orbit.radius_m == 60 and config.ranging.coast_s == 2
    mappings = "a0: &a0 {x: 1}\n" + "".join(f"a{n}: &a{n} {{x: *a{n - 1}, y: *a{n - 1}}}\n" for n in range(1, 60))
    assert len(faults(mappings)) == 60  # 60 unknown keys, and not 2**60 steps


def test_a_missing_file_is_one_line():
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: cannot read the configuration: No such file"):
        load("nowhere.yaml")


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.name)
def test_every_shipped_configuration_loads(path):
    load(path)


def test_the_reference_file_has_every_key_at_its_default_with_a_reason():
    path = ROOT / "configs" / "px4_multirotor.yaml"
    config = load(path)
    assert config.defaulted == ()
    assert config.model_copy(update={"law": Config().law}).model_dump() == Config().model_dump()
    assert guidance_settings(config).law_options == {"kappa": DEFAULT_KAPPA}  # the default, written out
    data = yaml.safe_load(path.read_text())
    keys = {
        f"{name}.{field.alias or key}" for name, section in Config.model_fields.items() for key, field in inner(section)
    }
    written = {f"{name}.{key}" for name, section in data.items() if isinstance(section, dict) for key in section}
    assert keys <= written, f"keys without a line in {path.name}: {keys - written}"
    for line in path.read_text().splitlines():
        if ":" in line and not line.lstrip().startswith("#") and not line.rstrip().endswith(":"):
            assert "#" in line, f"no unit or reason: {line}"


def inner(section):
    fields = getattr(section.annotation, "model_fields", {})
    return fields.items()


@pytest.mark.parametrize(
    ("text", "kind", "host", "port"),
    [
        ("udpin://0.0.0.0:14540", "udpin", "0.0.0.0", 14540),
        ("udpin:0.0.0.0:14540", "udpin", "0.0.0.0", 14540),
        ("udpin://:14540", "udpin", "0.0.0.0", 14540),
        ("udp://127.0.0.1:14540", "udpin", "127.0.0.1", 14540),
        ("udpout:127.0.0.1:14580", "udpout", "127.0.0.1", 14580),
        ("udpout://fc.local:14580", "udpout", "fc.local", 14580),
    ],
)
def test_both_spellings_of_a_link_are_read(text, kind, host, port):
    endpoint = parse_endpoint(text)
    assert (endpoint.kind, endpoint.host, endpoint.port) == (kind, host, port)


@pytest.mark.parametrize("pitch", ["0", "5", "-0.3"])
def test_a_nose_that_is_not_down_does_not_fly_forward(pitch):
    with pytest.raises(ConfigError, match=r"vehicle\.pitch_deg: .* does not fly forward"):
        parse(f"vehicle: {{class: px4_multirotor_attitude, pitch_deg: {pitch}}}")


@pytest.mark.parametrize("sender", [[42, 1], [255, 0], [1, 158]])
def test_a_beacon_may_be_component_1_of_another_system_and_a_script_component_0(sender):
    """0 is what pymavlink sends with where nothing is said."""
    for vehicle in ("", "vehicle: {system_id: 7}\n"):
        assert parse(f"{vehicle}ranging: {{from: {sender}}}").ranging.sender == tuple(sender)


@pytest.mark.parametrize(
    ("needs", "estimator", "words"),
    [
        ([("LOCAL_POSITION_NED",), ("EKF_STATUS_REPORT",)], "direct", "direct needs turn rate, which"),
        ([("LOCAL_POSITION_NED",), ("EKF_STATUS_REPORT",)], "drift", "drift needs heading, turn rate, which"),
        ([("ATTITUDE",), ("LOCAL_POSITION_NED", "VFR_HUD")], "raw", "raw needs speed, which"),
    ],
)
def test_an_estimator_is_refused_whose_sources_the_vehicle_class_does_not_have(monkeypatch, needs, estimator, words):
    blind = replace(VEHICLES["px4_multirotor"], name="blind", needs=tuple(needs))
    monkeypatch.setitem(VEHICLES, "blind", blind)
    law = "tangent" if estimator == "drift" else "hashemi2013"
    text = f"vehicle: {{class: %s}}\nlaw: {{name: {law}}}\nestimator: {{name: {estimator}}}"
    assert faults(text % "blind") == [f"c.yaml:3: estimator.name: {words} blind does not have"]
    parse(text % "px4_multirotor")


@pytest.mark.parametrize("kind", VEHICLES)
def test_every_vehicle_class_has_what_every_estimator_needs(kind):
    for estimator in ESTIMATORS.values():
        assert estimator.needs <= VEHICLES[kind].senses | {"range"}


@pytest.mark.parametrize(
    "key", ["record: {directory", "vehicle: {signing_key_file", "vehicle: {link", "ranging: {source: replay, endpoint"]
)
def test_a_name_that_no_file_can_have_is_a_fault_of_the_file(key):
    """It loaded, and ended in a traceback where the file was opened."""
    (line,) = faults(f'{key}: "file://a\\0b"}}')
    assert "no file has a character 0 in its name" in line
