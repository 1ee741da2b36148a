"""A machine on level ground, for tests of the machine side."""

from __future__ import annotations

import numpy as np

from machine_sim.core import MachineSim
from machine_sim.machine import MachineDescription, load_description
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

GRID = Grid(129, 129, 0.2)


def excavator() -> MachineDescription:
    """The shipped excavator."""
    return load_description(find_config("machines/excavator.yaml"))


def machine_on_level_ground(
    description: MachineDescription | None = None, **options: object
) -> MachineSim:
    """The shipped machine, or another, in the middle of a map at height 0, facing +x."""
    machine = description or excavator()
    return MachineSim(machine, GRID, np.zeros(GRID.shape), **options)  # type: ignore[arg-type]


def loosened(soil: Soil) -> dict[str, list[LooseSoil]]:
    """What a machine must know of how soil is when it is loose."""
    return {"soils": list(soil.loose_soils)}


def level_soil(**params: object) -> Soil:
    """Soil under such a machine."""
    return Soil(GRID, np.zeros(GRID.shape), SoilParams(**params))  # type: ignore[arg-type]
