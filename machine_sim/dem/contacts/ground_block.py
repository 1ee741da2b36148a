"""Layout of a block of ground contacts, and of the scratch block of the ground force kernel.

As in `pair_block`: the quantity of slot s is `block[QUANTITY + s]`, and the components of a vector
lie in three stretches in a row.
"""

from __future__ import annotations

from machine_sim.dem.contacts import simd
from machine_sim.dem.contacts.block_vectors import vector_access

BLOCK_SIZE = 64
"""Contacts per block, a multiple of the lanes of the widest vector."""

# Offsets in a block.
NORMAL = 0 * BLOCK_SIZE
"""Unit normal of the tangent plane, upward, map axes (3)."""
DISTANCE = 3 * BLOCK_SIZE
"""Distance of the centre from the plane at the start of the step [m]."""
RADIUS = 4 * BLOCK_SIZE
"""Contact radius [m]."""
MAX_OVERLAP = 5 * BLOCK_SIZE
"""Overlap above which the repulsion grows no more [m]."""
MASS = 6 * BLOCK_SIZE
"""Mass of the particle [kg]."""
TANGENTIAL_SPRING = 7 * BLOCK_SIZE
"""Elongation of the tangential spring, map axes [m] (3)."""
GROUND_VELOCITY = 10 * BLOCK_SIZE
"""Velocity of the ground, map axes [m/s] (3)."""
NUM_QUANTITIES = 13

# Offsets in the scratch block; results overwrite input.
DISPLACEMENT = simd.RELATIVE_DISPLACEMENT * BLOCK_SIZE
"""In: displacement of the particle since the start of the step [m] (3)."""
VELOCITY = simd.RELATIVE_VELOCITY * BLOCK_SIZE
"""In: velocity of the particle [m/s] (3)."""
SURFACE_VELOCITY = simd.SURFACE_VELOCITY_SUM * BLOCK_SIZE
"""In: surface velocity of the particle [m/s] (3)."""
FORCE = simd.FORCE * BLOCK_SIZE
"""Out: force on the particle [N] (3)."""
TORQUE_OVER_RADIUS = simd.TORQUE_OVER_RADIUS * BLOCK_SIZE
"""Out: torque on the particle over its contact radius [N] (3)."""
ROLLING_LIMIT = simd.ROLLING_LIMIT * BLOCK_SIZE
"""Out: contribution of the contact to the limit of rolling resistance over radius [N]."""
SCRATCH_SIZE = 9 * BLOCK_SIZE
"""Floats in the scratch block."""

load, store = vector_access(BLOCK_SIZE)
