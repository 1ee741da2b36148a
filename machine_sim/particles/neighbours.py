"""Which particles may touch: a half Verlet list, rebuilt by counting sort when it has worn out.

A pair is listed when it is closer than touching plus a skin. The list holds until a particle has
moved half the skin away from the mean motion of all (a bucket that carries all of them wears out
nothing). Where particles are faster than that, the list holds one step only, and a pair that
closes in is listed as far off as it comes in that step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.jit import kernel
from machine_sim.particles.store import ParticleStore

__all__ = ["NeighbourList", "PairTable"]

_HORIZON = 1.3
"""How far ahead a fast pair is looked for, in steps: one, and room for acceleration."""

_NONE = np.float32(0.0)


class PairTable:
    """Listed pairs and their contact history.

    Attributes:
        first, second: rows of each pair, uint32.
        touching, spring: history, see `pairs.pair_forces`.
        begin, end: pairs of each row that is `first`, shape (n,).
        count: number of pairs.
    """

    def __init__(self, room: int, rows: int) -> None:
        self.first = np.zeros(room, np.uint32)
        self.second = np.zeros(room, np.uint32)
        self.touching = np.zeros(room, np.uint8)
        self.spring = np.zeros((room, 3), np.float32)
        self.begin = np.zeros(rows, np.int64)
        self.end = np.zeros(rows, np.int64)
        self.count = 0


class NeighbourList:
    """The pair table, kept good.

    Attributes:
        pairs: the present table.
        stale: whether rows changed, so that it must be built anew.
        builds: how often it was built.
    """

    def __init__(self, skin: float) -> None:
        self._skin = skin
        self.pairs = PairTable(4096, 0)
        self._spare = PairTable(4096, 0)
        self._origin: NDArray[np.float64] = np.zeros((0, 3))
        self.stale = True
        self.builds = 0

    def refresh(self, store: ParticleStore, dt: float) -> None:
        """Make the list good for the next step of `dt` [s], carrying the history over."""
        if store.count == 0:
            self.pairs.count = 0
            self.stale = True
            return
        skin = self._skin * 2.0 * float(store.radius.mean())
        if not self.stale and not _worn(store.position, store.velocity, self._origin, skin, dt):
            return
        # Two of them close in at twice the speed relative to the mean.
        closing = 2.0 * _relative_speed(store.velocity) * _HORIZON * dt
        reach = 2.0 * float(store.radius.max())
        cell = reach + max(skin, min(closing, 0.5 * reach))
        ahead = _HORIZON * dt if closing > skin else 0.0
        order, start, cells, sizes = _sort(store.position, cell)
        while not self._build(store, order, start, cells, sizes, cell, skin, ahead):
            self._spare = PairTable(2 * len(self._spare.first), 0)
        self.pairs, self._spare = self._spare, self.pairs
        self._origin = store.position.copy()
        store.pair_row[:] = np.arange(store.count, dtype=np.int32)
        self.builds += 1
        self.stale = False

    def _build(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, order, start, cells, sizes, cell, skin, ahead
    ) -> bool:
        """Fill the spare table; False where it has too little room."""
        old, new = self.pairs, self._spare
        if len(new.begin) < store.count:
            room = max(store.count, 2 * len(new.begin))
            new.begin, new.end = np.zeros(room, np.int64), np.zeros(room, np.int64)
        new.count = _list_pairs(
            order, start, cells, sizes, cell, skin, ahead,
            store.position, store.velocity, store.radius, store.pair_row,
            old.second, old.touching, old.spring, old.begin, old.end,
            new.first, new.second, new.touching, new.spring, new.begin, new.end,
        )  # fmt: skip
        return bool(new.count >= 0)


def spatial_order(store: ParticleStore) -> NDArray[np.intp]:
    """Rows sorted by place, so that neighbours in space are neighbours in memory."""
    return np.asarray(_sort(store.position, 2.2 * float(store.radius.max()))[0], dtype=np.intp)


@kernel
def _worn(position, velocity, origin, skin, dt):  # type: ignore[no-untyped-def]
    """Whether some particle may leave the mean motion by half the skin within the next step."""
    n = position.shape[0]
    mx, my, mz, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        mx += position[i, 0] - origin[i, 0]
        my += position[i, 1] - origin[i, 1]
        mz += position[i, 2] - origin[i, 2]
        ux += velocity[i, 0]
        uy += velocity[i, 1]
        uz += velocity[i, 2]
    mx, my, mz = (mx + dt * ux) / n, (my + dt * uy) / n, (mz + dt * uz) / n
    limit = 0.25 * skin * skin
    for i in range(n):
        dx = position[i, 0] - origin[i, 0] + dt * velocity[i, 0] - mx
        dy = position[i, 1] - origin[i, 1] + dt * velocity[i, 1] - my
        dz = position[i, 2] - origin[i, 2] + dt * velocity[i, 2] - mz
        if dx * dx + dy * dy + dz * dz > limit:
            return True
    return False


@kernel
def _relative_speed(velocity):  # type: ignore[no-untyped-def]
    """Largest speed [m/s] relative to the mean velocity."""
    n = velocity.shape[0]
    ux, uy, uz = 0.0, 0.0, 0.0
    for i in range(n):
        ux += velocity[i, 0]
        uy += velocity[i, 1]
        uz += velocity[i, 2]
    ux, uy, uz = ux / n, uy / n, uz / n
    largest = 0.0
    for i in range(n):
        dx, dy, dz = velocity[i, 0] - ux, velocity[i, 1] - uy, velocity[i, 2] - uz
        largest = max(largest, dx * dx + dy * dy + dz * dz)
    return np.sqrt(largest)


@kernel
def _sort(position, cell):  # type: ignore[no-untyped-def]
    """Counting sort of rows by cell, y slowest and z fastest, one empty layer all around.

    Only the bulk (3 standard deviations about the mean) gets cells of its own; what lies beyond
    is put into the outermost ones. That keeps their number near that of the particles, and never
    parts two neighbours, as it brings cell indices only closer together.

    Returns:
        order (row at each place), start (first place of each cell), cells (cell at each place),
        sizes (cells along x, z).
    """
    n = position.shape[0]
    low, shape = np.zeros(3), np.zeros(3, np.int64)
    for axis in range(3):
        total, lowest, highest = 0.0, 1e300, -1e300
        for i in range(n):
            p = position[i, axis]
            total += p
            lowest, highest = min(lowest, p), max(highest, p)
        mean, spread = total / n, 0.0
        for i in range(n):
            spread += (position[i, axis] - mean) ** 2
        spread = 3.0 * np.sqrt(spread / n)
        low[axis] = max(lowest, mean - spread)
        width = min(highest, mean + spread) - low[axis]
        shape[axis] = int(min(width / cell, 1e6)) + 3
    while shape[0] * shape[1] * shape[2] > 10 * n + 1000:
        for axis in range(3):
            shape[axis] = max(3, shape[axis] * 4 // 5)
    nx, ny, nz = shape[0], shape[1], shape[2]
    inverse = 1.0 / cell
    index = np.empty(n, np.int32)
    start = np.zeros(nx * ny * nz + 1, np.int32)
    for i in range(n):
        # Clamped as floats first: a far stray must not overflow the integer.
        x = int(min(max((position[i, 0] - low[0]) * inverse + 1.0, 1.0), nx - 2.0))
        y = int(min(max((position[i, 1] - low[1]) * inverse + 1.0, 1.0), ny - 2.0))
        z = int(min(max((position[i, 2] - low[2]) * inverse + 1.0, 1.0), nz - 2.0))
        x, y, z = min(max(x, 1), nx - 2), min(max(y, 1), ny - 2), min(max(z, 1), nz - 2)
        c = (y * nx + x) * nz + z
        index[i] = c
        start[c + 1] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    place = start[:-1].copy()
    order, cells = np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(n):
        c = index[i]
        order[place[c]] = i
        cells[place[c]] = c
        place[c] += 1
    return order, start, cells, (nx, nz)


@kernel
def _list_pairs(  # type: ignore[no-untyped-def]
    order, start, cells, sizes, cell, skin, ahead,
    position, velocity, radius, old_row,
    old_second, old_touching, old_spring, old_begin, old_end,
    first, second, touching, spring, begin, end,
):  # fmt: skip
    """Fill the table with all pairs closer than touching plus `skin`, and those that close in.

    Args:
        order, start, cells, sizes: of `_sort`.
        cell, skin: [m].
        ahead: time [s] to look ahead for closing pairs, 0 for none.
        position, velocity, radius: of the particles, by row.
        old_row: row of each in the old table, -1 if it has none.
        old_*: the old table. The rest: the new one.

    Returns:
        Number of pairs, or -1 where the table is too small.
    """
    n = order.size
    nx, nz = sizes
    # float32 relative to a particle in the middle: near enough for a list with a skin.
    x, v, r = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    for a in range(n):
        i = order[a]
        r[a] = radius[i]
        for axis in range(3):
            x[a, axis] = position[i, axis] - position[0, axis]
            v[a, axis] = velocity[i, axis]
    skin, ahead, cell2 = np.float32(skin), np.float32(ahead), np.float32(cell * cell)
    count = 0
    for a in range(n):
        i = order[a]
        begin[i] = count
        c = cells[a]
        for strip in range(5):
            # Half of the 27 cells around, in 5 strips along z.
            if strip == 0:
                low, high = a + 1, start[c + 2]
            else:
                middle = c + nz if strip == 1 else c + (nx + strip - 3) * nz
                low, high = start[middle - 1], start[middle + 2]
            if count + high - low > first.size:
                return -1
            for b in range(low, high):
                dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
                d2 = dx * dx + dy * dy + dz * dz
                reach = r[a] + r[b]
                near = reach + skin
                listed = d2 < near * near
                if ahead > _NONE and not listed and d2 < cell2:
                    vx, vy, vz = v[b, 0] - v[a, 0], v[b, 1] - v[a, 1], v[b, 2] - v[a, 2]
                    if vx * dx + vy * dy + vz * dz < _NONE:
                        near += ahead * np.sqrt(vx * vx + vy * vy + vz * vz)
                        listed = d2 < near * near
                first[count] = i
                second[count] = order[b]
                count += np.int64(listed)
        end[i] = count
    for k in range(count):
        touching[k] = 0
        i, j = old_row[first[k]], old_row[second[k]]
        if i < 0 or j < 0:
            continue
        sign = np.float32(1.0)
        found = _find(old_second, old_begin[i], old_end[i], j)
        if found < 0:
            found = _find(old_second, old_begin[j], old_end[j], i)
            sign = np.float32(-1.0)
        if found >= 0 and old_touching[found] & np.uint8(1):
            touching[k] = 1
            for axis in range(3):
                spring[k, axis] = sign * old_spring[found, axis]
    return count


@kernel
def _find(second, low, high, row):  # type: ignore[no-untyped-def]
    """Place of `row` in second[low:high], -1 if it is not there."""
    for k in range(low, high):
        if second[k] == row:
            return k
    return -1
