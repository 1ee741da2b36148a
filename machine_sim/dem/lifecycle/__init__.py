"""Lifecycle of a particle: released, grown to full size, landed.

- `release_validation`: checks of the soil that is given to an engine
- `growth`: initial contact radii, and their growth
- `landing`: which particles are at rest on the ground and become soil of the terrain again
"""

from machine_sim.dem.lifecycle.landing import settled_rows
from machine_sim.dem.lifecycle.release_validation import ReleaseBatch, validate_release

__all__ = ["ReleaseBatch", "settled_rows", "validate_release"]
