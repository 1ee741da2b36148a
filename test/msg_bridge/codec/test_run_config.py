"""The configuration of a run is complete YAML, and machines read their parameters from it."""

from __future__ import annotations

import pytest
import yaml

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.run_config import (
    RunFacts,
    SoilKind,
    parse_run_facts,
    soil_kinds,
    to_config_yaml,
    versions,
)
from msg_bridge.contract.loose_soil import LooseSoil

FACTS = RunFacts(
    run_id=1_795_247_584, tick_period=0.01, realtime=False, cell=0.2, soils=(LooseSoil(0.25),)
)

KINDS = (
    SoilKind("", (0.5, 0.4, 0.3), 0.15, 1600.0, (35.0, 35.0, 35.0)),
    SoilKind("wet sand", (0.82, 0.71, 0.51), 0.12, 1840.0, (34.0, 45.0, 25.0)),
)
KIND = "id: 0, name: a, colour: [1, 0, 0], swell: 0, density: 1, repose_angles: [1, 2, 3]"


@pytest.mark.parametrize("realtime", [True, False])
@pytest.mark.parametrize("tick", [0.01, 0.005, 1 / 3, 0.1 + 0.2])
def test_facts_are_transmitted_exactly(realtime: bool, tick: float) -> None:
    facts = RunFacts(
        7,
        tick,
        realtime,
        0.1 * 3,
        (
            LooseSoil(1e-5, 1e3 / 3),
            LooseSoil(0.1, 2e3, moisture_strength_factors=(1.0, 1 / 3, 0.0)),
            LooseSoil(
                bekker_k_phi=1e6 / 3, moisture_bearing_factors=(1.0, 0.7, 0.1), janosi_k=0.1 / 3
            ),
        ),
    )
    assert parse_run_facts(to_config_yaml(facts, {})) == facts


def test_whole_numbers_are_read_as_numbers() -> None:
    facts = parse_run_facts(
        "run: {run_id: 1, tick_period: 1, sync: realtime, cell: 2, soils: [{swell: 0,"
        " moisture_strength_factors: [1, 2, 3]}]}"
    )
    assert facts == RunFacts(
        1, 1.0, True, 2.0, (LooseSoil(0.0, moisture_strength_factors=(1.0, 2.0, 3.0)),)
    )
    assert type(facts.soils[0].swell) is float


def test_sections_are_plain_yaml() -> None:
    sections = {
        "grid": {"rows": 3},
        "machines": (1, 2),
        "georeference": None,
        "deep": {"a": ((1,),)},
    }
    content = yaml.safe_load(to_config_yaml(FACTS, sections))
    assert content["grid"] == {"rows": 3}
    assert content["machines"] == [1, 2]
    assert content["georeference"] is None
    assert content["deep"] == {"a": [[1]]}
    assert content["run"]["sync"] == "lockstep"


def test_configuration_has_the_versions_of_the_software() -> None:
    content = yaml.safe_load(to_config_yaml(FACTS, {}))
    assert content["versions"] == versions()
    assert {"python", "earthmoving_sim", "numpy", "numba", "pybullet", "source"} <= set(versions())
    assert versions()["numpy"].split(".")[0].isdigit()


def test_section_cannot_replace_the_versions() -> None:
    content = yaml.safe_load(to_config_yaml(FACTS, {"versions": "none"}))
    assert content["versions"] == versions()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "42",
        "[1, 2]",
        "run: 3",
        "run: {run_id: 1}",
        "run: {run_id: one, tick_period: 0.01, sync: realtime, cell: 0.2, soils: [{}]}",
        "run: {run_id: 1, tick_period: [1], sync: realtime, cell: 0.2, soils: [{}]}",
        "run: {run_id: 1, tick_period: 0.01, sync: sometimes, cell: 0.2, soils: [{}]}",
        "run: {run_id: .inf, tick_period: 0.01, sync: realtime, cell: 0.2, soils: [{}]}",
        "run: {run_id: 1, tick_period: 0.01",
        "!!python/object/apply:os.system [true]",
        "\x00",
        "run: " + "[" * 2000,
        "run: " + "x" * 200_000,
    ],
)
def test_invalid_configuration_is_rejected(text: str) -> None:
    with pytest.raises(CodecError):
        parse_run_facts(text)


@pytest.mark.parametrize(
    "soils",
    [
        "",
        "soils: 0.1",
        "soils: []",
        "soils: [0.1]",
        "soils: [{swell: .nan}]",
        "soils: [{density: 0}]",
        "soils: [{swell: [0.1, 0.2]}]",
        "soils: [{moisture_strength_factors: [1]}]",
        "soils: [{colour: 1}]",
    ],
)
def test_invalid_soil_parameters_are_rejected(soils: str) -> None:
    with pytest.raises(CodecError):
        parse_run_facts(
            f"run: {{run_id: 1, tick_period: 0.01, sync: realtime, cell: 0.2, {soils}}}"
        )


@pytest.mark.parametrize("name", ["tick_period", "cell"])
@pytest.mark.parametrize("value", [".nan", ".inf", "0.0", "-0.01"])
def test_invalid_lengths_are_rejected(name: str, value: str) -> None:
    values = {
        "run_id": "1",
        "tick_period": "0.01",
        "sync": "realtime",
        "cell": "0.2",
        "soils": "[{}]",
    }
    values[name] = value
    text = "run: {" + ", ".join(f"{k}: {v}" for k, v in values.items()) + "}"
    with pytest.raises(CodecError):
        parse_run_facts(text)


def test_soil_types_are_listed_by_id() -> None:
    text = to_config_yaml(FACTS, {"soil": {"soil": "loam"}}, KINDS)
    assert soil_kinds(text) == KINDS
    assert parse_run_facts(text) == FACTS
    listed = yaml.safe_load(text)["soil_kinds"]
    assert [each["id"] for each in listed] == [0, 1]
    assert listed[1]["repose_angles"] == [34.0, 45.0, 25.0]


def test_configuration_without_soil_types_has_no_section_of_them() -> None:
    assert "soil_kinds" not in yaml.safe_load(to_config_yaml(FACTS, {}))


def test_whole_numbers_of_a_soil_are_read_as_numbers() -> None:
    kind = soil_kinds("soil_kinds: [{" + KIND + "}]")[0]
    assert kind == SoilKind("a", (1.0, 0.0, 0.0), 0.0, 1.0, (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "run: {}",
        "soil_kinds: 3",
        "soil_kinds: []",
        "soil_kinds: [3]",
        "soil_kinds: [{" + KIND.replace("id: 0", "id: 1") + "}]",
        "soil_kinds: [{" + KIND.replace("name: a, ", "") + "}]",
        "soil_kinds: [{" + KIND.replace("[1, 0, 0]", "[1, 0]") + "}]",
        "soil_kinds: [{" + KIND.replace("swell: 0", "swell: .nan") + "}]",
        "soil_kinds: [{" + KIND.replace("density: 1", "density: -1") + "}]",
        "soil_kinds: [{" + KIND.replace("[1, 2, 3]", "steep") + "}]",
    ],
)
def test_invalid_soil_types_are_rejected(text: str) -> None:
    with pytest.raises(CodecError):
        soil_kinds(text)
