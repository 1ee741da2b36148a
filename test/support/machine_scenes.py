"""A machine on level ground, for tests of the machine simulation."""

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
from support.soil_scenes import reference_soil

GRID = Grid(129, 129, 0.2)

COMMAND_NAMES = (*EXCAVATOR_JOINTS, *TRACK_NAMES)
"""Names of all commands of an excavator."""


def load_shipped_machine(name: str) -> MachineSpec:
    """Return a machine of `config/machines`."""
    return load_machine_spec(find_config(f"machines/{name}.yaml"))


def excavator() -> MachineSpec:
    """Return the excavator of `config/machines`."""
    return load_shipped_machine("excavator")


def machine_on_level_ground(spec: MachineSpec | None = None, **options: object) -> MachineSim:
    """Return a machine, by default the excavator, in the middle of a level map, facing +x."""
    placements = [Placement(spec or excavator())]
    return MachineSim(placements, GRID, np.zeros(GRID.shape), **options)  # type: ignore[arg-type]


def loose_soil_options(soil: Soil) -> dict[str, list[LooseSoil]]:
    """Return the options of `MachineSim` that describe the loose soils of a terrain."""
    return {"soils": list(soil.loose_soils)}


def level_soil(**params: object) -> Soil:
    """Return level soil of `reference_soil` on the same grid."""
    return Soil(GRID, np.zeros(GRID.shape), reference_soil(**params))
