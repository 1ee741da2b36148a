"""Soil as particles: soft spheres that turn, and touch each other, tools and terrain.

- `params`: the physics, with units and ranges; `grains`: how each soil's particles touch
- `intake`: what is refused; `store`: the particles and the volume account
- `law`: the contact law; `parts`: what threads share out
- `pairs`: particles against particles: who is near whom, who touches, and the forces
- `plates`, `pose`, `tool`: tool geometry and its motion; `walls`: particles against plates
- `soil_contact`: forces of the terrain
- `growth`: released particles grow to size
- `bodies`, `motion`: the substeps; `landing`: who lands
- `sleep`: who rests; `waking`: who must not any longer; `riding`: who goes along with a tool
- `soil_engine`: what engines have in common; `engine`: one step of it all; `warm`: compile it
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
