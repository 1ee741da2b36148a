"""Soil as rigid cubes in pybullet, as in the 2014 reference, with the interface of `SoilEngine`.

It is a baseline for `machine_sim.dem`, with which machines normally run. In the order of a step:

- `tool_proximity`: which cube is in or near which tool
- `velocity_clamps`: the velocity constraints that keep cubes in a bucket
- `ground_contacts`: cubes on the terrain, which changes and so is not in pybullet
- `ground_impulses`: normal and friction impulses of the ground on one cube
- `cube_bodies`: the cubes in pybullet
- `plate_bodies`: the tools in pybullet, and the forces on them
- `engine`: all of it in one step
"""

from machine_sim.reference_cubes.engine import CubeEngine
from machine_sim.reference_cubes.velocity_clamps import REFERENCE_CLAMPS, VelocityClamps

__all__ = ["REFERENCE_CLAMPS", "CubeEngine", "VelocityClamps"]
