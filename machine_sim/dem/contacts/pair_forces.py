"""Forces between particles, block by block: gather, contact maths, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts.contact_law import contact_force, contact_force_and_moment
from machine_sim.dem.contacts.pair_contacts import BLOCK_SIZE, BOND_RUPTURE_GAP
from machine_sim.dem.contacts.simd import GROUP_SIZE, gather_relative_motion, scatter_forces
from msg_bridge.kernels import kernel

__all__ = ["max_pair_overlap", "pair_forces"]

_NUM_SCRATCH_QUANTITIES = 9
"""Quantities of a contact that are needed only within a substep: one block of them serves all, and
stays in the first-level cache."""

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TINY_LENGTH2 = np.float32(1e-18)


@kernel
def _evaluate_contacts(n, b, w, contact_params):  # type: ignore[no-untyped-def]
    """Contacts of a block `b`: from motion to forces, in the scratch block `w`.

    In: displacement (0-2), velocity (3-5) of the second relative to the first, and the sum of
    their surface speeds (6-8). Out: force on the second (0-2), turning force on both (3-5), share
    of the rolling limit (6).
    """
    for s in range(np.uint64(n)):
        dx = b[s] + w[s]
        dy = b[s + BLOCK_SIZE] + w[s + BLOCK_SIZE]
        dz = b[s + 2 * BLOCK_SIZE] + w[s + 2 * BLOCK_SIZE]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz + _TINY_LENGTH2)
        inverse = _ONE / distance
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        reach = b[s + 3 * BLOCK_SIZE]
        # What holds two together fades over a small gap.
        cohesion_force = min(
            max(_ONE + (reach - distance) / (BOND_RUPTURE_GAP * reach), _ZERO), _ONE
        )
        overlap = min(reach - distance, b[s + 8 * BLOCK_SIZE])
        touches = _ONE if overlap > _ZERO else _ZERO
        ax, ay, az = w[s + 6 * BLOCK_SIZE], w[s + 7 * BLOCK_SIZE], w[s + 8 * BLOCK_SIZE]
        normal_force, gx, gy, gz, sx, sy, sz = contact_force(
            contact_params, b[s + 5 * BLOCK_SIZE], overlap, nx, ny, nz,
            w[s + 3 * BLOCK_SIZE] - (ay * nz - az * ny),
            w[s + 4 * BLOCK_SIZE] - (az * nx - ax * nz),
            w[s + 5 * BLOCK_SIZE] - (ax * ny - ay * nx),
            b[s + 9 * BLOCK_SIZE], b[s + 10 * BLOCK_SIZE], b[s + 11 * BLOCK_SIZE],
        )  # fmt: skip
        b[s + 9 * BLOCK_SIZE] = sx * touches
        b[s + 10 * BLOCK_SIZE] = sy * touches
        b[s + 11 * BLOCK_SIZE] = sz * touches
        fx, fy, fz, tx, ty, tz, normal_force = contact_force_and_moment(
            b[s + 4 * BLOCK_SIZE] * touches,
            b[s + 7 * BLOCK_SIZE] * cohesion_force,
            normal_force,
            gx,
            gy,
            gz,
            nx,
            ny,
            nz,
        )
        w[s], w[s + BLOCK_SIZE], w[s + 2 * BLOCK_SIZE] = fx, fy, fz
        w[s + 3 * BLOCK_SIZE], w[s + 4 * BLOCK_SIZE], w[s + 5 * BLOCK_SIZE] = tx, ty, tz
        w[s + 6 * BLOCK_SIZE] = normal_force * b[s + 6 * BLOCK_SIZE]


@kernel
def pair_forces(begin, size, contacts, body, force_sums, contact_params):  # type: ignore[no-untyped-def]
    """Add the contact forces of the contacts in some slots to `total`.

    Args:
        begin, size: first slot, that of a block, and how many.
        contacts: `PairContactBlocks`; springs are updated.
        body, total: see `bodies`. The sum of a body that cannot move has no meaning.
        law: contact law.
    """
    first, second, block = contacts.first, contacts.second, contacts.block
    w = np.empty(_NUM_SCRATCH_QUANTITIES * BLOCK_SIZE, np.float32)
    for at in range(begin, begin + size, BLOCK_SIZE):
        b = block[at // BLOCK_SIZE]
        n = (min(begin + size - at, BLOCK_SIZE) + GROUP_SIZE - 1) // GROUP_SIZE * GROUP_SIZE
        for s in range(0, n, GROUP_SIZE):
            gather_relative_motion(body, first, second, at + s, w, BLOCK_SIZE, s)
        _evaluate_contacts(n, b, w, contact_params)
        for s in range(0, n, GROUP_SIZE):
            scatter_forces(body, force_sums, first, second, at + s, w, BLOCK_SIZE, s)


@kernel
def max_pair_overlap(first, second, count, position, contact_radius):  # type: ignore[no-untyped-def]
    """Largest overlap of a listed pair as a fraction of its smaller contact radius."""
    largest = 0.0
    for k in range(count):
        i, j = first[k], second[k]
        dx = position[j, 0] - position[i, 0]
        dy = position[j, 1] - position[i, 1]
        dz = position[j, 2] - position[i, 2]
        ri, rj = contact_radius[i], contact_radius[j]
        overlap = (ri + rj - np.sqrt(dx * dx + dy * dy + dz * dz)) / min(ri, rj)
        largest = max(largest, overlap)
    return largest
