"""The ground contacts of a step in blocks (see `ground_block`), filled once per step.

The distance of a centre from its tangent plane is computed from the float64 position at the start
of the step; the substeps continue with float32 displacements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts import ground_block as ground
from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.tools.plane import PLANE_NORMAL, signed_distance
from machine_sim.dem.vec3 import load_row, store_row
from msg_bridge.kernels import helper

__all__ = [
    "GroundContactBlocks",
    "allocate_ground_blocks",
    "fill_ground_blocks",
    "store_ground_springs",
]

_ZERO = np.float32(0.0)


class GroundContactBlocks(NamedTuple):
    """Ground contacts of one step, in blocks, in the order in which they are listed.

    Attributes:
        row: row of the particle in each slot, uint32.
        block: quantities, see `ground_block`, float32, shape (blocks, NUM_QUANTITIES * BLOCK_SIZE).
    """

    row: NDArray[np.uint32]
    block: NDArray[np.float32]


def allocate_ground_blocks(count: int) -> GroundContactBlocks:
    """Return blocks for `count` contacts, not filled."""
    num_blocks = -(-count // ground.BLOCK_SIZE)
    return GroundContactBlocks(
        np.zeros(num_blocks * ground.BLOCK_SIZE, np.uint32),
        np.zeros((num_blocks, ground.NUM_QUANTITIES * ground.BLOCK_SIZE), np.float32),
    )


@helper
def fill_ground_blocks(contacts, particles, limited_overlap, blocks):  # type: ignore[no-untyped-def]
    """Copy the listed contacts, with their springs, into blocks.

    Args:
        contacts: `GroundContacts`.
        particles: `ParticleColumns`.
        limited_overlap: overlap above which a penetration-limited contact repels no more [m].
        blocks: out, `GroundContactBlocks`.
    """
    row, plane = contacts.row, contacts.plane
    slot_row, block = blocks.row, blocks.block
    position, contact_radius = particles.position, particles.contact_radius
    mass, spring = particles.mass, particles.ground_spring
    penetration_limited = particles.penetration_limited
    max_limited_overlap = np.float32(limited_overlap)
    for c in range(row.size):
        i = row[c]
        b, s = block[c // ground.BLOCK_SIZE], c % ground.BLOCK_SIZE
        slot_row[c] = i
        radius = contact_radius[i]
        ground.store(b, ground.NORMAL, s, load_row(plane, c, PLANE_NORMAL))
        b[ground.DISTANCE + s] = signed_distance(plane[c], *load_row(position, i, 0))
        b[ground.RADIUS + s] = radius
        # The overlap is limited to one radius: deeper ones are for `ground_recovery`.
        b[ground.MAX_OVERLAP + s] = (
            min(radius, max_limited_overlap) if penetration_limited[i] else radius
        )
        b[ground.MASS + s] = mass[i]
        ground.store(b, ground.TANGENTIAL_SPRING, s, load_row(spring, i, 0))
        ground.store(b, ground.GROUND_VELOCITY, s, load_row(contacts.velocity, c, 0))
    # The last group is padded with copies of the last contact that exert no force.
    count = row.size
    while count % GROUP_SIZE != 0:
        slot_row[count] = slot_row[count - 1]
        b, s = block[count // ground.BLOCK_SIZE], count % ground.BLOCK_SIZE
        for q in range(ground.NUM_QUANTITIES):
            b[q * ground.BLOCK_SIZE + s] = b[q * ground.BLOCK_SIZE + s - 1]
        b[ground.MASS + s] = _ZERO
        count += 1


@helper
def store_ground_springs(row, block, spring):  # type: ignore[no-untyped-def]
    """Write the springs back to the particles, from which the next step takes them.

    Args:
        row: rows of the listed contacts.
        block: quantities of the blocks.
        spring: out, `ParticleState.ground_spring`.
    """
    for c in range(row.size):
        b, s = block[c // ground.BLOCK_SIZE], c % ground.BLOCK_SIZE
        store_row(spring, row[c], 0, ground.load(b, ground.TANGENTIAL_SPRING, s))
