"""Soil as rigid cubes in pybullet, as in the 2014 reference, with the particle engine's interface.

A peer to measure `machine_sim.dem` against, not what the machines run on.

- `clamps`: the velocity constraints that keep cubes in a bucket
- `bodies`: the cubes in pybullet; `plates`: tools in pybullet, and the forces on them
- `around`: which cube is in or beside which tool
- `terrain`: cubes on the live terrain
- `engine`: all of it in one step
"""

from machine_sim.reference_cubes.engine import CubeEngine
from machine_sim.reference_cubes.velocity_clamps import REFERENCE_CLAMPS, VelocityClamps

__all__ = ["REFERENCE_CLAMPS", "CubeEngine", "VelocityClamps"]
