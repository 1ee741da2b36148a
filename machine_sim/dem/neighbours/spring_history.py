"""Tangential springs of pairs asleep, kept while the pairs are not listed.

A pair of which neither particle moves is not listed, or a hundred thousand sleeping particles would
cost as much as awake ones. But friction has memory: without their springs, particles that wake
would have no support against sliding until they have slipped a little, and a heap that is woken
often would creep.

So the springs are kept in a hash table by the ids of the pair, which, unlike rows, do not change.
It is accessed when pairs fall asleep and when they wake, never for pairs that stay asleep.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.neighbours.history_transfer import BOTH_ASLEEP
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.state import ASLEEP_ON_MAP, ParticleState
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = ["SpringHistory"]

_MIN_SLOTS = 1024
_EMPTY = np.uint64(0)
"""Key of an empty slot; ids begin at 1."""
_ONE = np.uint64(1)
_ID_BITS = np.uint64(32)
_HASH_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio: Knuth, The Art of Computer Programming 3, section 6.4."""


class SpringHistory:
    """Hash table from pairs of ids to springs: open addressing with linear probing.

    The gap of a removed entry is closed. Entries of particles that no longer exist stay until the
    table is full; then they are dropped.

    Attributes:
        count: number of entries.
    """

    def __init__(self) -> None:
        self.count = 0
        # Without slots at first: growing the table is compiled when the first spring is saved.
        self._allocate(1)

    def _allocate(self, num_slots: int) -> None:
        self._pair_key = np.zeros(num_slots, np.uint64)
        self._spring = np.zeros((num_slots, 3), np.float32)

    @property
    def num_slots(self) -> int:
        """Number of slots, a power of two."""
        return len(self._pair_key)

    def save(self, state: ParticleState, old: PairTable, num_marked: int) -> None:
        """Save the springs of the pairs of a table that are marked as both asleep.

        Those in a tool are not saved: springs are in map axes, and the tool turns. Locked soil
        wakes when it is tilted or shaken, and new springs form then.

        Args:
            state: the particles.
            old: table with marked pairs in present rows, see `transfer_history`.
            num_marked: number of these pairs.
        """
        if 4 * (self.count + num_marked) > 3 * self.num_slots:
            self._grow_table(num_marked, state.particle_id)
        self.count += _save(
            old.arrays, old.count, state.particle_id, state.sleep_state, self._pair_key,
            self._spring,
        )  # fmt: skip

    def restore(self, state: ParticleState, was_active: NDArray[np.bool_], new: PairTable) -> None:
        """Return their springs to the pairs of a table that were both asleep until now.

        Args:
            state: the particles; `pair_list_row` is still that of the previous table.
            was_active: which rows of the previous table were active.
            new: the table; its contact flags and springs are updated.
        """
        if self.count:
            self.count -= _restore(
                new.arrays, new.count, state.particle_id, state.pair_list_row, was_active,
                self._pair_key, self._spring,
            )  # fmt: skip

    def _grow_table(self, num_new: int, live_ids: NDArray[np.uint32]) -> None:
        """Drop entries of particles that no longer exist, and make room for `num_new` entries.

        There are at least as many slots as particles, so that searching all slots is rare.
        """
        used = self._pair_key != _EMPTY
        key, spring = self._pair_key[used], self._spring[used]
        lower, higher = (key >> _ID_BITS).astype(np.uint32), key.astype(np.uint32)
        kept = np.isin(lower, live_ids) & np.isin(higher, live_ids)
        self.count = int(np.count_nonzero(kept))
        min_slots = max(2 * (self.count + num_new), len(live_ids), _MIN_SLOTS)
        self._allocate(1 << (min_slots - 1).bit_length())
        _insert_all(key[kept], spring[kept], self._pair_key, self._spring)


