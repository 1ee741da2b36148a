"""A machine on level ground, for tests of the machine side."""

from __future__ import annotations

import numpy as np

from machine_sim.commands import TRACK_NAMES
from machine_sim.core import MachineSim
from machine_sim.machine import EXCAVATOR_JOINTS, MachineDescription, load_description
from machine_sim.work.rig import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

GRID = Grid(129, 129, 0.2)

COMMAND_NAMES = (*EXCAVATOR_JOINTS, *TRACK_NAMES)
"""What an excavator is commanded."""


def shipped(name: str) -> MachineDescription:
    """A machine that is shipped."""
    return load_description(find_config(f"machines/{name}.yaml"))


def excavator() -> MachineDescription:
    """The shipped excavator."""
    return shipped("excavator")


def machine_on_level_ground(
    description: MachineDescription | None = None, **options: object
) -> MachineSim:
    """The shipped machine, or another, in the middle of a map at height 0, facing +x."""
    placements = [Placement(description or excavator())]
    return MachineSim(placements, GRID, np.zeros(GRID.shape), **options)  # type: ignore[arg-type]


def loosened(soil: Soil) -> dict[str, list[LooseSoil]]:
    """What a machine must know of how soil is when it is loose."""
    return {"soils": list(soil.loose_soils)}


def level_soil(**params: object) -> Soil:
    """Soil under such a machine."""
    return Soil(GRID, np.zeros(GRID.shape), SoilParams(**params))  # type: ignore[arg-type]
