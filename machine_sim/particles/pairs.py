"""Forces between particles, block by block: gather, contact maths, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.particles.contacts import BLOCK, BOND_GAP
from machine_sim.particles.jit import kernel
from machine_sim.particles.law import contact_force

__all__ = ["pair_forces", "pair_overlap"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TINY_LENGTH2 = np.float32(1e-18)


@kernel
def _block_maths(n, b, law):  # type: ignore[no-untyped-def]
    """Contacts of a block: from motion (quantities 12 to 20) to forces in the same place.

    In: displacement (12-14), velocity (15-17) of the second relative to the first, and the sum of
    spin times radius (18-20). Out: force on the second (12-14), torque per radius on both (15-17),
    share of the rolling limit (18).
    """
    for s in range(np.uint64(n)):
        dx = b[s] + b[s + 12 * BLOCK]
        dy = b[s + BLOCK] + b[s + 13 * BLOCK]
        dz = b[s + 2 * BLOCK] + b[s + 14 * BLOCK]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz + _TINY_LENGTH2)
        inverse = _ONE / distance
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        reach = b[s + 3 * BLOCK]
        # What holds two together fades over a small gap.
        hold = min(max(_ONE + (reach - distance) / (BOND_GAP * reach), _ZERO), _ONE)
        overlap = min(reach - distance, b[s + 8 * BLOCK])
        touches = _ONE if overlap > _ZERO else _ZERO
        ax, ay, az = b[s + 18 * BLOCK], b[s + 19 * BLOCK], b[s + 20 * BLOCK]
        push, gx, gy, gz, sx, sy, sz = contact_force(
            law, b[s + 5 * BLOCK], overlap, nx, ny, nz,
            b[s + 15 * BLOCK] - (ay * nz - az * ny),
            b[s + 16 * BLOCK] - (az * nx - ax * nz),
            b[s + 17 * BLOCK] - (ax * ny - ay * nx),
            b[s + 9 * BLOCK], b[s + 10 * BLOCK], b[s + 11 * BLOCK],
        )  # fmt: skip
        b[s + 9 * BLOCK] = sx * touches
        b[s + 10 * BLOCK] = sy * touches
        b[s + 11 * BLOCK] = sz * touches
        mass = b[s + 4 * BLOCK] * touches
        push *= mass
        gx *= mass
        gy *= mass
        gz *= mass
        normal = push - b[s + 7 * BLOCK] * hold
        b[s + 12 * BLOCK] = normal * nx + gx
        b[s + 13 * BLOCK] = normal * ny + gy
        b[s + 14 * BLOCK] = normal * nz + gz
        b[s + 15 * BLOCK] = gy * nz - gz * ny
        b[s + 16 * BLOCK] = gz * nx - gx * nz
        b[s + 17 * BLOCK] = gx * ny - gy * nx
        b[s + 18 * BLOCK] = push * b[s + 6 * BLOCK]


@kernel
def pair_forces(begin, size, first, second, block, body, total, law):  # type: ignore[no-untyped-def]
    """Add the contact forces of the contacts in some slots to `total`.

    Args:
        begin, size: first slot, that of a block, and how many.
        first, second, block: of `ContactTable`; springs are updated.
        body, total: see `bodies`. The sum of a body that cannot move has no meaning.
        law: contact law.
    """
    for at in range(begin, begin + size, BLOCK):
        b = block[at // BLOCK]
        n = min(begin + size - at, BLOCK)
        for s in range(n):
            i, j = first[at + s], second[at + s]
            b[s + 12 * BLOCK] = body[j, 0] - body[i, 0]
            b[s + 13 * BLOCK] = body[j, 1] - body[i, 1]
            b[s + 14 * BLOCK] = body[j, 2] - body[i, 2]
            b[s + 15 * BLOCK] = body[j, 4] - body[i, 4]
            b[s + 16 * BLOCK] = body[j, 5] - body[i, 5]
            b[s + 17 * BLOCK] = body[j, 6] - body[i, 6]
            ri, rj = body[i, 3], body[j, 3]
            b[s + 18 * BLOCK] = ri * body[i, 8] + rj * body[j, 8]
            b[s + 19 * BLOCK] = ri * body[i, 9] + rj * body[j, 9]
            b[s + 20 * BLOCK] = ri * body[i, 10] + rj * body[j, 10]
        _block_maths(n, b, law)
        for s in range(n):
            i, j = first[at + s], second[at + s]
            fx, fy, fz = b[s + 12 * BLOCK], b[s + 13 * BLOCK], b[s + 14 * BLOCK]
            tx, ty, tz = b[s + 15 * BLOCK], b[s + 16 * BLOCK], b[s + 17 * BLOCK]
            limit = b[s + 18 * BLOCK]
            ri, rj = body[i, 3], body[j, 3]
            total[i, 0] -= fx
            total[i, 1] -= fy
            total[i, 2] -= fz
            total[i, 3] += limit
            total[i, 4] += ri * tx
            total[i, 5] += ri * ty
            total[i, 6] += ri * tz
            total[i, 8] += limit * body[j, 8]
            total[i, 9] += limit * body[j, 9]
            total[i, 10] += limit * body[j, 10]
            total[j, 0] += fx
            total[j, 1] += fy
            total[j, 2] += fz
            total[j, 3] += limit
            total[j, 4] += rj * tx
            total[j, 5] += rj * ty
            total[j, 6] += rj * tz
            total[j, 8] += limit * body[i, 8]
            total[j, 9] += limit * body[i, 9]
            total[j, 10] += limit * body[i, 10]


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
