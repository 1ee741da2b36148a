"""Lifecycle of a particle: released, grown to full size, settled.

- `release_validation`: checks of the soil that is given to an engine
- `growth`: initial contact radii, and their growth
- `settling`: which particles are at rest on the ground and can be deposited as terrain
"""

from machine_sim.dem.lifecycle.release_validation import ReleaseBatch, validate_release
from machine_sim.dem.lifecycle.settling import settled_ids

__all__ = ["ReleaseBatch", "settled_ids", "validate_release"]
