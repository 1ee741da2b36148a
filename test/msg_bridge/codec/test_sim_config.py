"""The configuration of a run as text: whole for people, a few facts for machines."""

from __future__ import annotations

import pytest
import yaml

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.sim_config import RunFacts, config_text, run_facts, versions

FACTS = RunFacts(epoch=1_795_247_584, tick=0.01, realtime=False, cell=0.2, swell=0.25)


@pytest.mark.parametrize("realtime", [True, False])
@pytest.mark.parametrize("tick", [0.01, 0.005, 1 / 3, 0.1 + 0.2])
def test_facts_cross_exactly(realtime: bool, tick: float) -> None:
    facts = RunFacts(7, tick, realtime, 0.1 * 3, 1e-5)
    assert run_facts(config_text(facts, {})) == facts


def test_whole_numbers_are_read_as_numbers() -> None:
    facts = run_facts("run: {epoch: 1, tick: 1, sync: realtime, cell: 2, swell: 0}")
    assert facts == RunFacts(1, 1.0, True, 2.0, 0.0)
    assert type(facts.swell) is float


def test_sections_are_there_as_plain_yaml() -> None:
    sections = {
        "grid": {"rows": 3},
        "machines": (1, 2),
        "georeference": None,
        "deep": {"a": ((1,),)},
    }
    content = yaml.safe_load(config_text(FACTS, sections))
    assert content["grid"] == {"rows": 3}
    assert content["machines"] == [1, 2]
    assert content["georeference"] is None
    assert content["deep"] == {"a": [[1]]}
    assert content["run"]["sync"] == "lockstep"


def test_versions_say_what_made_the_run() -> None:
    content = yaml.safe_load(config_text(FACTS, {}))
    assert content["versions"] == versions()
    assert {"python", "earthmoving_sim", "numpy", "numba", "pybullet"} <= set(versions())
    assert versions()["numpy"].split(".")[0].isdigit()


def test_a_section_cannot_stand_in_for_the_versions() -> None:
    content = yaml.safe_load(config_text(FACTS, {"versions": "none"}))
    assert content["versions"] == versions()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "42",
        "[1, 2]",
        "run: 3",
        "run: {epoch: 1}",
        "run: {epoch: one, tick: 0.01, sync: realtime, cell: 0.2, swell: 0.0}",
        "run: {epoch: 1, tick: [1], sync: realtime, cell: 0.2, swell: 0.0}",
        "run: {epoch: 1, tick: 0.01, sync: sometimes, cell: 0.2, swell: 0.0}",
        "run: {epoch: .inf, tick: 0.01, sync: realtime, cell: 0.2, swell: 0.0}",
        "run: {epoch: 1, tick: 0.01",
        "!!python/object/apply:os.system [true]",
        "\x00",
    ],
)
def test_what_is_no_configuration_is_refused(text: str) -> None:
    with pytest.raises(CodecError):
        run_facts(text)


@pytest.mark.parametrize("name", ["tick", "cell"])
@pytest.mark.parametrize("value", [".nan", ".inf", "0.0", "-0.01"])
def test_lengths_that_nothing_can_have_are_refused(name: str, value: str) -> None:
    values = {"epoch": "1", "tick": "0.01", "sync": "realtime", "cell": "0.2", "swell": "0.0"}
    values[name] = value
    text = "run: {" + ", ".join(f"{k}: {v}" for k, v in values.items()) + "}"
    with pytest.raises(CodecError):
        run_facts(text)
