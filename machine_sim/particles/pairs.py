"""Forces between particles, in batches: gather the touching pairs, contact maths, scatter.

The maths runs over one flat buffer in which quantity q of slot s lies at `q * BATCH + s`. The
constant distance between quantities lets the compiler prove that they do not overlap, and it
vectorises the loop (float32, 8 or 16 pairs at once).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.jit import kernel
from machine_sim.particles.law import contact_force

__all__ = ["BATCH", "pair_buffer", "pair_forces", "pair_overlap"]

BATCH = 256
"""Pairs per batch: 12 KB of buffer, inside the first-level cache."""

_QUANTITIES = 12
_ONE = np.float32(1.0)
_TINY_MASS = np.float32(1e-12)
_TINY_LENGTH2 = np.float32(1e-18)
_OVERLAP_CAP = np.float32(1.0)  # of the smaller radius: bounds the force of a forced overlap


def pair_buffer() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Scratch memory of `pair_forces`: floats and pair numbers of a batch."""
    return np.zeros(_QUANTITIES * BATCH, np.float32), np.zeros(BATCH, np.uint32)


@kernel
def _batch_maths(n, b, law, friction):  # type: ignore[no-untyped-def]
    """In: separation, relative velocity, spring, 1/m sum, reach, cap. Out: force, spring."""
    for q in range(np.uint64(n)):
        dx, dy, dz = b[q], b[q + BATCH], b[q + 2 * BATCH]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz + _TINY_LENGTH2)
        inverse = _ONE / distance
        overlap = min(b[q + 10 * BATCH] - distance, b[q + 11 * BATCH])
        fx, fy, fz, sx, sy, sz = contact_force(
            law,
            friction,
            overlap,
            dx * inverse,
            dy * inverse,
            dz * inverse,
            b[q + 3 * BATCH],
            b[q + 4 * BATCH],
            b[q + 5 * BATCH],
            b[q + 6 * BATCH],
            b[q + 7 * BATCH],
            b[q + 8 * BATCH],
        )
        mass = _ONE / b[q + 9 * BATCH]
        b[q] = fx * mass
        b[q + BATCH] = fy * mass
        b[q + 2 * BATCH] = fz * mass
        b[q + 6 * BATCH] = sx
        b[q + 7 * BATCH] = sy
        b[q + 8 * BATCH] = sz


@kernel
def pair_forces(  # type: ignore[no-untyped-def]
    first,
    second,
    count,
    touching,
    spring,
    position,
    velocity,
    inverse_mass,
    contact_radius,
    force,
    buffer,
    slots,
    law,
    friction,
):
    """Add the contact forces of all listed pairs to `force`.

    Args:
        first, second: rows of each pair, uint32 (unsigned: no wrap-around test when indexing).
        count: number of pairs.
        touching: per pair, 1 if it touched in the last substep; updated.
        spring: tangential spring [m], shape (pairs, 3); valid while touching; updated.
        position, velocity: [m], [m/s], shape (n, 3).
        inverse_mass: [1/kg], 0 for a body that cannot move, shape (n,).
        contact_radius: [m], shape (n,).
        force: [N], shape (n, 3), float32; added to. That of an immovable body has no meaning.
        buffer, slots: scratch of `pair_buffer`.
        law, friction: contact law and Coulomb coefficient.
    """
    start = 0
    while start < count:
        # Fill a batch without branches: the slot is written always, and kept if the pair touches.
        n = np.uint64(0)
        k = start
        while k < count and n < BATCH:
            pair = np.uint32(k)
            i, j = first[pair], second[pair]
            dx = np.float32(position[j, 0] - position[i, 0])
            dy = np.float32(position[j, 1] - position[i, 1])
            dz = np.float32(position[j, 2] - position[i, 2])
            ri, rj = contact_radius[i], contact_radius[j]
            reach = ri + rj
            buffer[n] = dx
            buffer[n + BATCH] = dy
            buffer[n + 2 * BATCH] = dz
            buffer[n + 10 * BATCH] = reach
            buffer[n + 11 * BATCH] = _OVERLAP_CAP * min(ri, rj)
            slots[n] = pair
            touches = np.uint8(dx * dx + dy * dy + dz * dz < reach * reach)
            touching[pair] = ((touching[pair] << np.uint8(1)) & np.uint8(2)) | touches
            n += np.uint64(touches)
            k += 1
        start = k
        for q in range(n):
            pair = slots[q]
            i, j = first[pair], second[pair]
            held = np.float32(touching[pair] >> np.uint8(1))
            buffer[q + 3 * BATCH] = velocity[j, 0] - velocity[i, 0]
            buffer[q + 4 * BATCH] = velocity[j, 1] - velocity[i, 1]
            buffer[q + 5 * BATCH] = velocity[j, 2] - velocity[i, 2]
            buffer[q + 6 * BATCH] = spring[pair, 0] * held
            buffer[q + 7 * BATCH] = spring[pair, 1] * held
            buffer[q + 8 * BATCH] = spring[pair, 2] * held
            buffer[q + 9 * BATCH] = max(inverse_mass[i] + inverse_mass[j], _TINY_MASS)
        _batch_maths(n, buffer, law, friction)
        for q in range(n):
            pair = slots[q]
            i, j = first[pair], second[pair]
            spring[pair, 0] = buffer[q + 6 * BATCH]
            spring[pair, 1] = buffer[q + 7 * BATCH]
            spring[pair, 2] = buffer[q + 8 * BATCH]
            fx, fy, fz = buffer[q], buffer[q + BATCH], buffer[q + 2 * BATCH]
            force[i, 0] -= fx
            force[i, 1] -= fy
            force[i, 2] -= fz
            force[j, 0] += fx
            force[j, 1] += fy
            force[j, 2] += fz


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
