"""The contacts of one step: listed pairs that may touch in it, laid out for the compiler.

Listed pairs are many and most do not touch. Once a step those that may are copied into blocks; in
a block, quantity q of slot s lies at `q * BLOCK + s`. The constant distance between quantities
lets the compiler prove that they do not overlap, and it vectorises the contact maths (float32, 8
or 16 pairs at once). Separations are taken from float64 positions here, so that the substeps can
go on in float32 displacements.

The contacts of each part of the pair list (see `parts`) have blocks of their own.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.particles.jit import kernel, threaded_kernel
from machine_sim.particles.neighbours import PairTable
from machine_sim.particles.store import ParticleStore

__all__ = ["BLOCK", "BOND_GAP", "ContactTable"]

BLOCK = 128
"""Contacts in a block: 6 KB, inside the first-level cache."""

QUANTITIES = 12
"""Separation (3), reach, effective mass, friction, rolling friction, bond, cap of the overlap,
spring (3)."""

_BOND_AREA = np.float32(np.pi)
_HORIZON = np.float32(1.4)
"""How far ahead contacts are looked for, in steps: one, and room for acceleration."""
BOND_GAP = np.float32(0.03)
"""Gap at which two particles hold together no more, in sums of radii: a bridge of wet soil."""
_SLACK = BOND_GAP
"""The least distance ahead, in sums of radii."""


class ContactTable:
    """Contacts of one step.

    Attributes:
        first, second: rows of each contact, uint32.
        entry: where in the pair table its spring is kept.
        block: quantities, shape (blocks, QUANTITIES * BLOCK), float32.
        begin, size: first slot of each part, a whole number of blocks, and its contacts.
    """

    def __init__(self) -> None:
        self.begin = np.zeros(1, np.int64)
        self.size = np.zeros(1, np.int64)
        self._bounds = np.zeros(2, np.int64)
        self._ahead = np.zeros(0, np.float32)
        self._room(32)

    @property
    def count(self) -> int:
        """Number of contacts."""
        return int(self.size.sum())

    def _room(self, blocks: int) -> None:
        self.first = np.zeros(blocks * BLOCK, np.uint32)
        self.second = np.zeros(blocks * BLOCK, np.uint32)
        self.entry = np.zeros(blocks * BLOCK, np.uint32)
        self.block = np.zeros((blocks, QUANTITIES * BLOCK), np.float32)

    def collect(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, moving, alone: bool, body, pairs: PairTable, dt: float,
        threads: int,
    ) -> None:  # fmt: skip
        """Take over the pairs that may touch within `dt` [s], with their springs.

        Args:
            store: the particles.
            moving: rows that move.
            alone: whether these are all.
            body: records of all rows.
            pairs: where they are listed.
            dt: [s].
            threads: how many work at it.
        """
        if len(self._ahead) < store.count:
            self._ahead = np.zeros(2 * store.count, np.float32)
        if self._bounds is not pairs.bounds:
            self._lay_out(pairs.bounds)
        _look_ahead(
            np.float32(dt), moving, alone, self._ahead, pairs.first, pairs.second, pairs.count, body
        )
        _collect.on(threads)(
            np.float32(dt), self._ahead, pairs.first, pairs.second, pairs.bounds, pairs.touching,
            pairs.spring, store.position, body,
            self.first, self.second, self.entry, self.block, self.begin, self.size,
        )  # fmt: skip

    def _lay_out(self, bounds: NDArray[np.int64]) -> None:
        """Give each part of the pair list blocks enough for all of its pairs."""
        blocks = (np.diff(bounds) + BLOCK - 1) // BLOCK
        self.begin = BLOCK * (np.cumsum(blocks) - blocks)
        self.size = np.zeros(len(blocks), np.int64)
        if int(blocks.sum()) > len(self.block):
            self._room(2 * int(blocks.sum()))
        self._bounds = bounds

    def give_back(self, pairs: PairTable, threads: int) -> None:
        """Keep the springs in the pair table until the next step."""
        _give_back.on(threads)(
            self.begin, self.size, self.entry, self.block, pairs.touching, pairs.spring
        )


@kernel
def _look_ahead(dt, moving, alone, ahead, pair_first, pair_second, pairs, body):  # type: ignore[no-untyped-def]
    """Fill `ahead`: how far each comes toward another in `dt`, its own size included [m].

    Relative to the mean where all move, so that what moves together does not count as closing in.
    """
    mean = np.zeros(3, np.float32)
    if alone:
        for i in moving:
            for axis in range(3):
                mean[axis] += body[i, 4 + axis]
        for axis in range(3):
            mean[axis] /= np.float32(moving.size)
    else:
        for k in range(pairs):
            i, j = pair_first[k], pair_second[k]
            ahead[i] = body[i, 3] * (np.float32(1.0) + _SLACK)
            ahead[j] = body[j, 3] * (np.float32(1.0) + _SLACK)
    for i in moving:
        x, y, z = body[i, 4] - mean[0], body[i, 5] - mean[1], body[i, 6] - mean[2]
        ahead[i] = body[i, 3] * (np.float32(1.0) + _SLACK) + _HORIZON * dt * np.sqrt(
            x * x + y * y + z * z
        )


@threaded_kernel
def _collect(  # type: ignore[no-untyped-def]
    dt, ahead, pair_first, pair_second, bounds, touching, pair_spring, position, body,
    first, second, entry, block, begin, size,
):  # fmt: skip
    """Fill the table, part by part."""
    for part in prange(begin.size):
        size[part] = _collect_part(
            dt, ahead, pair_first, pair_second, bounds[part], bounds[part + 1], touching,
            pair_spring, position, body, first, second, entry, block, begin[part],
        )  # fmt: skip


@kernel
def _collect_part(  # type: ignore[no-untyped-def]
    dt, ahead, pair_first, pair_second, low, high, touching, pair_spring, position, body,
    first, second, entry, block, begin,
):  # fmt: skip
    """Copy those of the pairs from `low` to `high` that may touch to the slots from `begin` on.

    Returns:
        How many.
    """
    count = begin
    for k in range(low, high):
        i, j = pair_first[k], pair_second[k]
        weight = body[i, 7] + body[j, 7]
        if weight == np.float32(0.0):
            continue  # both rest: the spring is kept for when they wake
        x = np.float32(position[j, 0] - position[i, 0])
        y = np.float32(position[j, 1] - position[i, 1])
        z = np.float32(position[j, 2] - position[i, 2])
        near = ahead[i] + ahead[j]
        square = x * x + y * y + z * z
        if square >= near * near:
            touching[k] = 0
            continue
        ri, rj = body[i, 3], body[j, 3]
        reach = ri + rj
        if square > reach * reach:
            # Near, and some of these do not close in.
            vx = body[j, 4] - body[i, 4]
            vy = body[j, 5] - body[i, 5]
            vz = body[j, 6] - body[i, 6]
            closing = -(vx * x + vy * y + vz * z)
            way = max(closing, np.float32(0.0)) * _HORIZON * dt
            distance = np.sqrt(square)
            if (distance - reach * (np.float32(1.0) + _SLACK)) * distance > way:
                touching[k] = 0
                continue
        first[count], second[count], entry[count] = i, j, k
        b = block[count // BLOCK]
        s = count % BLOCK
        least = min(ri, rj)
        b[s], b[s + BLOCK], b[s + 2 * BLOCK] = x, y, z
        b[s + 3 * BLOCK] = reach
        b[s + 4 * BLOCK] = np.float32(1.0) / weight
        # Of two soils the weaker gives way.
        b[s + 5 * BLOCK] = min(body[i, 11], body[j, 11])
        b[s + 6 * BLOCK] = min(body[i, 12], body[j, 12])
        b[s + 7 * BLOCK] = _BOND_AREA * least * least * min(body[i, 13], body[j, 13])
        b[s + 8 * BLOCK] = least
        held = np.float32(touching[k])
        for axis in range(3):
            b[s + (9 + axis) * BLOCK] = pair_spring[k, axis] * held
        count += 1
    return count - begin


@threaded_kernel
def _give_back(begin, size, entry, block, touching, spring):  # type: ignore[no-untyped-def]
    for part in prange(begin.size):
        _give_back_part(begin[part], size[part], entry, block, touching, spring)


@kernel
def _give_back_part(begin, size, entry, block, touching, spring):  # type: ignore[no-untyped-def]
    for c in range(begin, begin + size):
        b = block[c // BLOCK]
        s = c % BLOCK
        k = entry[c]
        x, y, z = b[s + 9 * BLOCK], b[s + 10 * BLOCK], b[s + 11 * BLOCK]
        touching[k] = np.uint8(x * x + y * y + z * z > np.float32(0.0))
        spring[k, 0], spring[k, 1], spring[k, 2] = x, y, z
