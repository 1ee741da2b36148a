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

from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import kernel, threaded_kernel

__all__ = ["BLOCK_SIZE", "BOND_RUPTURE_GAP", "PairContactBlocks", "PairContacts"]

BLOCK_SIZE = 128
"""Contacts in a block: 6 KB, inside the first-level cache."""

NUM_QUANTITIES = 12
"""Separation (3), reach, effective mass, friction, rolling friction, bond, cap of the overlap,
spring (3)."""

_ZERO = np.float32(0.0)
_PI = np.float32(np.pi)
_LOOKAHEAD_STEPS = np.float32(1.4)
"""How far ahead contacts are looked for, in steps: one, and room for acceleration."""
BOND_RUPTURE_GAP = np.float32(0.03)
"""Gap at which two particles hold together no more, in sums of radii: a bridge of wet soil."""
_MIN_LOOKAHEAD_GAP = BOND_RUPTURE_GAP
"""The least distance ahead, in sums of radii."""


class PairContactBlocks(NamedTuple):
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


class PairContacts:
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
        self._candidates = np.zeros(0, np.uint32)
        self._num_candidates = np.zeros(1, np.int64)
        self._reserve(32)

    @property
    def blocks(self) -> PairContactBlocks:
        """What kernels are given."""
        return PairContactBlocks(self.first, self.second, self.block, self.begin, self.size)

    @property
    def count(self) -> int:
        """Number of contacts."""
        return int(self.size.sum())

    def _reserve(self, blocks: int) -> None:
        self.first = np.zeros(blocks * BLOCK_SIZE, np.uint32)
        self.second = np.zeros(blocks * BLOCK_SIZE, np.uint32)
        self.pair_index = np.zeros(blocks * BLOCK_SIZE, np.uint32)
        self.block = np.zeros((blocks, NUM_QUANTITIES * BLOCK_SIZE), np.float32)

    def update(  # type: ignore[no-untyped-def]
        self, state: ParticleState, body, pairs: PairTable, dt: float, threads: int, *,
        rebuild: bool, radii_changed: bool,
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
        if rebuild:
            self._allocate_blocks(pairs)
        _update.for_threads(threads)(
            np.float32(dt), pairs.first, pairs.second, pairs.bounds, pairs.contact_flag,
            pairs.spring, state.position, body, state.inverse_mass, state.friction, state.rolling_friction,
            state.cohesion, self.first, self.second, self.pair_index, self.block, self.begin, self.size,
            self._candidates, self._num_candidates, rebuild, radii_changed,
        )  # fmt: skip

    def _allocate_blocks(self, pairs: PairTable) -> None:
        """Give each part of the pair list blocks enough for all of its pairs."""
        blocks = (np.diff(pairs.bounds) + BLOCK_SIZE - 1) // BLOCK_SIZE
        self.begin = BLOCK_SIZE * (np.cumsum(blocks) - blocks)
        self.size = np.zeros(len(blocks), np.int64)
        self._num_candidates = np.zeros(len(blocks), np.int64)
        if int(blocks.sum()) > len(self.block):
            self._reserve(2 * int(blocks.sum()))
        if pairs.count > len(self._candidates):
            self._candidates = np.zeros(2 * pairs.count, np.uint32)

    def store_history(self, pairs: PairTable, threads: int) -> None:
        """Keep the springs in the pair table, before contacts are collected anew."""
        _store_history.for_threads(threads)(
            self.begin, self.size, self.pair_index, self.block, pairs.contact_flag, pairs.spring
        )


@threaded_kernel
def _update(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, bounds, contact_flag, pair_spring, position, body,
    inverse_mass, friction, rolling_friction, cohesion, first, second, pair_index, block, begin, size, candidates, num_candidates,
    rebuild, radii_changed,
):  # fmt: skip
    """Bring the table up to date, part by part."""
    for part in prange(begin.size):
        low = bounds[part]
        if rebuild:
            num_candidates[part] = bounds[part + 1] - low
            for k in range(low, bounds[part + 1]):
                candidates[k] = k
        _update_separations(begin[part], size[part], first, second, position, block)
        if radii_changed:
            _update_contact_radii(begin[part], size[part], first, second, body, cohesion, block)
        joined, num_candidates[part] = _add_touching(
            dt, pair_first, pair_second, candidates[low : low + num_candidates[part]], contact_flag,
            pair_spring, position, body, inverse_mass, friction, rolling_friction, cohesion, first, second,
            pair_index, block, begin[part] + size[part],
        )  # fmt: skip
        size[part] += joined


@kernel
def _update_separations(begin, size, first, second, position, block):  # type: ignore[no-untyped-def]
    """Take the separations of contacts that stay."""
    for start in range(begin, begin + size, BLOCK_SIZE):
        b = block[start // BLOCK_SIZE]
        for s in range(min(begin + size - start, BLOCK_SIZE)):
            i, j = first[start + s], second[start + s]
            b[s] = np.float32(position[j, 0] - position[i, 0])
            b[s + BLOCK_SIZE] = np.float32(position[j, 1] - position[i, 1])
            b[s + 2 * BLOCK_SIZE] = np.float32(position[j, 2] - position[i, 2])


@kernel
def _update_contact_radii(begin, size, first, second, body, cohesion, block):  # type: ignore[no-untyped-def]
    """Take the contact radii of contacts that stay."""
    for start in range(begin, begin + size, BLOCK_SIZE):
        b = block[start // BLOCK_SIZE]
        for s in range(min(begin + size - start, BLOCK_SIZE)):
            i, j = first[start + s], second[start + s]
            _set_radius_quantities(b, s, body[i, 3], body[j, 3], min(cohesion[i], cohesion[j]))


@kernel(forceinline=True)
def _set_radius_quantities(b, s, ri, rj, cohesion):  # type: ignore[no-untyped-def]
    """Fill in what goes by the contact radii [m] of slot `s`."""
    least = min(ri, rj)
    b[s + 3 * BLOCK_SIZE] = ri + rj
    b[s + 7 * BLOCK_SIZE] = _PI * least * least * cohesion
    b[s + 8 * BLOCK_SIZE] = least


@kernel
def _add_touching(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, candidates, contact_flag, pair_spring, position, body,
    inverse_mass, friction, rolling_friction, cohesion, first, second, pair_index, block, begin,
):  # fmt: skip
    """Copy those of the waiting pairs that may touch to the slots from `begin` on.

    Returns:
        How many, and how many still wait.
    """
    slot, left = begin, np.int64(0)  # typed, or `_may_touch` is compiled once more for this 0
    listed = np.empty(BLOCK_SIZE, np.uint32)
    for start in range(0, candidates.size, BLOCK_SIZE):
        count, left = _select_touching(
            dt, pair_first, pair_second, start, min(start + BLOCK_SIZE, candidates.size), candidates,
            left, contact_flag, position, body, listed,
        )  # fmt: skip
        for m in range(count):
            k = listed[m]
            i, j = pair_first[k], pair_second[k]
            first[slot], second[slot], pair_index[slot] = i, j, k
            b = block[slot // BLOCK_SIZE]
            s = slot % BLOCK_SIZE
            b[s] = np.float32(position[j, 0] - position[i, 0])
            b[s + BLOCK_SIZE] = np.float32(position[j, 1] - position[i, 1])
            b[s + 2 * BLOCK_SIZE] = np.float32(position[j, 2] - position[i, 2])
            # Of two soils the weaker gives way.
            _set_radius_quantities(b, s, body[i, 3], body[j, 3], min(cohesion[i], cohesion[j]))
            b[s + 5 * BLOCK_SIZE] = min(friction[i], friction[j])
            b[s + 6 * BLOCK_SIZE] = min(rolling_friction[i], rolling_friction[j])
            # One that rests counts with its own mass. As a wall it would make the contact twice as
            # stiff while it sleeps, and each time it falls asleep or wakes its neighbours move.
            b[s + 4 * BLOCK_SIZE] = np.float32(1.0) / (inverse_mass[i] + inverse_mass[j])
            held = np.float32(contact_flag[k])
            for axis in range(3):
                b[s + (9 + axis) * BLOCK_SIZE] = pair_spring[k, axis] * held
            slot += 1
    joined, end = slot - begin, slot
    while end % GROUP_SIZE != 0:
        # The last group is filled up with contacts that weigh nothing.
        first[end], second[end] = first[end - 1], second[end - 1]
        for q in range(NUM_QUANTITIES):
            block[end // BLOCK_SIZE, end % BLOCK_SIZE + q * BLOCK_SIZE] = _ZERO
        end += 1
    return joined, left


@kernel
def _select_touching(  # type: ignore[no-untyped-def]
    dt, pair_first, pair_second, low, high, candidates, left, contact_flag, position, body, listed
):
    """List those of the waiting pairs from `low` to `high` that may touch, without branches.

    The others go on waiting, from number `left` on. Their history is forgotten, but where both
    rest: theirs is kept for when they wake.

    Returns:
        How many are listed, and how many wait now.
    """
    count = 0
    for m in range(low, high):
        k = candidates[m]
        i, j = pair_first[k], pair_second[k]
        x = np.float32(position[j, 0] - position[i, 0])
        y = np.float32(position[j, 1] - position[i, 1])
        z = np.float32(position[j, 2] - position[i, 2])
        vx = body[j, 4] - body[i, 4]
        vy = body[j, 5] - body[i, 5]
        vz = body[j, 6] - body[i, 6]
        way = max(-(vx * x + vy * y + vz * z), _ZERO) * _LOOKAHEAD_STEPS * dt
        reach = (body[i, 3] + body[j, 3]) * (np.float32(1.0) + _MIN_LOOKAHEAD_GAP)
        distance = np.sqrt(x * x + y * y + z * z)
        rests = body[i, 7] + body[j, 7] == _ZERO
        # The way to go and the way they come are both times the distance.
        may = (distance - reach) * distance <= way
        contact_flag[k] *= may | rests
        may &= not rests
        listed[count] = k
        count += may
        candidates[left] = k
        left += not may
    return count, left


@threaded_kernel
def _store_history(begin, size, pair_index, block, contact_flag, spring):  # type: ignore[no-untyped-def]
    for part in prange(begin.size):
        _store_history_part(begin[part], size[part], pair_index, block, contact_flag, spring)


@kernel
def _store_history_part(begin, size, pair_index, block, contact_flag, spring):  # type: ignore[no-untyped-def]
    for c in range(begin, begin + size):
        b = block[c // BLOCK_SIZE]
        s = c % BLOCK_SIZE
        k = pair_index[c]
        x, y, z = b[s + 9 * BLOCK_SIZE], b[s + 10 * BLOCK_SIZE], b[s + 11 * BLOCK_SIZE]
        contact_flag[k] = np.uint8(x * x + y * y + z * z > np.float32(0.0))
        spring[k, 0], spring[k, 1], spring[k, 2] = x, y, z
