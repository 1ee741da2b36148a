"""A machine on level ground, for tests of the machine side."""

from __future__ import annotations

import numpy as np

from machine_sim.commands import TRACK_NAMES
from machine_sim.machine import EXCAVATOR_JOINTS, MachineSpec, load_machine_spec
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(129, 129, 0.2)

COMMAND_NAMES = (*EXCAVATOR_JOINTS, *TRACK_NAMES)
"""What an excavator is commanded."""


def load_shipped_machine(name: str) -> MachineSpec:
    """A machine that is shipped."""
    return load_machine_spec(find_config(f"machines/{name}.yaml"))


def excavator() -> MachineSpec:
    """The shipped excavator."""
    return load_shipped_machine("excavator")


def machine_on_level_ground(spec: MachineSpec | None = None, **options: object) -> MachineSim:
    """The shipped machine, or another, in the middle of a map at height 0, facing +x."""
    placements = [Placement(spec or excavator())]
    return MachineSim(placements, GRID, np.zeros(GRID.shape), **options)  # type: ignore[arg-type]


def loose_soil_options(soil: Soil) -> dict[str, list[LooseSoil]]:
    """What a machine must know of how soil is when it is loose."""
    return {"soils": list(soil.loose_soils)}


def level_soil(**params: object) -> Soil:
    """Soil under such a machine."""
    return Soil(GRID, np.zeros(GRID.shape), SoilParams(**params))  # type: ignore[arg-type]
