"""Selection of the listed pairs that may touch within a step, a block of candidates at a time.

Motion is gathered for four pairs at a time, the condition is evaluated in a loop that is
vectorised, and its results are marks by which the pairs are appended to two lists.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.compaction import COMPACTION_SIZE, append_marked
from machine_sim.dem.contacts import simd
from machine_sim.dem.contacts.block_vectors import vector_access
from machine_sim.dem.contacts.pair_block import BLOCK_SIZE
from machine_sim.dem.contacts.pair_forces import BOND_RUPTURE_GAP
from machine_sim.dem.contacts.separations import gather_separations
from machine_sim.dem.contacts.simd import GROUP_SIZE, VECTOR_SIZE, gather_approach, round_up
from machine_sim.dem.vec3 import dot
from msg_bridge.kernels import helper

__all__ = ["Selection", "allocate_selection", "select_touching"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LOOKAHEAD_STEPS = np.float32(1.4)
"""Time ahead in which a pair may touch to become a contact, in steps: one, and a margin for
acceleration."""
_MIN_LOOKAHEAD_GAP = BOND_RUPTURE_GAP
"""Gap up to which a pair becomes a contact at any velocity, in sums of contact radii."""

# Offsets in the scratch block.
_VELOCITY = simd.CLOSING_VELOCITY * BLOCK_SIZE
_INVERSE_MASS_SUM = simd.INVERSE_MASS_SUM * BLOCK_SIZE
_RADIUS_SUM = simd.CONTACT_RADIUS_SUM * BLOCK_SIZE
_SEPARATION = 5 * BLOCK_SIZE
_NUM_QUANTITIES = 8

_load, _ = vector_access(BLOCK_SIZE)


class Selection(NamedTuple):
    """Working memory for a block of candidates.

    Attributes:
        pair: indices into the pair table, uint32.
        first, second: rows of the particles of each, uint32.
        scratch: relative velocity, sums of inverse masses and of radii, and separation, float32.
        is_selected, is_left, keeps_history: results for each candidate, 0 or 1, uint8.
        selected: indices of the pairs that may touch, uint32.
    """

    pair: NDArray[np.uint32]
    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    scratch: NDArray[np.float32]
    is_selected: NDArray[np.uint8]
    is_left: NDArray[np.uint8]
    keeps_history: NDArray[np.uint8]
    selected: NDArray[np.uint32]


@helper(allocates=True)
def allocate_selection():  # type: ignore[no-untyped-def]
    """Return working memory."""
    size = BLOCK_SIZE + COMPACTION_SIZE
    return Selection(
        np.empty(size, np.uint32),
        np.empty(size, np.uint32),
        np.empty(size, np.uint32),
        np.empty(_NUM_QUANTITIES * BLOCK_SIZE, np.float32),
        np.empty(size, np.uint8),
        np.empty(size, np.uint8),
        np.empty(size, np.uint8),
        np.empty(size, np.uint32),
    )


@helper
def select_touching(dt, pairs, low, high, candidates, num_left, position, body, memory):  # type: ignore[no-untyped-def]
    """Select the candidates from `low` to `high` that may touch within a step.

    The others stay candidates, moved down to number `num_left` and up. Their contact history is
    cleared, except for pairs that are both asleep: theirs is kept until they wake.

    Args:
        dt: length of the step [s], float32.
        pairs: `PairArrays`; contact flags are updated.
        low, high: range of at most `BLOCK_SIZE` candidates.
        candidates: indices into the pair table, uint32; updated.
        num_left: number of candidates left so far.
        position: centres [m], shape (n, 3).
        body: body records of all particles.
        memory: `Selection`; the pairs that are selected are written to it.

    Returns:
        Number of pairs selected, and number of candidates left so far.
    """
    count = high - low
    for s in range(np.uint64(count)):
        k = candidates[np.uint64(low) + s]
        memory.pair[s], memory.first[s], memory.second[s] = k, pairs.first[k], pairs.second[k]
    for s in range(np.uint64(count), np.uint64(round_up(count, GROUP_SIZE))):
        memory.first[s] = memory.second[s] = memory.first[0]
    for s in range(0, count, GROUP_SIZE):
        gather_approach(body, memory.first, memory.second, s, memory.scratch, BLOCK_SIZE, s)
        gather_separations(
            position, memory.first, memory.second, s, memory.scratch, BLOCK_SIZE, _SEPARATION + s
        )
    _mark_touching(dt, count, memory)
    for s in range(np.uint64(count)):
        pairs.contact_flag[memory.pair[s]] *= memory.keeps_history[s]
    num_selected = np.int64(0)
    for s in range(0, count, COMPACTION_SIZE):
        num_selected = append_marked(
            memory.pair, memory.is_selected, s, memory.selected, num_selected
        )
        num_left = append_marked(memory.pair, memory.is_left, s, candidates, num_left)
    return num_selected, num_left


@helper
def _mark_touching(dt, count, memory):  # type: ignore[no-untyped-def]
    """Mark what becomes of the first candidates of a block, `count` of them."""
    scratch, is_selected, is_left = memory.scratch, memory.is_selected, memory.is_left
    keeps_history = memory.keeps_history
    for s in range(np.uint64(round_up(count, VECTOR_SIZE))):
        separation, velocity = _load(scratch, _SEPARATION, s), _load(scratch, _VELOCITY, s)
        # Approach speed and gap are both multiplied by the distance, which saves a division.
        approach = max(-dot(velocity, separation), _ZERO) * _LOOKAHEAD_STEPS * dt
        reach = scratch[_RADIUS_SUM + s] * (_ONE + _MIN_LOOKAHEAD_GAP)
        distance = np.sqrt(dot(separation, separation))
        both_asleep = scratch[_INVERSE_MASS_SUM + s] == _ZERO
        may_touch = (distance - reach) * distance <= approach
        is_selected[s] = np.uint8(may_touch & (not both_asleep))
        is_left[s] = np.uint8((not may_touch) | both_asleep)
        keeps_history[s] = np.uint8(may_touch | both_asleep)
    for s in range(np.uint64(count), np.uint64(count + COMPACTION_SIZE)):
        is_selected[s] = is_left[s] = np.uint8(0)
