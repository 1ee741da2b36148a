"""Ground: the machines' copy of the terrain surface, which tracks and particles touch.

- `contact_surface`: heights and materials of the surface, which rises at a limited speed
- `contact_surface_kernels`: their kernels, and heights between grid points
"""

from machine_sim.ground.contact_surface import MAX_RISE_SPEED, Ground, GroundError
from machine_sim.ground.contact_surface_kernels import surface_at

__all__ = ["MAX_RISE_SPEED", "Ground", "GroundError", "surface_at"]
