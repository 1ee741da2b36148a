"""Forces of the ground on particles in a substep, block by block: gather, evaluate, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts import ground_block as ground
from machine_sim.dem.contacts.contact_law import contact_force, contact_force_and_torque
from machine_sim.dem.contacts.simd import (
    GROUP_SIZE,
    VECTOR_SIZE,
    add_forces,
    gather_motion,
    round_up,
)
from machine_sim.dem.vec3 import cross, dot, scale, subtract
from msg_bridge.kernels import helper

__all__ = ["ground_forces"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)


@helper(forceinline=True)
def ground_forces(  # type: ignore[no-untyped-def]
    begin, end, blocks, body, force_sums, params, friction, rolling_friction, scratch
):
    """Add the forces of a range of ground contacts to the sums of their particles.

    Args:
        begin, end: first contact of the range, which begins a block, and the end, excluded.
        blocks: `GroundContactBlocks`; springs are updated.
        body, force_sums: see `body_records`.
        params: `ContactParameters`.
        friction, rolling_friction: coefficients at the ground.
        scratch: a scratch block, see `ground_block`.
    """
    row = blocks.row
    for at in range(begin, end, ground.BLOCK_SIZE):
        block = blocks.block[at // ground.BLOCK_SIZE]
        num_slots = round_up(min(end - at, ground.BLOCK_SIZE), GROUP_SIZE)
        for s in range(0, num_slots, GROUP_SIZE):
            gather_motion(body, row, at + s, scratch, ground.BLOCK_SIZE, s)
        num_evaluated = round_up(num_slots, VECTOR_SIZE)
        _evaluate_contacts(num_evaluated, block, scratch, params, friction, rolling_friction)
        for s in range(0, num_slots, GROUP_SIZE):
            add_forces(force_sums, row, at + s, scratch, ground.BLOCK_SIZE, s)


@helper
def _evaluate_contacts(num_slots, block, scratch, params, friction, rolling_friction):  # type: ignore[no-untyped-def]
    """Replace the motion in `scratch` by forces, and update the springs in `block`."""
    for s in range(np.uint64(num_slots)):
        normal = ground.load(block, ground.NORMAL, s)
        travel = dot(normal, ground.load(scratch, ground.DISPLACEMENT, s))
        overlap = block[ground.RADIUS + s] - (block[ground.DISTANCE + s] + travel)
        overlap = min(overlap, block[ground.MAX_OVERLAP + s])
        touches = _ONE if overlap > _ZERO else _ZERO
        contact_velocity = subtract(
            subtract(
                ground.load(scratch, ground.VELOCITY, s),
                ground.load(block, ground.GROUND_VELOCITY, s),
            ),
            cross(ground.load(scratch, ground.SURFACE_VELOCITY, s), normal),
        )
        normal_force, friction_force, spring = contact_force(
            params, friction, overlap, normal, contact_velocity,
            ground.load(block, ground.TANGENTIAL_SPRING, s),
        )  # fmt: skip
        ground.store(block, ground.TANGENTIAL_SPRING, s, scale(spring, touches))
        force, torque_over_radius, normal_force = contact_force_and_torque(
            block[ground.MASS + s] * touches, _ZERO, normal_force, friction_force, normal
        )
        ground.store(scratch, ground.FORCE, s, force)
        ground.store(scratch, ground.TORQUE_OVER_RADIUS, s, torque_over_radius)
        scratch[ground.ROLLING_LIMIT + s] = normal_force * rolling_friction
