"""Which particles may touch: a half Verlet list, rebuilt by counting sort when it has worn out.

A pair is listed when it is closer than touching plus the *skins* of both. A particle's skin is as
far as it comes in the next steps, relative to the mean of all (a bucket that carries all of them
wears out nothing), and a little more; the list holds until one has used its skin up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.cells import rows_around, sort_rows
from machine_sim.particles.jit import kernel
from machine_sim.particles.parts import cut_parts
from machine_sim.particles.store import ParticleStore

__all__ = ["NeighbourList", "PairTable"]

_STEPS = 5.0
"""For how many steps a list should hold where particles move."""
_ROOM = 1.3
"""Room for acceleration: how far ahead a particle is looked for, over how far it comes."""
_LONGEST = 0.35
"""Longest skin of a particle, in largest diameters, where a list holds for more than a step."""


class PairTable:
    """Listed pairs and their contact history.

    Attributes:
        first, second: rows of each pair, uint32.
        touching, spring: history, see `pairs.pair_forces`.
        begin, end: pairs of each row that is `first`, shape (n,).
        bounds: of its parts, see `parts.cut_parts`.
        count: number of pairs.
    """

    def __init__(self, room: int, rows: int) -> None:
        self.first = np.zeros(room, np.uint32)
        self.second = np.zeros(room, np.uint32)
        self.touching = np.zeros(room, np.uint8)
        self.spring = np.zeros((room, 3), np.float32)
        self.begin = np.zeros(rows, np.int64)
        self.end = np.zeros(rows, np.int64)
        self.bounds = np.zeros(2, np.int64)
        self.count = 0

    @property
    def parted(self) -> bool:
        """Whether there is more than one region for several threads to work in."""
        return len(self.bounds) > 2


class NeighbourList:
    """The pair table, kept good.

    Attributes:
        pairs: the present table.
        stale: whether rows changed, so that it must be built anew.
        builds: how often it was built.
        wear: how often among many that move, since its owner set it to 0 (few disorder little).
    """

    def __init__(self, skin: float) -> None:
        self._skin = skin
        self.pairs = PairTable(4096, 0)
        self._spare = PairTable(4096, 0)
        self._origin: NDArray[np.float64] = np.zeros((0, 3))
        self._skins = np.zeros(0)
        self.stale = True
        self.builds = 0
        self.wear = 0

    def refresh(
        self,
        store: ParticleStore,
        moving: NDArray[np.int64],
        live: NDArray[np.bool_],
        dt: float,
    ) -> None:
        """Make the list good for the next step of `dt` [s], carrying the history over.

        Args:
            store: the particles.
            moving: rows that move.
            live: which rows move by forces, shape (n,); two that do not are no pair.
            dt: [s].
        """
        if moving.size == 0:
            if self.stale:
                self.pairs.count, self.pairs.bounds = 0, np.zeros(2, np.int64)
            return
        alone = moving.size == store.count
        base = self._skin * float(store.radius.mean())
        if not self.stale and not _worn(
            moving, alone, store.position, store.velocity, self._origin, self._skins, dt
        ):
            return
        if len(self._skins) < store.count:
            self._skins = np.zeros(max(store.count, 2 * len(self._skins)))
        self._skins[:] = 0.0
        longest = 2.0 * _LONGEST * float(store.radius.max())
        largest = _lay_skins(moving, alone, store.velocity, dt, base, longest, self._skins)
        cell = 2.0 * float(store.radius.max()) + 2.0 * largest
        few = int(np.count_nonzero(live)) * 2 < store.count
        rows = rows_around(store.position, moving, cell) if few else np.arange(store.count)
        order, start, cells, sizes = sort_rows(rows, store.position, cell)
        while not self._build(store, live, few, order, start, cells, sizes):
            self._spare = PairTable(2 * len(self._spare.first), 0)
        self.pairs, self._spare = self._spare, self.pairs
        self._origin = store.position.copy()
        store.pair_row[:] = np.arange(store.count, dtype=np.int32)
        self.builds += 1
        self.wear += not few
        self.stale = False

    def _build(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, live, few, order, start, cells, sizes
    ) -> bool:
        """Fill the spare table; False where it has too little room."""
        old, new = self.pairs, self._spare
        if len(new.begin) < store.count:
            room = max(store.count, 2 * len(new.begin))
            new.begin, new.end = np.zeros(room, np.int64), np.zeros(room, np.int64)
        new.begin[: store.count] = new.end[: store.count] = 0
        slabs = np.zeros(sizes[1] + 1, np.int64)
        new.count = _list_pairs(
            order, start, cells, sizes, live, few,
            store.position, store.radius, self._skins, store.pair_row,
            old.first, old.second, old.touching, old.spring, old.count,
            new.first, new.second, new.touching, new.spring, new.begin, new.end, slabs,
        )  # fmt: skip
        if new.count < 0:
            return False
        new.bounds = cut_parts(slabs, 2 if few else 1)
        return True


@kernel
def _worn(rows, alone, position, velocity, origin, skins, dt):  # type: ignore[no-untyped-def]
    """Whether one of `rows` may leave the mean motion by its skin within the next step.

    Where others rest beside them, none is meant.
    """
    n = rows.size
    mx, my, mz, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in rows:
        mx += position[i, 0] - origin[i, 0]
        my += position[i, 1] - origin[i, 1]
        mz += position[i, 2] - origin[i, 2]
        ux += velocity[i, 0]
        uy += velocity[i, 1]
        uz += velocity[i, 2]
    share = 1.0 / n if alone else 0.0
    mx, my, mz = (mx + dt * ux) * share, (my + dt * uy) * share, (mz + dt * uz) * share
    for i in rows:
        dx = position[i, 0] - origin[i, 0] + dt * velocity[i, 0] - mx
        dy = position[i, 1] - origin[i, 1] + dt * velocity[i, 1] - my
        dz = position[i, 2] - origin[i, 2] + dt * velocity[i, 2] - mz
        if dx * dx + dy * dy + dz * dz > skins[i] * skins[i]:
            return True
    return False


@kernel
def _lay_skins(rows, alone, velocity, dt, base, longest, skins):  # type: ignore[no-untyped-def]
    """Fill the `skins` of `rows` [m]: `base`, and the way relative to the mean in some steps.

    `_STEPS` of them, fewer where the fastest would go farther than `longest`, but one at least.

    Returns:
        The longest skin [m].
    """
    ux, uy, uz = 0.0, 0.0, 0.0
    for i in rows:
        ux += velocity[i, 0]
        uy += velocity[i, 1]
        uz += velocity[i, 2]
    share = 1.0 / rows.size if alone else 0.0
    ux, uy, uz = ux * share, uy * share, uz * share
    fastest = 0.0
    for i in rows:
        dx, dy, dz = velocity[i, 0] - ux, velocity[i, 1] - uy, velocity[i, 2] - uz
        speed = np.sqrt(dx * dx + dy * dy + dz * dz)
        skins[i] = speed
        fastest = max(fastest, speed)
    step = _ROOM * dt * fastest
    steps = min(max(longest / max(step, 1e-12), 1.0), _STEPS)
    for i in rows:
        skins[i] = base + _ROOM * dt * steps * skins[i]
    return base + step * steps


@kernel
def _mark_near(around, own, others, mark):  # type: ignore[no-untyped-def]
    """Mark which of those around (x, y, z, size by row of `around`) are near number `own`.

    Marks up to a whole number of eight are written.
    """
    xa, ya, za, sa = around[0, own], around[1, own], around[2, own], around[3, own]
    xs, ys, zs, sizes = around[0], around[1], around[2], around[3]
    for m in range(np.uint64(others)):
        dx, dy, dz, near = xs[m] - xa, ys[m] - ya, zs[m] - za, sizes[m] + sa
        mark[m] = np.uint8(dx * dx + dy * dy + dz * dz < near * near)
    for m in range(others, (others + 7) // 8 * 8):
        mark[m] = np.uint8(0)


@kernel
def _list_pairs(  # type: ignore[no-untyped-def]
    order, start, cells, sizes, live, few, position, radius, skins, old_row,
    old_first, old_second, old_touching, old_spring, old_count,
    first, second, touching, spring, begin, end, slabs,
):  # fmt: skip
    """Fill the table with all pairs closer than touching plus the skins of both.

    Args:
        order, start, cells, sizes: of `sort_rows`.
        live: which rows move by forces.
        few: whether these are few: then only their cells are looked at, and all around them.
        position, radius, skins: of the particles, by row.
        old_row: row of each in the old table, -1 if it has none.
        old_*: the old table. The rest: the new one.
        slabs: out, the first pair of each layer of cells along y, and the end.

    Returns:
        Number of pairs, or -1 where the table is too small.
    """
    n = order.size
    nx, _, nz = sizes
    # float32 relative to a particle in the middle: near enough for a list with a skin.
    x, y, z = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    size = np.empty(n, np.float32)
    middle = order[n // 2]
    for a in range(n):
        i = order[a]
        x[a] = position[i, 0] - position[middle, 0]
        y[a] = position[i, 1] - position[middle, 1]
        z[a] = position[i, 2] - position[middle, 2]
        size[a] = radius[i] + skins[i]
    every = live.all()
    strips = 10 if few else 5
    low, high = np.zeros(10, np.int64), np.zeros(10, np.int64)
    around = np.empty((4, 512), np.float32)
    row, place = np.empty(512, np.uint32), np.empty(512, np.int64)
    mark = np.zeros(520, np.uint8)
    count, a, slab = 0, 0, 0
    while a < n:
        # All of one cell have the same others around: half of the 27 cells, in 5 strips along z,
        # or all of them in 10.
        c = cells[a]
        while slab * nx * nz <= c:
            slabs[slab] = count
            slab += 1
        end_of_cell = start[c + 1]
        lively = not few
        for b in range(a, end_of_cell):
            lively |= live[order[b]]
        if not lively:
            for b in range(a, end_of_cell):
                begin[order[b]] = end[order[b]] = count
            a = end_of_cell
            continue
        low[0], high[0] = a, start[c + 2]
        low[5], high[5] = start[c - 1], a
        others = high[0] - low[0]
        for strip in range(1, strips):
            if strip != 5:
                half = strip % 5
                way = nz if half == 1 else (nx + half - 3) * nz
                middle = c + way if strip < 5 else c - way
                low[strip], high[strip] = start[middle - 1], start[middle + 2]
            others += high[strip] - low[strip] if strip != 5 else high[5] - low[5]
        if others > row.size:
            around = np.empty((4, 2 * others), np.float32)
            row, place = np.empty(2 * others, np.uint32), np.empty(2 * others, np.int64)
            mark = np.zeros(2 * others + 8, np.uint8)
        if count + (end_of_cell - a) * others > first.size:
            return -1
        m = 0
        for strip in range(strips):
            for b in range(low[strip], high[strip]):
                around[0, m], around[1, m], around[2, m] = x[b], y[b], z[b]
                around[3, m] = size[b]
                row[m] = order[b]
                place[m] = b
                m += 1
        words = mark[: mark.size // 8 * 8].view(np.uint64)
        for own in range(end_of_cell - a):
            i = row[own]
            begin[i] = count
            if few and not live[i]:
                end[i] = count
                continue
            alive = live[i]
            _mark_near(around, own, others, mark)
            # Few are near: eight marks are passed over at a time.
            for word in range(0 if few else own // 8, (others + 7) // 8):
                if words[word] == 0:
                    continue
                if every:
                    for m in range(max(8 * word, own + 1), 8 * word + 8):
                        first[count] = i
                        second[count] = row[min(m, others - 1)]
                        count += np.int64(mark[m])
                else:
                    for m in range(8 * word, min(8 * word + 8, others)):
                        if mark[m] == 0:
                            continue
                        j = row[m]
                        # Each pair once: of two that are live by the one that comes first.
                        if place[m] <= a + own and (not few or live[j] or m == own):
                            continue
                        if alive or live[j]:
                            first[count] = i
                            second[count] = j
                            count += 1
            end[i] = count
        a = end_of_cell
    slabs[slab:] = count
    touching[:count] = 0
    # History goes from the old table to the new: of the old pairs only those that touch have one.
    new_row = np.full(old_row.max() + 1, -1, np.int32)
    for i in range(old_row.size):
        if old_row[i] >= 0:
            new_row[old_row[i]] = i
    for m in range(old_count):
        if old_touching[m] == 0:
            continue
        # Rows that were listed last before others were taken away may be beyond the end.
        i = new_row[old_first[m]] if old_first[m] < new_row.size else -1
        j = new_row[old_second[m]] if old_second[m] < new_row.size else -1
        if i < 0 or j < 0:
            continue
        sign = np.float32(1.0)
        k = _find(second, begin[i], end[i], j)
        if k < 0:
            k = _find(second, begin[j], end[j], i)
            sign = np.float32(-1.0)
        if k >= 0:
            touching[k] = 1
            for axis in range(3):
                spring[k, axis] = sign * old_spring[m, axis]
    return count


@kernel
def _find(second, low, high, row):  # type: ignore[no-untyped-def]
    """Place of `row` in second[low:high], -1 if it is not there."""
    for k in range(low, high):
        if second[k] == row:
            return k
    return -1
