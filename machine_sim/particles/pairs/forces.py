"""Forces between particles, block by block: gather, contact maths, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.jit import kernel
from machine_sim.particles.law import contact_force, contact_sums
from machine_sim.particles.pairs.contacts import BLOCK, BOND_GAP
from machine_sim.particles.pairs.simd import GROUP, gather_motion, scatter_forces

__all__ = ["pair_forces", "pair_overlap"]

_SCRATCH = 9
"""Quantities of a contact that are needed only within a substep: one block of them serves all, and
stays in the first-level cache."""

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TINY_LENGTH2 = np.float32(1e-18)


@kernel
def _block_maths(n, b, w, law):  # type: ignore[no-untyped-def]
    """Contacts of a block `b`: from motion to forces, in the scratch block `w`.

    In: displacement (0-2), velocity (3-5) of the second relative to the first, and the sum of
    their surface speeds (6-8). Out: force on the second (0-2), turning force on both (3-5), share
    of the rolling limit (6).
    """
    for s in range(np.uint64(n)):
        dx = b[s] + w[s]
        dy = b[s + BLOCK] + w[s + BLOCK]
        dz = b[s + 2 * BLOCK] + w[s + 2 * BLOCK]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz + _TINY_LENGTH2)
        inverse = _ONE / distance
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        reach = b[s + 3 * BLOCK]
        # What holds two together fades over a small gap.
        hold = min(max(_ONE + (reach - distance) / (BOND_GAP * reach), _ZERO), _ONE)
        overlap = min(reach - distance, b[s + 8 * BLOCK])
        touches = _ONE if overlap > _ZERO else _ZERO
        ax, ay, az = w[s + 6 * BLOCK], w[s + 7 * BLOCK], w[s + 8 * BLOCK]
        push, gx, gy, gz, sx, sy, sz = contact_force(
            law, b[s + 5 * BLOCK], overlap, nx, ny, nz,
            w[s + 3 * BLOCK] - (ay * nz - az * ny),
            w[s + 4 * BLOCK] - (az * nx - ax * nz),
            w[s + 5 * BLOCK] - (ax * ny - ay * nx),
            b[s + 9 * BLOCK], b[s + 10 * BLOCK], b[s + 11 * BLOCK],
        )  # fmt: skip
        b[s + 9 * BLOCK] = sx * touches
        b[s + 10 * BLOCK] = sy * touches
        b[s + 11 * BLOCK] = sz * touches
        fx, fy, fz, tx, ty, tz, push = contact_sums(
            b[s + 4 * BLOCK] * touches, b[s + 7 * BLOCK] * hold, push, gx, gy, gz, nx, ny, nz
        )
        w[s], w[s + BLOCK], w[s + 2 * BLOCK] = fx, fy, fz
        w[s + 3 * BLOCK], w[s + 4 * BLOCK], w[s + 5 * BLOCK] = tx, ty, tz
        w[s + 6 * BLOCK] = push * b[s + 6 * BLOCK]


@kernel
def pair_forces(begin, size, contacts, body, total, law):  # type: ignore[no-untyped-def]
    """Add the contact forces of the contacts in some slots to `total`.

    Args:
        begin, size: first slot, that of a block, and how many.
        contacts: `ContactBlocks`; springs are updated.
        body, total: see `bodies`. The sum of a body that cannot move has no meaning.
        law: contact law.
    """
    first, second, block = contacts.first, contacts.second, contacts.block
    w = np.empty(_SCRATCH * BLOCK, np.float32)
    for at in range(begin, begin + size, BLOCK):
        b = block[at // BLOCK]
        n = (min(begin + size - at, BLOCK) + GROUP - 1) // GROUP * GROUP
        for s in range(0, n, GROUP):
            gather_motion(body, first, second, at + s, w, BLOCK, s)
        _block_maths(n, b, w, law)
        for s in range(0, n, GROUP):
            scatter_forces(body, total, first, second, at + s, w, BLOCK, s)


@kernel
def pair_overlap(first, second, count, position, contact_radius):  # type: ignore[no-untyped-def]
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
