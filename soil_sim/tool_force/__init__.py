"""Forces of the ground on tools: cutting resistance, milling resistance and bearing capacity.

- `earthmoving_equation`: force of soil on a blade (fundamental earthmoving equation)
- `failure_wedge`: the same below a sloping surface, with soil that fails beside the blade
- `curved_failure`: factor of the force on steep and rough faces
- `surface_ahead`: depth and slope of the surface before an edge; `uneven_surface`: factor of the
  force before a berm or a bank
- `rock_pick`: force of rock on a conical pick (Evans, Goktan)
- `strength_table`: soil properties and terrain data that the force kernels read
- `wrench`: sums of forces, reduced to force, torque and point of application
- `cutting_edge`: resistance to the cutting edge of a tool and the plate behind it
- `side_plate`: resistance to the side of a tool that moves sideways
- `bearing_capacity`: force of the soil on plates and the cutting edge that rest on it (Vesic)
- `stationary_drum`: force of the soil on a drum that is not driven
- `specific_energy`: work of milling for a volume of soil, and of cutting for one of rock
- `tool_forces`: all forces of a tick, as FORCE rows

The forces are quasi-static: they do not depend on speed. Units are SI, angles are in rad.
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
