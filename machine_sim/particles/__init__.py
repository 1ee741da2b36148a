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

from machine_sim.particles.engine import ParticleEngine
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.plates import Plates
from machine_sim.particles.pose import Pose
from machine_sim.particles.soil_engine import SoilEngine
from machine_sim.particles.store import ParticleError, ParticleStore
from machine_sim.particles.tool import RigidTool
from machine_sim.particles.warm import warm_up

__all__ = [
    "ParticleEngine",
    "ParticleError",
    "ParticleParams",
    "ParticleStore",
    "Plates",
    "Pose",
    "RigidTool",
    "SoilEngine",
    "warm_up",
]
