"""What it takes to cut, and what bears a tool: forces of the ground on tools.

- `earthmoving`: a blade in soil (fundamental earthmoving equation), as pure functions
- `pick`: a conical pick in rock (Evans, Goktan), likewise
- `cutting`: what resists a tool's lip and plate, by both; `side`: what resists its side
- `bearing`: soil under plates and lip (Vesic)
- `resistance`: all that of a tick's sweeps, as rows
- `strength`: the kinds of soil as tables for them

Quasi-static: speed does not enter. SI units, angles in rad.
"""

from soil_sim.tool_force.earthmoving_equation import (
    BladeForce,
    WedgeFactors,
    blade_force,
    compute_blade_force,
    wedge_factors,
)
from soil_sim.tool_force.rock_pick import PickForce, evans_force, goktan_force, pick_force

__all__ = [
    "BladeForce",
    "PickForce",
    "WedgeFactors",
    "blade_force",
    "compute_blade_force",
    "evans_force",
    "goktan_force",
    "pick_force",
    "wedge_factors",
]
