"""Layout of a block of plate contacts, and of the scratch block of the plate force kernel.

As in `pair_block`: the quantity of slot s is `block[QUANTITY + s]`, and the components of a vector
lie in three stretches in a row. Plate axes are (a, b, h), along u, v and n of the plate, see
`tools.plates`.
"""

from __future__ import annotations

from machine_sim.dem.contacts import simd
from machine_sim.dem.contacts.block_vectors import vector_access

BLOCK_SIZE = 64
"""Contacts per block, a multiple of the lanes of the widest vector."""

# Offsets in a block.
CENTRE = 0 * BLOCK_SIZE
"""Centre of the particle at the start of the step, plate axes, from the plate's origin [m] (3)."""
LEVER_ARM = 3 * BLOCK_SIZE
"""Vector from the tool's origin to the centre at the start of the step, map axes [m] (3)."""
RADIUS = 6 * BLOCK_SIZE
"""Radius of the particle in contacts with plates [m]."""
RADIUS_RATIO = 7 * BLOCK_SIZE
"""That radius over the particle's contact radius."""
MASS = 8 * BLOCK_SIZE
"""Mass of the particle [kg]."""
FRICTION = 9 * BLOCK_SIZE
"""Coulomb friction coefficient."""
ROLLING_FRICTION = 10 * BLOCK_SIZE
"""Rolling friction coefficient."""
ADHESION_FORCE = 11 * BLOCK_SIZE
"""Attractive force between a touching particle and the plate [N]."""
TANGENTIAL_SPRING = 12 * BLOCK_SIZE
"""Elongation of the tangential spring, plate axes [m] (3)."""
SIDE = 15 * BLOCK_SIZE
"""Side of the plate that the particle is on: +1 for that of the normal, else -1."""
NUM_QUANTITIES = 16

# Offsets in the scratch block, in the order in which they are computed; results overwrite input.
RELATIVE_DISPLACEMENT = simd.RELATIVE_DISPLACEMENT * BLOCK_SIZE
"""Gathered: displacement of the particle, map axes [m] (3)."""
RELATIVE_VELOCITY = simd.RELATIVE_VELOCITY * BLOCK_SIZE
"""Gathered: velocity of the particle, map axes [m/s]; then relative to the tool at the centre,
plate axes (3)."""
SURFACE_VELOCITY = simd.SURFACE_VELOCITY_SUM * BLOCK_SIZE
"""Gathered: surface velocity of the particle, map axes [m/s]; then relative to the tool's angular
velocity and at `RADIUS`, plate axes (3)."""
POSITION = 0 * BLOCK_SIZE
"""Centre of the particle now, plate axes [m] (3)."""
POSITION_A, POSITION_B, POSITION_H = POSITION, POSITION + BLOCK_SIZE, POSITION + 2 * BLOCK_SIZE
CURRENT_LEVER_ARM = 9 * BLOCK_SIZE
"""Vector from the tool's origin to the centre, both now, map axes [m] (3)."""
OUTLINE_DISTANCE2 = 12 * BLOCK_SIZE
"""Squared distance in the plane from the plate's outline [m^2]; huge over the plate."""
OUTLINE_OFFSET_A, OUTLINE_OFFSET_B = 13 * BLOCK_SIZE, 14 * BLOCK_SIZE
"""Vector in the plane from the closest point of the plate to the centre [m]."""
FORCE = simd.FORCE * BLOCK_SIZE
"""Out: force on the particle [N], plate axes and then map axes (3)."""
TORQUE_OVER_RADIUS = simd.TORQUE_OVER_RADIUS * BLOCK_SIZE
"""Out: torque on the particle over `RADIUS`, plate axes; then over its contact radius, map axes [N]
(3)."""
ROLLING_LIMIT = simd.ROLLING_LIMIT * BLOCK_SIZE
"""Out: contribution of the contact to the limit of rolling resistance over radius [N]."""
TOOL_TORQUE = 9 * BLOCK_SIZE
"""Out: torque of the contact force about the tool's origin, map axes [N m] (3)."""
ACCELERATION = 15 * BLOCK_SIZE
"""Acceleration of the particle by the forces summed before, along the plate's normal [m/s^2]."""
SCRATCH_SIZE = 16 * BLOCK_SIZE
"""Floats in the scratch block."""

load, store = vector_access(BLOCK_SIZE)
