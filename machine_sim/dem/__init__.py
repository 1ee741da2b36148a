"""Soil as particles: the discrete element method (DEM) with soft spheres.

Spheres with rotation touch each other, tools and the terrain. In the order of the algorithm:

- `params`: parameters of the physics, with units and ranges
- `state`: the particles, and their exact volume; `particle_columns`: their columns, for kernels
- `materials`: contact coefficients of each soil type
- `lifecycle`: release, growth and settling of particles
- `neighbours`: the list of pairs that may touch
- `contacts`: contacts of pairs, at plates and on the ground, and their forces
- `integrate`, `substeps`: explicit integration; `step_motion`: the motion in a step, in one call
- `partition`: parts of the work that threads can do at the same time; `compaction`: lists filled a
  vector at a time
- `tools`: tool geometry and motion
- `sleep`: particles at rest, and soil that is locked to a tool
- `invalidation`: what is rebuilt after which change; `step_buffers`: memory of a step
- `contact_dynamics`: the data kept for contacts, and the stages of a step that use it
- `soil_engine`: the interface of all engines of loose soil; `engine`: this one, stage by stage
- `jit_warm_up`: compilation of all kernels before the first step

Other packages use the names below.
"""

from machine_sim.dem.engine import ParticleEngine
from machine_sim.dem.jit_warm_up import warm_up
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.soil_engine import SoilEngine
from machine_sim.dem.state import ParticleError, ParticleState
from machine_sim.dem.tools.plates import Plates
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import RigidTool

__all__ = [
    "ParticleEngine",
    "ParticleError",
    "ParticleParams",
    "ParticleState",
    "Plates",
    "Pose",
    "RigidTool",
    "SoilEngine",
    "warm_up",
]
