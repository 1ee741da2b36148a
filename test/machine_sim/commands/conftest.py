"""The shipped excavator, and an arbiter of its commands."""

from collections.abc import Callable
from pathlib import Path

import pytest

from machine_sim.commands import CommandArbiter, CommandParams
from machine_sim.machine import MachineSpec, load_machine_spec

MACHINE_FILE = Path(__file__).resolve().parents[3] / "config" / "machines" / "excavator.yaml"


@pytest.fixture(scope="session")
def spec() -> MachineSpec:
    return load_machine_spec(MACHINE_FILE)


@pytest.fixture
def make_arbiter(spec) -> Callable[..., CommandArbiter]:
    """Make an arbiter; keyword arguments replace shipped parameters."""
    return lambda **params: CommandArbiter(spec, CommandParams(**params))
