"""Springs of pairs that rest: kept while nobody lists them, and given back when one of them wakes.

A pair of which neither moves is not listed, or a hundred thousand asleep would cost what they cost
awake. But friction remembers: without their springs those that wake would lean on nothing until
they have slipped a little, and a heap woken again and again would creep.

So the springs lie in a hash table by the ids of the pair, which outlast rows. It is touched when
pairs fall asleep and when they wake, never for those that sleep on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.neighbours.pair_search import BOTH_ASLEEP
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import kernel

__all__ = ["SpringHistory"]

_MIN_SLOTS = 1024
_EMPTY = np.uint64(0)
"""Key of no pair: ids are from 1."""
_ONE = np.uint64(1)
_ID_BITS = np.uint64(32)
_MIX = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio: Knuth, The Art of Computer Programming 3, section 6.4."""


class SpringHistory:
    """The table: open addressing, the next free slot taken, gaps closed when an entry is taken out.

    Entries of particles that were removed stay until there is no room; then they are dropped.

    Attributes:
        count: number of entries.
    """

    def __init__(self) -> None:
        self.count = 0
        # No room at first: all that lays a table out is compiled when the first spring is kept.
        self._allocate(1)

    def _allocate(self, num_slots: int) -> None:
        self._pair_key = np.zeros(num_slots, np.uint64)
        self._spring = np.zeros((num_slots, 3), np.float32)

    @property
    def num_slots(self) -> int:
        """Number of slots, a power of two."""
        return len(self._pair_key)

    def save(self, state: ParticleState, old: PairTable, num_marked: int) -> None:
        """Keep the springs of the pairs of the table `old` that are marked as both at rest.

        Those in a tool are not kept: springs are in map axes, and the tool turns. What rides wakes
        because it is tilted or shaken, and finds its hold anew.

        Args:
            store: the particles.
            old: its marked pairs in present rows, see `listing.find_pairs`.
            marked: how many there are.
        """
        if 4 * (self.count + num_marked) > 3 * self.num_slots:
            self._grow_table(num_marked, state.particle_id)
        self.count += _save(
            old.first, old.second, old.count, old.contact_flag, old.spring, state.particle_id,
            state.sleep_state, self._pair_key, self._spring,
        )  # fmt: skip

    def restore(self, state: ParticleState, was_active: NDArray[np.bool_], new: PairTable) -> None:
        """Give the pairs of the table `new` of which both rested until now their springs.

        Args:
            store: the particles; `pair_list_row` is still that of the table before.
            live_before: which rows of that were live.
            new: its `touching` and `spring` are updated.
        """
        if self.count:
            self.count -= _restore(
                new.first, new.second, new.count, new.contact_flag, new.spring, state.particle_id,
                state.pair_list_row, was_active, self._pair_key, self._spring,
            )  # fmt: skip

    def _grow_table(self, more: int, live_ids: NDArray[np.uint32]) -> None:
        """Drop entries of those not alive, and lay the table out for `more` besides the others.

        It has as many slots as particles at least, so that looking through all of them is rare.
        """
        used = np.flatnonzero(self._pair_key)
        key, spring = self._pair_key[used], self._spring[used]
        lower, higher = (key >> _ID_BITS).astype(np.uint32), key.astype(np.uint32)
        kept = np.isin(lower, live_ids) & np.isin(higher, live_ids)
        self.count = int(np.count_nonzero(kept))
        least = max(2 * (self.count + more), len(live_ids), _MIN_SLOTS)
        self._allocate(1 << (least - 1).bit_length())
        _insert_all(key[kept], spring[kept], self._pair_key, self._spring)


@kernel
def _pair_key(one, other):  # type: ignore[no-untyped-def]
    """Key of a pair of ids, the same whichever comes first."""
    return (np.uint64(min(one, other)) << _ID_BITS) | np.uint64(max(one, other))


@kernel
def _home_slot(key, table):  # type: ignore[no-untyped-def]
    """The slot where a key belongs."""
    key *= _MIX
    return (key ^ (key >> _ID_BITS)) & np.uint64(table.size - 1)


@kernel
def _find_slot(key, table):  # type: ignore[no-untyped-def]
    """The slot where a key is; the empty one where it would go, if it is not there."""
    slot, last = _home_slot(key, table), np.uint64(table.size - 1)
    while table[slot] != key and table[slot] != _EMPTY:
        slot = (slot + _ONE) & last
    return slot


@kernel
def _remove_slot(gap, table, springs):  # type: ignore[no-untyped-def]
    """Empty a slot: those behind that could not have it before move up."""
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
    """Enter keys that are not there, with their springs."""
    for k in range(key.size):
        slot = _find_slot(key[k], table)
        table[slot] = key[k]
        for axis in range(3):
            springs[slot, axis] = spring[k, axis]


@kernel
def _save(first, second, count, contact_flag, spring, ids, sleep_state, table, springs):  # type: ignore[no-untyped-def]
    """Enter the marked pairs, with their springs as the higher id's; returns how many are new."""
    new = 0
    for k in range(count):
        i, j = first[k], second[k]
        if contact_flag[k] != BOTH_ASLEEP or sleep_state[i] > 1 or sleep_state[j] > 1:
            continue
        key = _pair_key(ids[i], ids[j])
        slot = _find_slot(key, table)
        new += table[slot] == _EMPTY
        table[slot] = key
        sign = np.float32(1.0) if ids[i] < ids[j] else np.float32(-1.0)
        for axis in range(3):
            springs[slot, axis] = sign * spring[k, axis]
    return new


@kernel
def _restore(  # type: ignore[no-untyped-def]
    first, second, count, contact_flag, spring, ids, old_row, was_active, table, springs
):
    """Take out the pairs that were there when the table before was made and did not move.

    Returns:
        How many were found.
    """
    found = 0
    for k in range(count):
        i, j = first[k], second[k]
        if old_row[i] < 0 or was_active[old_row[i]] or old_row[j] < 0 or was_active[old_row[j]]:
            continue
        slot = _find_slot(_pair_key(ids[i], ids[j]), table)
        if table[slot] == _EMPTY:
            continue
        contact_flag[k] = 1
        sign = np.float32(1.0) if ids[i] < ids[j] else np.float32(-1.0)
        for axis in range(3):
            spring[k, axis] = sign * springs[slot, axis]
        _remove_slot(slot, table, springs)
        found += 1
    return found
