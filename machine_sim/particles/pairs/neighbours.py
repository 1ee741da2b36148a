"""Which particles may touch: a half Verlet list, rebuilt by counting sort when it has worn out.

A pair is listed when it is closer than the *sizes* and the *skins* of both. A particle's skin is as
far as it comes in the next steps, relative to the mean of all (a bucket that carries all of them
wears out nothing), and a little more; the list holds until one has used its skin up.

Its size is the contact radius that it grows to in these steps: particles just released are small
and lie close. One that has outgrown it wears the list out, too.

A few fast ones, crumbs that fall past a full bucket, would make the cells of all large or the list
short-lived. They are *strays*: no cell holds them, each is compared with all others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.jit import use_threads
from machine_sim.particles.growth import growth_in
from machine_sim.particles.pairs.cells import rows_around, sort_rows
from machine_sim.particles.pairs.dormant import DormantSprings
from machine_sim.particles.pairs.listing import list_pairs
from machine_sim.particles.pairs.relisting import admit_rows, common_way, drop_pairs
from machine_sim.particles.pairs.skins import ROOM, STEPS, grow_ahead, is_worn, lay_skins
from machine_sim.particles.pairs.table import PairTable
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.parts import cut_parts
from machine_sim.particles.store import ParticleStore

__all__ = ["NeighbourList"]

_LONGEST = 0.35
"""Longest skin of a particle in a cell, in largest diameters, where a list holds for more than a
step."""
_COMPARED = 1 << 18
"""Most comparisons for strays in a build: each is half a nanosecond."""
_MOST_WITH_STRAYS = 1 << 13
"""Most particles among which there are strays: the list of more is cut into parts (`parts`), and
what strays touch lies in any."""


class NeighbourList:
    """The pair table, kept good.

    Attributes:
        pairs: the present table.
        dormant: springs of pairs that rest and are not listed.
        stale: whether rows changed, so that it must be built anew.
        builds: how often it was built.
        wear: how often among many that move, since its owner set it to 0 (few disorder little).
    """

    def __init__(self, params: ParticleParams) -> None:
        self._params = params
        self.pairs = PairTable(4096, 0)
        self._spare = PairTable(4096, 0)
        self.dormant = DormantSprings()
        self._live = np.zeros(0, np.bool_)
        self._origin: NDArray[np.float64] = np.zeros((0, 3))
        self._skins = np.zeros(0)
        self._sizes = np.zeros(0)
        self.stale = True
        self.builds = 0
        self.wear = 0

    @property
    def threads(self) -> int:
        """How many pay in a step with this list."""
        return use_threads(self._params.threads) if self.pairs.parted else 1

    @property
    def listed(self) -> int:
        """How many particles are in it, the first so many rows."""
        return len(self._live)

    def drop(self, store: ParticleStore, kept: NDArray[np.intp]) -> None:
        """Take out who was removed from the store.

        Args:
            store: the particles that are left.
            kept: the rows they had, ascending.
        """
        if self.stale or self.pairs.parted:
            self.stale = True
            return
        pairs, kept = self.pairs, kept[kept < self.listed]
        pairs.count = drop_pairs(
            kept, self.listed, pairs.first, pairs.second, pairs.touching, pairs.spring, pairs.count
        )
        pairs.bounds = np.array([0, pairs.count])
        self._live, self._origin = self._live[kept], self._origin[kept]
        self._skins, self._sizes = self._skins[kept], self._sizes[kept]
        store.pair_row[: kept.size] = np.arange(kept.size, dtype=np.int32)

    def admit(self, store: ParticleStore, seen: NDArray[np.int64], dt: float) -> None:
        """List who was added to the store, behind the others; arguments as for `build`."""
        listed, count, pairs = self.listed, store.count, self.pairs
        live = _live(store)
        every = seen.size == count
        old = seen[seen < listed]
        way, drift = np.zeros(3), np.zeros(3)
        if every and old.size:
            way, drift = common_way(old, store.position, self._origin), store.velocity[old].mean(0)
        speed = np.linalg.norm(store.velocity[listed:] - drift, axis=1)
        skins = self._base(store) + ROOM * dt * STEPS * speed
        self._skins = np.concatenate([self._skins, skins])
        self._sizes = np.concatenate([self._sizes, self._sizes_for(store, dt)[listed:]])
        self._origin = np.concatenate([self._origin, store.position[listed:] - way])
        self._live = np.concatenate([self._live, live[listed:]])
        found = admit_rows(
            listed, live, self._origin, self._sizes, self._skins, pairs.first, pairs.second,
            pairs.touching, pairs.spring, pairs.count,
        )  # fmt: skip
        if found < 0:
            self.build(store, seen, dt)
            return
        pairs.count = found
        pairs.bounds = np.array([0, found])
        store.pair_row[listed:] = np.arange(listed, count, dtype=np.int32)

    def worn(self, store: ParticleStore, seen: NDArray[np.int64], dt: float) -> bool:
        """Whether it must be built before the next step of `dt` [s].

        Args:
            store: the particles.
            seen: rows whose motion counts: all, or those that move.
            dt: [s].
        """
        new = store.count - self.listed
        if self.stale or (new and (self.pairs.parted or new * store.count > _COMPARED)):
            self.stale = True
            return True
        old = seen[seen < self.listed] if new else seen
        return old.size > 0 and bool(
            is_worn.on(self.threads)(
                old, old.size == self.listed, store.position, store.velocity, self._origin,
                self._skins, store.contact_radius, store.radius, self._sizes,
                self._params.release_size, growth_in(dt, self._params), dt,
            )
        )  # fmt: skip

    def _base(self, store: ParticleStore) -> float:
        """Skin of one that does not move [m]."""
        return self._params.skin * float(store.radius.mean())

    def _sizes_for(self, store: ParticleStore, dt: float) -> NDArray[np.float64]:
        """Size of each in a list that is made now [m]."""
        sizes = np.empty(store.count)
        grow_ahead(
            store.contact_radius, store.radius, self._params.release_size,
            STEPS * growth_in(dt, self._params), sizes,
        )  # fmt: skip
        return sizes

    def build(self, store: ParticleStore, seen: NDArray[np.int64], dt: float) -> None:
        """List anew for steps of `dt` [s], carrying the history over.

        Args:
            store: the particles.
            seen: rows whose motion counts, one at least: all, or those that move.
            dt: [s].
        """
        live = _live(store)
        every = seen.size == store.count
        self._skins, self._sizes = np.zeros(store.count), self._sizes_for(store, dt)
        longest = 2.0 * _LONGEST * float(store.radius.max())
        most_strays = min(_COMPARED // store.count, seen.size // 2)
        if store.count > _MOST_WITH_STRAYS:
            most_strays = 0
        largest, strays = lay_skins(
            seen, every, store.velocity, dt, self._base(store), longest, most_strays, self._skins
        )
        cell = 2.0 * float(self._sizes.max()) + 2.0 * largest
        few = int(np.count_nonzero(live)) * 2 < store.count
        rows = rows_around(store.position, seen, cell) if few else np.arange(store.count)
        if strays.size:
            in_cells = np.ones(store.count, np.bool_)
            in_cells[strays] = False
            rows = rows[in_cells[rows]]
        sorting = sort_rows(rows, store.position, cell)
        while not self._build(store, live, few, sorting, strays):
            self._spare = PairTable(2 * len(self._spare.first), 0)
        self.pairs, self._spare = self._spare, self.pairs
        self._origin, self._live = store.position.copy(), live
        store.pair_row[:] = np.arange(store.count, dtype=np.int32)
        self.builds += 1
        self.wear += not few
        self.stale = False

    def _build(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, live, few, sorting, strays
    ) -> bool:
        """Fill the spare table; False where it has too little room."""
        old, new = self.pairs, self._spare
        if len(new.begin) < store.count:
            room = max(store.count, 2 * len(new.begin))
            new.begin, new.end = np.zeros(room, np.int64), np.zeros(room, np.int64)
        new.begin[: store.count] = new.end[: store.count] = 0
        slabs = np.zeros(sorting[3][1] + 1, np.int64)
        new.count, rest = list_pairs.on(self.threads)(
            *sorting, strays, live, few,
            store.position, self._sizes, self._skins, store.pair_row,
            old.first, old.second, old.touching, old.spring, old.count,
            new.first, new.second, new.touching, new.spring, new.begin, new.end, slabs,
        )  # fmt: skip
        if new.count < 0:
            return False
        self.dormant.give_back(store, self._live, new)
        if rest:
            self.dormant.keep(store, old, rest)
        whole = np.array([0, new.count])
        new.bounds = whole if strays.size else cut_parts(slabs, 2 if few else 1)
        return True


def _live(store: ParticleStore) -> NDArray[np.bool_]:
    """Which rows move by forces, shape (n,); two that do not are no pair."""
    return np.asarray((store.resting == 0) & ~store.frozen, dtype=np.bool_)
