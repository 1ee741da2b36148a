"""The contacts of a step: listed pairs that may touch in it, laid out for the compiler.

Listed pairs are many and some never touch. Those that may are copied into blocks, where they stay
until the pair list is made anew; others join them when they come near. In a block, quantity q of
slot s lies at `q * BLOCK + s`. The constant distance between quantities lets the compiler prove
that they do not overlap, and it vectorises the contact maths (float32, 8 or 16 pairs at once).
Once a step separations are taken from float64 positions, so that the substeps can go on in float32
displacements.

The contacts of each part of the pair list (see `parts`) have blocks of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.jit import inline_kernel, kernel, threaded_kernel
from machine_sim.particles.pairs.simd import GROUP
from machine_sim.particles.pairs.table import PairTable
from machine_sim.particles.store import ParticleStore

__all__ = ["BLOCK", "BOND_GAP", "ContactBlocks", "ContactTable"]

BLOCK = 128
"""Contacts in a block: 6 KB, inside the first-level cache."""

QUANTITIES = 12
"""Separation (3), reach, effective mass, friction, rolling friction, bond, cap of the overlap,
spring (3)."""

_ZERO = np.float32(0.0)
_BOND_AREA = np.float32(np.pi)
_HORIZON = np.float32(1.4)
"""How far ahead contacts are looked for, in steps: one, and room for acceleration."""
BOND_GAP = np.float32(0.03)
"""Gap at which two particles hold together no more, in sums of radii: a bridge of wet soil."""
_SLACK = BOND_GAP
"""The least distance ahead, in sums of radii."""


class ContactBlocks(NamedTuple):
    """Contacts of one step, in blocks.

    Attributes:
        first, second: rows of each contact, uint32.
        block: quantities, shape (blocks, QUANTITIES * BLOCK), float32.
        begin, size: first slot of each part, a whole number of blocks, and its contacts.
    """

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    block: NDArray[np.float32]
    begin: NDArray[np.int64]
    size: NDArray[np.int64]


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
        self._waiting = np.zeros(0, np.uint32)
        self._wait = np.zeros(1, np.int64)
        self._room(32)

    @property
    def blocks(self) -> ContactBlocks:
        """What kernels are given."""
        return ContactBlocks(self.first, self.second, self.block, self.begin, self.size)

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
        self, store: ParticleStore, body, pairs: PairTable, dt: float, threads: int, *,
        anew: bool, grown: bool,
    ) -> None:  # fmt: skip
        """Take over the pairs that may touch within `dt` [s], with their springs.

        Args:
            store: the particles.
            body: records of all rows.
            pairs: where they are listed.
            dt: [s].
            threads: how many work at it.
            anew: forget the contacts of the step before; needed where the pairs, who rests or what
                particles are like have changed since, and springs are to be given back before.
            grown: whether contact radii have.
        """
        if anew:
            self._lay_out(pairs)
        _collect.on(threads)(
            np.float32(dt), pairs.first, pairs.second, pairs.bounds, pairs.touching,
            pairs.spring, store.position, body, store.inverse_mass, store.friction, store.rolling,
            store.cohesion, self.first, self.second, self.entry, self.block, self.begin, self.size,
            self._waiting, self._wait, anew, grown,
        )  # fmt: skip

    def _lay_out(self, pairs: PairTable) -> None:
        """Give each part of the pair list blocks enough for all of its pairs."""
        blocks = (np.diff(pairs.bounds) + BLOCK - 1) // BLOCK
        self.begin = BLOCK * (np.cumsum(blocks) - blocks)
        self.size = np.zeros(len(blocks), np.int64)
        self._wait = np.zeros(len(blocks), np.int64)
        if int(blocks.sum()) > len(self.block):
            self._room(2 * int(blocks.sum()))
        if pairs.count > len(self._waiting):
            self._waiting = np.zeros(2 * pairs.count, np.uint32)

    def give_back(self, pairs: PairTable, threads: int) -> None:
        """Keep the springs in the pair table, before contacts are collected anew."""
        _give_back.on(threads)(
            self.begin, self.size, self.entry, self.block, pairs.touching, pairs.spring
        )


@threaded_kernel
def _collect(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, bounds, touching, pair_spring, position, body,
    inverse_mass, friction, rolling, bond, first, second, entry, block, begin, size, waiting, wait,
    anew, grown,
):  # fmt: skip
    """Bring the table up to date, part by part."""
    for part in prange(begin.size):
        low = bounds[part]
        if anew:
            wait[part] = bounds[part + 1] - low
            for k in range(low, bounds[part + 1]):
                waiting[k] = k
        _separate(begin[part], size[part], first, second, position, block)
        if grown:
            _resize(begin[part], size[part], first, second, body, bond, block)
        joined, wait[part] = _join(
            dt, pair_first, pair_second, waiting[low : low + wait[part]], touching,
            pair_spring, position, body, inverse_mass, friction, rolling, bond, first, second,
            entry, block, begin[part] + size[part],
        )  # fmt: skip
        size[part] += joined


@kernel
def _separate(begin, size, first, second, position, block):  # type: ignore[no-untyped-def]
    """Take the separations of contacts that stay."""
    for start in range(begin, begin + size, BLOCK):
        b = block[start // BLOCK]
        for s in range(min(begin + size - start, BLOCK)):
            i, j = first[start + s], second[start + s]
            b[s] = np.float32(position[j, 0] - position[i, 0])
            b[s + BLOCK] = np.float32(position[j, 1] - position[i, 1])
            b[s + 2 * BLOCK] = np.float32(position[j, 2] - position[i, 2])


@kernel
def _resize(begin, size, first, second, body, bond, block):  # type: ignore[no-untyped-def]
    """Take the contact radii of contacts that stay."""
    for start in range(begin, begin + size, BLOCK):
        b = block[start // BLOCK]
        for s in range(min(begin + size - start, BLOCK)):
            i, j = first[start + s], second[start + s]
            _measure(b, s, body[i, 3], body[j, 3], min(bond[i], bond[j]))


@inline_kernel
def _measure(b, s, ri, rj, bond):  # type: ignore[no-untyped-def]
    """Fill in what goes by the contact radii [m] of slot `s`."""
    least = min(ri, rj)
    b[s + 3 * BLOCK] = ri + rj
    b[s + 7 * BLOCK] = _BOND_AREA * least * least * bond
    b[s + 8 * BLOCK] = least


@kernel
def _join(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, waiting, touching, pair_spring, position, body,
    inverse_mass, friction, rolling, bond, first, second, entry, block, begin,
):  # fmt: skip
    """Copy those of the waiting pairs that may touch to the slots from `begin` on.

    Returns:
        How many, and how many still wait.
    """
    slot, left = begin, np.int64(0)  # typed, or `_may_touch` is compiled once more for this 0
    listed = np.empty(BLOCK, np.uint32)
    for start in range(0, waiting.size, BLOCK):
        count, left = _may_touch(
            dt, pair_first, pair_second, start, min(start + BLOCK, waiting.size), waiting,
            left, touching, position, body, listed,
        )  # fmt: skip
        for m in range(count):
            k = listed[m]
            i, j = pair_first[k], pair_second[k]
            first[slot], second[slot], entry[slot] = i, j, k
            b = block[slot // BLOCK]
            s = slot % BLOCK
            b[s] = np.float32(position[j, 0] - position[i, 0])
            b[s + BLOCK] = np.float32(position[j, 1] - position[i, 1])
            b[s + 2 * BLOCK] = np.float32(position[j, 2] - position[i, 2])
            # Of two soils the weaker gives way.
            _measure(b, s, body[i, 3], body[j, 3], min(bond[i], bond[j]))
            b[s + 5 * BLOCK] = min(friction[i], friction[j])
            b[s + 6 * BLOCK] = min(rolling[i], rolling[j])
            # One that rests counts with its own mass. As a wall it would make the contact twice as
            # stiff while it sleeps, and each time it falls asleep or wakes its neighbours move.
            b[s + 4 * BLOCK] = np.float32(1.0) / (inverse_mass[i] + inverse_mass[j])
            held = np.float32(touching[k])
            for axis in range(3):
                b[s + (9 + axis) * BLOCK] = pair_spring[k, axis] * held
            slot += 1
    joined, end = slot - begin, slot
    while end % GROUP != 0:
        # The last group is filled up with contacts that weigh nothing.
        first[end], second[end] = first[end - 1], second[end - 1]
        for q in range(QUANTITIES):
            block[end // BLOCK, end % BLOCK + q * BLOCK] = _ZERO
        end += 1
    return joined, left


@kernel
def _may_touch(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, low, high, waiting, left, touching, position, body, listed
):
    """List those of the waiting pairs from `low` to `high` that may touch, without branches.

    The others go on waiting, from number `left` on. Their history is forgotten, but where both
    rest: theirs is kept for when they wake.

    Returns:
        How many are listed, and how many wait now.
    """
    count = 0
    for m in range(low, high):
        k = waiting[m]
        i, j = pair_first[k], pair_second[k]
        x = np.float32(position[j, 0] - position[i, 0])
        y = np.float32(position[j, 1] - position[i, 1])
        z = np.float32(position[j, 2] - position[i, 2])
        vx = body[j, 4] - body[i, 4]
        vy = body[j, 5] - body[i, 5]
        vz = body[j, 6] - body[i, 6]
        way = max(-(vx * x + vy * y + vz * z), _ZERO) * _HORIZON * dt
        reach = (body[i, 3] + body[j, 3]) * (np.float32(1.0) + _SLACK)
        distance = np.sqrt(x * x + y * y + z * z)
        rests = body[i, 7] + body[j, 7] == _ZERO
        # The way to go and the way they come are both times the distance.
        may = (distance - reach) * distance <= way
        touching[k] *= may | rests
        may &= not rests
        listed[count] = k
        count += may
        waiting[left] = k
        left += not may
    return count, left


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
