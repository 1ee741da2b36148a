"""What it takes to cut: forces of the ground on tools, as pure functions and kernels.

- `earthmoving`: a blade in soil (fundamental earthmoving equation)
- `pick`: a conical pick in rock (Evans, Goktan)

Quasi-static: speed does not enter. SI units, angles in rad.
"""

from soil_sim.force.earthmoving import (
    EarthForce,
    WedgeFactors,
    blade_force,
    earth_force,
    wedge_factors,
)
from soil_sim.force.pick import PickForce, evans_force, goktan_force, pick_force

__all__ = [
    "EarthForce",
    "PickForce",
    "WedgeFactors",
    "blade_force",
    "earth_force",
    "evans_force",
    "goktan_force",
    "pick_force",
    "wedge_factors",
]
