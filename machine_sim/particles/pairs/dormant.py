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

from machine_sim.jit import kernel
from machine_sim.particles.pairs.listing import RESTS
from machine_sim.particles.pairs.table import PairTable
from machine_sim.particles.store import ParticleStore

__all__ = ["DormantSprings"]

_LEAST_ROOM = 1024
_EMPTY = np.uint64(0)
"""Key of no pair: ids are from 1."""
_ONE = np.uint64(1)
_HALF = np.uint64(32)
_MIX = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio: Knuth, The Art of Computer Programming 3, section 6.4."""


class DormantSprings:
    """The table: open addressing, the next free slot taken, gaps closed when an entry is taken out.

    Entries of particles that were removed stay until there is no room; then they are dropped.

    Attributes:
        count: number of entries.
    """

    def __init__(self) -> None:
        self.count = 0
        # No room at first: all that lays a table out is compiled when the first spring is kept.
        self._lay_out(1)

    def _lay_out(self, room: int) -> None:
        self._key = np.zeros(room, np.uint64)
        self._spring = np.zeros((room, 3), np.float32)

    @property
    def room(self) -> int:
        """Number of slots, a power of two."""
        return len(self._key)

    def keep(self, store: ParticleStore, old: PairTable, marked: int) -> None:
        """Keep the springs of the pairs of the table `old` that are marked as both at rest.

        Those in a tool are not kept: springs are in map axes, and the tool turns. What rides wakes
        because it is tilted or shaken, and finds its hold anew.

        Args:
            store: the particles.
            old: its marked pairs in present rows, see `listing.list_pairs`.
            marked: how many there are.
        """
        if 4 * (self.count + marked) > 3 * self.room:
            self._make_room(marked, store.particle_id)
        self.count += _keep(
            old.first, old.second, old.count, old.touching, old.spring, store.particle_id,
            store.resting, self._key, self._spring,
        )  # fmt: skip

    def give_back(
        self, store: ParticleStore, live_before: NDArray[np.bool_], new: PairTable
    ) -> None:
        """Give the pairs of the table `new` of which both rested until now their springs.

        Args:
            store: the particles; `pair_row` is still that of the table before.
            live_before: which rows of that were live.
            new: its `touching` and `spring` are updated.
        """
        if self.count:
            self.count -= _give_back(
                new.first, new.second, new.count, new.touching, new.spring, store.particle_id,
                store.pair_row, live_before, self._key, self._spring,
            )  # fmt: skip

    def _make_room(self, more: int, alive: NDArray[np.uint32]) -> None:
        """Drop entries of those not alive, and lay the table out for `more` besides the others.

        It has as many slots as particles at least, so that looking through all of them is rare.
        """
        used = np.flatnonzero(self._key)
        key, spring = self._key[used], self._spring[used]
        lower, higher = (key >> _HALF).astype(np.uint32), key.astype(np.uint32)
        kept = np.isin(lower, alive) & np.isin(higher, alive)
        self.count = int(np.count_nonzero(kept))
        least = max(2 * (self.count + more), len(alive), _LEAST_ROOM)
        self._lay_out(1 << (least - 1).bit_length())
        _put_all(key[kept], spring[kept], self._key, self._spring)


@kernel
def _key(one, other):  # type: ignore[no-untyped-def]
    """Key of a pair of ids, the same whichever comes first."""
    return (np.uint64(min(one, other)) << _HALF) | np.uint64(max(one, other))


@kernel
def _home(key, table):  # type: ignore[no-untyped-def]
    """The slot where a key belongs."""
    key *= _MIX
    return (key ^ (key >> _HALF)) & np.uint64(table.size - 1)


@kernel
def _find(key, table):  # type: ignore[no-untyped-def]
    """The slot where a key is; the empty one where it would go, if it is not there."""
    slot, last = _home(key, table), np.uint64(table.size - 1)
    while table[slot] != key and table[slot] != _EMPTY:
        slot = (slot + _ONE) & last
    return slot


@kernel
def _empty(gap, table, springs):  # type: ignore[no-untyped-def]
    """Empty a slot: those behind that could not have it before move up."""
    last = np.uint64(table.size - 1)
    slot = (gap + _ONE) & last
    while table[slot] != _EMPTY:
        if (slot - _home(table[slot], table)) & last >= (slot - gap) & last:
            table[gap] = table[slot]
            for axis in range(3):
                springs[gap, axis] = springs[slot, axis]
            gap = slot
        slot = (slot + _ONE) & last
    table[gap] = _EMPTY


@kernel
def _put_all(key, spring, table, springs):  # type: ignore[no-untyped-def]
    """Enter keys that are not there, with their springs."""
    for k in range(key.size):
        slot = _find(key[k], table)
        table[slot] = key[k]
        for axis in range(3):
            springs[slot, axis] = spring[k, axis]


@kernel
def _keep(first, second, count, touching, spring, ids, resting, table, springs):  # type: ignore[no-untyped-def]
    """Enter the marked pairs, with their springs as the higher id's; returns how many are new."""
    new = 0
    for k in range(count):
        i, j = first[k], second[k]
        if touching[k] != RESTS or resting[i] > 1 or resting[j] > 1:
            continue
        key = _key(ids[i], ids[j])
        slot = _find(key, table)
        new += table[slot] == _EMPTY
        table[slot] = key
        sign = np.float32(1.0) if ids[i] < ids[j] else np.float32(-1.0)
        for axis in range(3):
            springs[slot, axis] = sign * spring[k, axis]
    return new


@kernel
def _give_back(  # type: ignore[no-untyped-def]
    first, second, count, touching, spring, ids, old_row, live_before, table, springs
):
    """Take out the pairs that were there when the table before was made and did not move.

    Returns:
        How many were found.
    """
    found = 0
    for k in range(count):
        i, j = first[k], second[k]
        if old_row[i] < 0 or live_before[old_row[i]] or old_row[j] < 0 or live_before[old_row[j]]:
            continue
        slot = _find(_key(ids[i], ids[j]), table)
        if table[slot] == _EMPTY:
            continue
        touching[k] = 1
        sign = np.float32(1.0) if ids[i] < ids[j] else np.float32(-1.0)
        for axis in range(3):
            spring[k, axis] = sign * springs[slot, axis]
        _empty(slot, table, springs)
        found += 1
    return found
