"""The shipped excavator, and a board that takes its commands."""

from collections.abc import Callable
from pathlib import Path

import pytest

from machine_sim.commands import CommandBoard, CommandParams
from machine_sim.machine import MachineDescription, load_description

MACHINE_FILE = Path(__file__).resolve().parents[3] / "config" / "machines" / "excavator.yaml"


@pytest.fixture(scope="session")
def description() -> MachineDescription:
    return load_description(MACHINE_FILE)


@pytest.fixture
def board(description) -> Callable[..., CommandBoard]:
    """Make a board, with other parameters than the shipped ones by name."""
    return lambda **params: CommandBoard(description, CommandParams(**params))