@kernel
def _pair_key(i, j):  # type: ignore[no-untyped-def]
    """Return the key of a pair of ids, the same in either order."""
    return (np.uint64(min(i, j)) << _ID_BITS) | np.uint64(max(i, j))


@helper
def _spring_sign(first_id, second_id):  # type: ignore[no-untyped-def]
    """Return the sign of a pair's spring in the table, where the lower id comes first."""
    return np.float32(1.0) if first_id < second_id else np.float32(-1.0)


@helper
def _home_slot(key, table):  # type: ignore[no-untyped-def]
    """Return the slot at which the search for a key begins."""
    key *= _HASH_MULTIPLIER
    return (key ^ (key >> _ID_BITS)) & np.uint64(table.size - 1)


@helper
def _find_slot(key, table):  # type: ignore[no-untyped-def]
    """Return the slot of a key, or the empty slot for it if it is not in the table."""
    slot, last = _home_slot(key, table), np.uint64(table.size - 1)
    while table[slot] != key and table[slot] != _EMPTY:
        slot = (slot + _ONE) & last
    return slot


@helper
def _remove_slot(gap, table, springs):  # type: ignore[no-untyped-def]
    """Empty a slot, and move up the entries after it that probing had displaced."""
    last = np.uint64(table.size - 1)
    slot = (gap + _ONE) & last
    while table[slot] != _EMPTY:
        if (slot - _home_slot(table[slot], table)) & last >= (slot - gap) & last:
            table[gap] = table[slot]
            for axis in range(3):
                springs[gap, axis] = springs[slot, axis]
            gap = slot
        slot = (slot + _ONE) & last
    table[gap] = _EMPTY


@kernel
def _insert_all(key, spring, table, springs):  # type: ignore[no-untyped-def]
    """Insert keys that are not in the table, with their springs."""
    for k in range(key.size):
        slot = _find_slot(key[k], table)
        table[slot] = key[k]
        for axis in range(3):
            springs[slot, axis] = spring[k, axis]


@kernel
def _save(pairs, count, ids, sleep_state, table, springs):  # type: ignore[no-untyped-def]
    """Save the springs of the pairs marked as both asleep; return the number of new entries."""
    num_new = 0
    for k in range(count):
        i, j = pairs.first[k], pairs.second[k]
        if pairs.contact_flag[k] != BOTH_ASLEEP:
            continue
        if sleep_state[i] > ASLEEP_ON_MAP or sleep_state[j] > ASLEEP_ON_MAP:
            continue
        key, sign = _pair_key(ids[i], ids[j]), _spring_sign(ids[i], ids[j])
        slot = _find_slot(key, table)
        num_new += table[slot] == _EMPTY
        table[slot] = key
        for axis in range(3):
            springs[slot, axis] = sign * pairs.spring[k, axis]
    return num_new


@fixed_signature_kernel
def _restore(pairs, count, ids, old_row, was_active, table, springs):  # type: ignore[no-untyped-def]
    """Move the springs of listed pairs that were both asleep from the table to the pairs.

    Args:
        pairs, count: `PairArrays` and number of the listed pairs; flags and springs are updated.
        ids: id of each particle.
        old_row: row of each particle in the previous pair table, -1 for none.
        was_active: which rows of that table were active.
        table, springs: keys and springs of the slots; entries that are found are removed.

    Returns:
        Number of springs restored.
    """
    num_restored = 0
    for k in range(count):
        i, j = pairs.first[k], pairs.second[k]
        if old_row[i] < 0 or was_active[old_row[i]] or old_row[j] < 0 or was_active[old_row[j]]:
            continue
        slot = _find_slot(_pair_key(ids[i], ids[j]), table)
        if table[slot] == _EMPTY:
            continue
        pairs.contact_flag[k] = 1
        sign = _spring_sign(ids[i], ids[j])
        for axis in range(3):
            pairs.spring[k, axis] = sign * springs[slot, axis]
        _remove_slot(slot, table, springs)
        num_restored += 1
    return num_restored
