"""Contacts between particles in a step: the listed pairs that may touch in it, in blocks.

The pair list is long, and many of its pairs never touch. Those that may touch within the step are
copied into blocks (see `pair_block`), where they stay until the pair list is rebuilt; other pairs
are added when they come near. Once per step the separations are computed from the float64
positions, so that the substeps can continue with float32 displacements.

The contacts of each part of the pair list (see `partition`) have blocks of their own.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.body_records import CONTACT_RADIUS
from machine_sim.dem.contacts import pair_block as pair
from machine_sim.dem.contacts.pair_selection import allocate_selection, select_touching
from machine_sim.dem.contacts.separations import gather_separations
from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.vec3 import dot
from msg_bridge.kernels import BoxedTable, box_table, helper, threaded_helper, threaded_kernel

__all__ = ["PairContactBlocks", "PairContactData", "PairContacts", "update_pair_contacts"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_PI = np.float32(np.pi)


class PairContactBlocks(NamedTuple):
    """Contacts of one step, in blocks.

    Attributes:
        first, second: rows of the particles of each contact, uint32, shape (slots,).
        block: quantities, see `pair_block`, float32, shape (blocks, NUM_QUANTITIES * BLOCK_SIZE).
        begin: first slot of each part, a multiple of BLOCK_SIZE, int64, shape (parts,).
        size: number of contacts of each part, int64, shape (parts,).
    """

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    block: NDArray[np.float32]
    begin: NDArray[np.int64]
    size: NDArray[np.int64]


class PairContactSource(NamedTuple):
    """Where the contacts come from.

    Attributes:
        pair_index: index of each contact in the pair table, uint32, shape (slots,).
        candidates: pairs that are not yet contacts: indices into the pair table, part by part,
            uint32.
        num_candidates: number of candidates of each part, int64, shape (parts,).
    """

    pair_index: NDArray[np.uint32]
    candidates: NDArray[np.uint32]
    num_candidates: NDArray[np.int64]


class PairContactData(NamedTuple):
    """The contacts of a step, and the pairs that they are made from."""

    blocks: PairContactBlocks
    source: PairContactSource


class PairContacts:
    """The contacts between particles, kept from step to step until the pair list is rebuilt.

    Attributes:
        blocks: the contacts, for kernels.
        source: the pairs that they are made from.
        boxed: `PairContactData`, boxed.
    """

    def __init__(self) -> None:
        self._allocate(num_blocks=32, num_candidates=0, num_parts=1)

    @property
    def count(self) -> int:
        """Number of contacts."""
        return int(self.blocks.size.sum())

    def _allocate(self, num_blocks: int, num_candidates: int, num_parts: int) -> None:
        num_slots = num_blocks * pair.BLOCK_SIZE
        self.blocks = PairContactBlocks(
            first=np.zeros(num_slots, np.uint32),
            second=np.zeros(num_slots, np.uint32),
            block=np.zeros((num_blocks, pair.NUM_QUANTITIES * pair.BLOCK_SIZE), np.float32),
            begin=np.zeros(num_parts, np.int64),
            size=np.zeros(num_parts, np.int64),
        )
        self.source = PairContactSource(
            pair_index=np.zeros(num_slots, np.uint32),
            candidates=np.zeros(num_candidates, np.uint32),
            num_candidates=np.zeros(num_parts, np.int64),
        )
        self.boxed: BoxedTable = box_table(PairContactData(self.blocks, self.source))

    def clear(self, pairs: PairTable) -> None:
        """Discard the contacts; each part of the pair list gets enough blocks for all its pairs.

        Needed where the pair list, the set of sleeping particles or their properties have changed;
        call `store_history` before that change.
        """
        begin, num_blocks = [], 0
        for low, high in pairwise(pairs.bounds.tolist()):
            begin.append(num_blocks * pair.BLOCK_SIZE)
            num_blocks += (high - low + pair.BLOCK_SIZE - 1) // pair.BLOCK_SIZE
        max_blocks, max_candidates = len(self.blocks.block), len(self.source.candidates)
        if (
            num_blocks > max_blocks
            or pairs.count > max_candidates
            or len(begin) != len(self.blocks.begin)
        ):
            self._allocate(
                max_blocks if num_blocks <= max_blocks else 2 * num_blocks,
                max_candidates if pairs.count <= max_candidates else 2 * pairs.count,
                len(begin),
            )
        self.blocks.begin[:] = begin
        self.blocks.size[:] = self.source.num_candidates[:] = 0

    def store_history(self, pairs: PairTable, threads: int) -> None:
        """Write the tangential springs back to the pair table."""
        blocks = self.blocks
        _store_history.for_threads(threads)(
            blocks.begin, blocks.size, self.source.pair_index, blocks.block, pairs.contact_flag,
            pairs.spring,
        )  # fmt: skip


@threaded_helper
def update_pair_contacts(  # type: ignore[no-untyped-def]
    dt, pairs, bounds, particles, body, contacts, source, rebuild, radii_changed
):
    """Add the pairs that may touch within a step, and update those that are contacts already.

    Args:
        dt: length of the step [s], float32.
        pairs, bounds: `PairArrays`, and the bounds of the parts.
        particles: `ParticleColumns`.
        body: body records of all particles.
        contacts: `PairContactBlocks`; updated.
        source: `PairContactSource`; updated.
        rebuild: whether the contacts were cleared: all pairs are candidates.
        radii_changed: whether contact radii have changed since the step before.
    """
    # Outside the loop: with threads, a write to `contacts.size[part]` within it would be lost.
    begin, size = contacts.begin, contacts.size
    pair_index, candidates, num_candidates = (
        source.pair_index, source.candidates, source.num_candidates,
    )  # fmt: skip
    for part in prange(begin.size):
        low = bounds[part]
        if rebuild:
            num_candidates[part] = bounds[part + 1] - low
            for k in range(np.uint64(low), np.uint64(bounds[part + 1])):
                candidates[k] = k
        if radii_changed:
            _update_contact_radii(begin[part], size[part], contacts, body, particles.cohesion)
        num_added, num_candidates[part] = _add_touching(
            dt, pairs, candidates[low : low + num_candidates[part]], particles, body,
            begin[part] + size[part], contacts, pair_index, allocate_selection(),
        )  # fmt: skip
        size[part] += num_added
        _set_separations(begin[part], size[part], contacts, particles.position)


@helper(forceinline=True)
def _set_separations(begin, size, contacts, position):  # type: ignore[no-untyped-def]
    """Fill in the separations of all contacts of a part at the start of the step."""
    first, second, block = contacts.first, contacts.second, contacts.block
    for start in range(begin, begin + size, pair.BLOCK_SIZE):
        b = block[start // pair.BLOCK_SIZE]
        for s in range(0, min(begin + size - start, pair.BLOCK_SIZE), GROUP_SIZE):
            gather_separations(
                position, first, second, start + s, b, pair.BLOCK_SIZE, pair.SEPARATION + s
            )


@helper(forceinline=True)
def _update_contact_radii(begin, size, contacts, body, cohesion):  # type: ignore[no-untyped-def]
    """Update what depends on contact radii in existing contacts."""
    first, second, block = contacts.first, contacts.second, contacts.block
    for start in range(begin, begin + size, pair.BLOCK_SIZE):
        b = block[start // pair.BLOCK_SIZE]
        for s in range(min(begin + size - start, pair.BLOCK_SIZE)):
            i, j = first[start + s], second[start + s]
            _set_radius_quantities(
                b, s, body[i, CONTACT_RADIUS], body[j, CONTACT_RADIUS],
                min(cohesion[i], cohesion[j]),
            )  # fmt: skip


@helper(forceinline=True)
def _set_radius_quantities(b, s, ri, rj, cohesion):  # type: ignore[no-untyped-def]
    """Fill in the quantities of slot `s` that depend on the contact radii [m]."""
    smaller = min(ri, rj)
    b[pair.RADIUS_SUM + s] = ri + rj
    b[pair.COHESION_FORCE + s] = _PI * smaller * smaller * cohesion
    b[pair.MAX_OVERLAP + s] = smaller


@helper
def _add_touching(dt, pairs, candidates, particles, body, begin, contacts, pair_index, memory):  # type: ignore[no-untyped-def]
    """Copy the candidates that may touch to the slots from `begin` on, without separations.

    Returns:
        Number of contacts added, and number of candidates left.
    """
    first, second, block = contacts.first, contacts.second, contacts.block
    spring, contact_flag = pairs.spring, pairs.contact_flag
    friction, rolling_friction = particles.friction, particles.rolling_friction
    cohesion, inverse_mass = particles.cohesion, particles.inverse_mass
    # The 0 is typed, or `select_touching` is compiled once more for its literal.
    slot, num_left = begin, np.int64(0)
    for start in range(0, candidates.size, pair.BLOCK_SIZE):
        count, num_left = select_touching(
            dt, pairs, start, min(start + pair.BLOCK_SIZE, candidates.size), candidates, num_left,
            particles.position, body, memory,
        )  # fmt: skip
        for m in range(count):
            k = memory.selected[m]
            i, j = pairs.first[k], pairs.second[k]
            at = np.uint64(slot)
            first[at], second[at], pair_index[at] = i, j, k
            b, s = block[slot // pair.BLOCK_SIZE], slot % pair.BLOCK_SIZE
            # The coefficients of a contact between two soils are those of the weaker one.
            _set_radius_quantities(
                b, s, body[i, CONTACT_RADIUS], body[j, CONTACT_RADIUS],
                min(cohesion[i], cohesion[j]),
            )  # fmt: skip
            b[pair.FRICTION + s] = min(friction[i], friction[j])
            b[pair.ROLLING_FRICTION + s] = min(rolling_friction[i], rolling_friction[j])
            # A sleeping particle counts with its own mass. With an infinite one the contact would
            # be twice as stiff while it sleeps, and its neighbours would move each time it falls
            # asleep or wakes.
            b[pair.EFFECTIVE_MASS + s] = _ONE / (inverse_mass[i] + inverse_mass[j])
            was_in_contact = np.float32(contact_flag[k])
            for axis in range(3):
                b[pair.TANGENTIAL_SPRING + axis * pair.BLOCK_SIZE + s] = (
                    spring[k, axis] * was_in_contact
                )
            slot += 1
    num_added, end = slot - begin, slot
    while end % GROUP_SIZE != 0:
        # Pad the last group with contacts without mass or cohesion, which exert no force.
        first[end], second[end] = first[end - 1], second[end - 1]
        for q in range(pair.NUM_QUANTITIES):
            s = end % pair.BLOCK_SIZE
            block[end // pair.BLOCK_SIZE, q * pair.BLOCK_SIZE + s] = _ZERO
        end += 1
    return num_added, num_left


@threaded_kernel
def _store_history(begin, size, pair_index, block, contact_flag, spring):  # type: ignore[no-untyped-def]
    for part in prange(begin.size):
        _store_history_part(begin[part], size[part], pair_index, block, contact_flag, spring)


@helper
def _store_history_part(begin, size, pair_index, block, contact_flag, spring):  # type: ignore[no-untyped-def]
    for c in range(begin, begin + size):
        k = pair_index[c]
        elongation = pair.load(
            block[c // pair.BLOCK_SIZE], pair.TANGENTIAL_SPRING, c % pair.BLOCK_SIZE
        )
        contact_flag[k] = np.uint8(dot(elongation, elongation) > _ZERO)
        spring[k, 0], spring[k, 1], spring[k, 2] = elongation
