"""Layout of a block of pair contacts, and of the scratch block of the pair force kernel.

A block is a flat float32 array of `NUM_QUANTITIES` stretches of `BLOCK_SIZE` slots, one slot per
contact: the quantity of slot s is `block[QUANTITY + s]`, and the components of a vector lie in
three stretches in a row (`load`, `store`). The constant distance between quantities lets the
compiler prove that they do not overlap, and it vectorises the contact arithmetic (8 or 16 contacts
at once).
"""

from __future__ import annotations

from machine_sim.dem.contacts import simd
from machine_sim.dem.contacts.block_vectors import vector_access

BLOCK_SIZE = 128
"""Contacts per block: 6 KB, which fits into the first-level cache."""

# Offsets in a block.
SEPARATION = 0 * BLOCK_SIZE
"""Vector from the first centre to the second at the start of the step, map axes [m] (3)."""
RADIUS_SUM = 3 * BLOCK_SIZE
"""Sum of the contact radii [m]."""
EFFECTIVE_MASS = 4 * BLOCK_SIZE
"""Effective mass of the pair [kg]."""
FRICTION = 5 * BLOCK_SIZE
"""Coulomb friction coefficient."""
ROLLING_FRICTION = 6 * BLOCK_SIZE
"""Rolling friction coefficient."""
COHESION_FORCE = 7 * BLOCK_SIZE
"""Attractive force of particles that touch [N]."""
MAX_OVERLAP = 8 * BLOCK_SIZE
"""Overlap above which the repulsion grows no more [m]: the smaller contact radius."""
TANGENTIAL_SPRING = 9 * BLOCK_SIZE
"""Elongation of the tangential spring, map axes [m] (3)."""
NUM_QUANTITIES = 12

# Offsets in the scratch block, whose quantities are needed only within a substep: one scratch block
# serves all blocks and stays in the first-level cache. The results overwrite the input.
RELATIVE_DISPLACEMENT = simd.RELATIVE_DISPLACEMENT * BLOCK_SIZE
"""In: displacement of the second particle relative to the first [m] (3)."""
RELATIVE_VELOCITY = simd.RELATIVE_VELOCITY * BLOCK_SIZE
"""In: velocity of the second particle relative to the first [m/s] (3)."""
SURFACE_VELOCITY_SUM = simd.SURFACE_VELOCITY_SUM * BLOCK_SIZE
"""In: sum of the surface velocities of both [m/s] (3)."""
FORCE = simd.FORCE * BLOCK_SIZE
"""Out: force on the second particle [N] (3)."""
TORQUE_OVER_RADIUS = simd.TORQUE_OVER_RADIUS * BLOCK_SIZE
"""Out: torque on each of both over its contact radius [N] (3)."""
ROLLING_LIMIT = simd.ROLLING_LIMIT * BLOCK_SIZE
"""Out: contribution of the contact to the limit of rolling resistance over radius [N]."""
SCRATCH_SIZE = 9 * BLOCK_SIZE
"""Floats in the scratch block."""

load, store = vector_access(BLOCK_SIZE)
