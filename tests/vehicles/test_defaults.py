"""What a configuration flies that names its vehicle class and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from circumnav_mav.config import guidance_settings
from circumnav_mav.config_file import ConfigError, load, parse
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.mavlink.vehicles import VEHICLES
from sitl_stub.config import AIRFRAMES
from tests.lockstep import Rig, airborne

CONFIGS = Path(__file__).parents[2] / "configs"
PITCH = "pitch_deg: -4.37"
"""Of the stub's multirotor at 5 m/s: a belief that no class can have by itself."""


def named_only(name: str, more: str = "") -> str:
    pitch = f", {PITCH}" if VEHICLES[name].wants_pitch else ""
    return f"vehicle: {{class: {name}{pitch}}}\n{more}"


@pytest.mark.parametrize("name", VEHICLES)
def test_the_pair_of_every_class_goes_together(name):
    config = parse(named_only(name))
    assert {"law.name", "estimator.name"} <= set(config.defaulted)
    assert set(LAWS[config.law.name].needs) <= ESTIMATORS[config.estimator.name].gives | {"V"}


@pytest.mark.parametrize("name", [n for n, v in VEHICLES.items() if v.airframe == "fixed_wing"])
def test_planes_know_the_wind_by_default(name):
    config = parse(named_only(name))
    assert (config.law.name, config.estimator.name) == ("tangent", "drift")
    assert config.orbit.speed_m_s > 10.0


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_file_of_a_class_says_what_the_class_decides(path):
    shipped = load(path)
    if path.stem != shipped.vehicle.kind:
        pytest.skip("a file for a situation, not for a class")
    alone = parse(named_only(shipped.vehicle.kind))
    assert (alone.law.name, alone.estimator.name) == (shipped.law.name, shipped.estimator.name)
    assert alone.law_context() == shipped.law_context()
    assert alone.limits == shipped.limits
    assert alone.on_range_lost == shipped.on_range_lost
    actions = [key for key in type(alone.safety).model_fields if key.startswith("on_")]
    assert [getattr(alone.safety, key) for key in actions] == [getattr(shipped.safety, key) for key in actions]
    assert alone.ranging.target_height_m == shipped.ranging.target_height_m


@pytest.mark.parametrize(
    ("name", "given", "law", "estimator", "open_"),
    [
        (
            "px4_fixed_wing",
            "law: {name: hashemi2013, kappa: 5}\nestimator: {name: direct}",
            "hashemi2013",
            "direct",
            "",
        ),
        ("px4_fixed_wing", "estimator: {name: direct}", "hashemi2013", "direct", "law.name"),
        ("px4_fixed_wing", "law: {name: pd_bias}", "pd_bias", "drift", "estimator.name"),
        ("px4_fixed_wing", "law: {reach_s: 2.0}", "tangent", "drift", "law.name estimator.name"),
        ("px4_multirotor", "law: {name: tangent}", "tangent", "drift", "estimator.name"),
        ("px4_multirotor", "law: {kappa: 5}", "hashemi2013", "direct", "law.name estimator.name"),
        ("px4_multirotor_attitude", "law: {name: hashemi2013, k: 0.1}", "hashemi2013", "drift", "estimator.name"),
    ],
)
def test_what_is_named_wins_and_the_rest_goes_with_it(name, given, law, estimator, open_):
    config = parse(named_only(name, given))
    assert (config.law.name, config.estimator.name) == (law, estimator)
    assert {path for path in config.defaulted if path.endswith(".name")} == set(open_.split())


@pytest.mark.parametrize("name", VEHICLES)
def test_a_plane_finds_out_whether_its_ranges_are_slant_where_the_file_says_nothing(name):
    plane = VEHICLES[name].airframe == "fixed_wing"
    config = parse(named_only(name))
    assert config.ranging.target_height_m == ("auto" if plane else None)
    assert ("ranging.target_height_m" in config.defaulted) is plane
    assert guidance_settings(config).choose_height is plane
    for given in (None, 0.0, 12.5):
        said = parse(named_only(name, f"ranging: {{target_height_m: {'null' if given is None else given}}}"))
        assert said.ranging.target_height_m == given and "ranging.target_height_m" not in said.defaulted
        assert not guidance_settings(said).choose_height


def test_another_estimator_than_the_class_s_takes_ranges_as_horizontal_unless_told():
    config = parse(named_only("px4_fixed_wing", "estimator: {name: polar}\nranging: {sigma_m: 1.0}"))
    assert config.ranging.target_height_m is None and "ranging.target_height_m" not in config.defaulted
    assert config.ranging.sigma_m == 1.0
    with pytest.raises(ConfigError, match=r"ranging\.target_height_m: auto needs estimator drift, not polar: give the"):
        parse(named_only("px4_fixed_wing", "estimator: {name: polar}\nranging: {target_height_m: auto}"))


def test_a_number_that_is_given_wins_and_the_others_of_its_section_stay_the_class_s():
    config = parse(named_only("arduplane", "orbit: {radius_m: 200}"))
    assert (config.orbit.radius_m, config.orbit.speed_m_s) == (200.0, 22.0)
    assert "orbit.speed_m_s" in config.defaulted
    assert "orbit.radius_m" not in config.defaulted


def test_an_option_of_another_law_says_whose_law_it_met():
    with pytest.raises(ConfigError, match=r"law\.kappa: no option of tangent, the law of px4_fixed_wing; .* law\.name"):
        parse(named_only("px4_fixed_wing", "law: {kappa: 4}"))


def test_an_unknown_class_is_the_only_fault_told():
    with pytest.raises(ConfigError) as caught:
        parse("vehicle: {class: boat}")
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize("name", [n for n, v in VEHICLES.items() if v.airframe in AIRFRAMES and n.startswith("px4")])
def test_a_class_by_its_name_alone_settles_on_the_stub(name):
    """A plane in wind of a third of its speed, a multirotor in a breeze."""
    config = parse(named_only(name))
    orbit, vehicle = config.orbit, config.vehicle_class
    flies = vehicle.airframe == "fixed_wing"
    wind_m_s = {"air": orbit.speed_m_s / 3.0, "ground": 2.0, "believed": 2.0}[vehicle.speed]
    rig = Rig(
        config,
        airborne(
            distance_m=3.0 * orbit.radius_m,
            height_m=100.0 if flies else 20.0,
            airframe=vehicle.airframe,
            start_speed_m_s=orbit.speed_m_s if flies else 0.0,
            wind_north_m_s=wind_m_s,
            seed=8,
        ),
    ).engage()
    log = rig.run(3.0 * orbit.radius_m / orbit.speed_m_s + 60.0)
    assert log.phases[-1] == "orbiting", (log.phases, rig.flight.events)
    assert log.rms_m(20.0) < 0.02 * orbit.radius_m
    told = "\n".join(event.text for event in rig.flight.events if event.t_s == 0.0)
    assert f"law {config.law.name} (default) on estimator {config.estimator.name} (default)" in told
