"""Tracked bags of every format remain readable, to the mm3."""

from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from earthmoving_sim.recorded_run import outcome_from_bag
from machine_sim.dem.params import ParticleParams
from machine_sim.node.params import MachineNodeParams
from machine_sim.params import MachineSimParams
from msg_bridge.audit import audit_bag
from msg_bridge.audit.report import Check
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.run_config import soil_kinds
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import SiteParams
from soil_sim.soils.params import SoilParams

BAGS = Path(__file__).parents[3] / "bags"


class Expected(NamedTuple):
    """Figures of a recorded run."""

    num_ticks: int
    excavated_mm3: int
    deposited_mm3: int
    outside_mm3: int
    moved_m3: float
    num_passes: int
    max_particles: int
    state_hash: str


FORMATS = ("format_1", "format_2")

EXPECTED = Expected(
    num_ticks=1217,
    excavated_mm3=6_516_242_042,
    deposited_mm3=5_984_100_145,
    outside_mm3=531_859_438,
    moved_m3=0.569473071,
    num_passes=3,
    max_particles=60,
    state_hash="81a0d73525d38c8c274eec415b5f53da2be81b2677210e25323173093800af99",
)
"""Both bags record the same run: the simulation did not change between their formats."""


@pytest.mark.parametrize("name", FORMATS)
def test_audit_of_fixture_passes_with_its_volumes(name: str) -> None:
    report = audit_bag(BAGS / name)
    assert report.passed, report
    (run,) = report.runs
    assert (run.audited, run.max_imbalance_mm3) == ((0, EXPECTED.num_ticks - 1), 0)
    assert {check.check for check in run.checks} == set(Check)
    assert run.moved_mm3 == {
        "EXCAVATE": EXPECTED.excavated_mm3,
        "DEPOSIT": EXPECTED.deposited_mm3,
        "OUTSIDE": EXPECTED.outside_mm3,
        "REJECT": 0,
        "RELEASED": 0,
    }


@pytest.mark.parametrize("name", FORMATS)
def test_outcome_of_fixture_is_that_of_its_run(name: str) -> None:
    outcome = outcome_from_bag(BAGS / name)
    (cycle,) = outcome.cycles
    assert outcome.is_successful
    assert outcome.ledger.tick == outcome.state_tick == EXPECTED.num_ticks - 1
    assert outcome.ledger.outside == EXPECTED.outside_mm3
    assert outcome.state_hash == EXPECTED.state_hash
    assert outcome.moved_volume == pytest.approx(EXPECTED.moved_m3, abs=1e-9)
    assert cycle.num_passes == EXPECTED.num_passes
    assert 0 < outcome.max_particles <= EXPECTED.max_particles  # messages were thinned
    assert outcome.tunnelled == 0
    assert outcome.run_mode.startswith("nodes ")
    assert set(outcome.run_mode.removeprefix("nodes ").split(", ")) == {
        "dig_operator",
        "exchange_recorder",
        "machine_sim",
        "soil_sim",
    }


@pytest.mark.parametrize("name", FORMATS)
def test_configuration_in_fixture_has_the_names_of_todays_parameters(name: str) -> None:
    configs = {topic: m.data for topic, _, m in BagReader(BAGS / name).messages(_CONFIGS)}
    sections = {
        section: values for text in configs.values() for section, values in _load(text).items()
    }
    for section, params in {
        "soil_sim": SoilNodeParams,
        "soil": SoilParams,
        "site": SiteParams,
        "machine_sim": MachineNodeParams,
        "stepping": MachineSimParams,
        "particles": ParticleParams,
    }.items():
        assert set(sections[section]) <= {field.name for field in fields(params)}, section
    assert sections["stepping"]["track_model"] == "kinematic"
    assert len(soil_kinds(configs["/sim/config"])) == 1


_CONFIGS = ("/sim/config", "/excavator/config")


def _load(text: str) -> dict[str, dict[str, object]]:
    loaded: dict[str, dict[str, object]] = yaml.safe_load(text)
    return loaded
