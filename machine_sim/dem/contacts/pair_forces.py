"""Contact forces between particles, block by block: gather motion, evaluate the law, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts import pair_block as pair
from machine_sim.dem.contacts.contact_law import contact_force, contact_force_and_torque
from machine_sim.dem.contacts.simd import (
    GROUP_SIZE,
    VECTOR_SIZE,
    gather_relative_motion,
    round_up,
    scatter_forces,
)
from machine_sim.dem.vec3 import add, cross, dot, load_row, scale, subtract
from msg_bridge.kernels import helper, kernel

__all__ = ["BOND_RUPTURE_GAP", "max_pair_overlap", "pair_forces"]

BOND_RUPTURE_GAP = np.float32(0.03)
"""Gap at which the liquid bridge between two particles breaks, in sums of contact radii."""

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_INVERSE_RUPTURE_GAP = np.float32(1.0 / BOND_RUPTURE_GAP)
_TINY_LENGTH2 = np.float32(1e-18)


@helper(forceinline=True)
def pair_forces(begin, size, contacts, body, force_sums, contact_params, scratch):  # type: ignore[no-untyped-def]
    """Add the forces of a range of pair contacts to the sums of their particles.

    Args:
        begin, size: first slot of the range, which begins a block, and number of contacts.
        contacts: `PairContactBlocks`; the tangential springs are updated.
        body, force_sums: see `body_records`. The sums of a particle that cannot move are
            meaningless.
        contact_params: `ContactParameters`.
        scratch: a scratch block, see `pair_block`.
    """
    first, second = contacts.first, contacts.second
    for at in range(begin, begin + size, pair.BLOCK_SIZE):
        block = contacts.block[at // pair.BLOCK_SIZE]
        num_slots = round_up(min(begin + size - at, pair.BLOCK_SIZE), GROUP_SIZE)
        for s in range(0, num_slots, GROUP_SIZE):
            gather_relative_motion(body, first, second, at + s, scratch, pair.BLOCK_SIZE, s)
        _evaluate_contacts(round_up(num_slots, VECTOR_SIZE), block, scratch, contact_params)
        for s in range(0, num_slots, GROUP_SIZE):
            scatter_forces(body, force_sums, first, second, at + s, scratch, pair.BLOCK_SIZE, s)


@helper
def _evaluate_contacts(num_slots, block, scratch, contact_params):  # type: ignore[no-untyped-def]
    """Replace the relative motion in `scratch` by forces, and update the springs in `block`.

    Args:
        num_slots: number of slots to evaluate, from the first one on.
        block: block of pair contacts, flat, float32; layout and units in `pair_block`.
        scratch: scratch block, flat, float32; in: relative
            displacement [m] and velocity, and sum of the surface velocities [m/s]; out: force,
            torque over radius and rolling limit [N].
        contact_params: `ContactParameters`.
    """
    for s in range(np.uint64(num_slots)):
        separation = add(
            pair.load(block, pair.SEPARATION, s),
            pair.load(scratch, pair.RELATIVE_DISPLACEMENT, s),
        )
        distance = np.sqrt(dot(separation, separation) + _TINY_LENGTH2)
        normal = scale(separation, _ONE / distance)
        radius_sum = block[pair.RADIUS_SUM + s]
        relative_gap = (distance - radius_sum) / radius_sum
        # The cohesion force decreases linearly over a small gap.
        bond_fraction = min(max(_ONE - relative_gap * _INVERSE_RUPTURE_GAP, _ZERO), _ONE)
        # The centres are nearer than the sum of the radii: with lever arms of the whole radii,
        # friction would turn the bodies by more than the moment of the two forces.
        arm_over_radius = min(_ONE + relative_gap, _ONE)
        overlap = min(radius_sum - distance, block[pair.MAX_OVERLAP + s])
        touches = _ONE if overlap > _ZERO else _ZERO
        contact_velocity = subtract(
            pair.load(scratch, pair.RELATIVE_VELOCITY, s),
            cross(scale(pair.load(scratch, pair.SURFACE_VELOCITY_SUM, s), arm_over_radius), normal),
        )
        normal_force, friction_force, spring = contact_force(
            contact_params, block[pair.FRICTION + s], overlap, normal, contact_velocity,
            pair.load(block, pair.TANGENTIAL_SPRING, s),
        )  # fmt: skip
        pair.store(block, pair.TANGENTIAL_SPRING, s, scale(spring, touches))
        force, torque_over_radius, normal_force = contact_force_and_torque(
            block[pair.EFFECTIVE_MASS + s] * touches,
            block[pair.COHESION_FORCE + s] * bond_fraction,
            normal_force,
            friction_force,
            normal,
        )
        pair.store(scratch, pair.FORCE, s, force)
        torque_over_radius = scale(torque_over_radius, arm_over_radius)
        pair.store(scratch, pair.TORQUE_OVER_RADIUS, s, torque_over_radius)
        scratch[pair.ROLLING_LIMIT + s] = normal_force * block[pair.ROLLING_FRICTION + s]


@kernel
def max_pair_overlap(first, second, count, position, contact_radius):  # type: ignore[no-untyped-def]
    """Return the largest overlap of a listed pair as a fraction of its smaller contact radius.

    Args:
        first, second: rows of the particles of each pair, shape (pairs,) or longer.
        count: number of pairs.
        position: centres of the particles, map frame [m], shape (particles, 3).
        contact_radius: radii that contacts use [m], shape (particles,).
    """
    largest = 0.0
    for k in range(count):
        i, j = first[k], second[k]
        separation = subtract(load_row(position, j, 0), load_row(position, i, 0))
        ri, rj = contact_radius[i], contact_radius[j]
        overlap = (ri + rj - np.sqrt(dot(separation, separation))) / min(ri, rj)
        largest = max(largest, overlap)
    return largest
