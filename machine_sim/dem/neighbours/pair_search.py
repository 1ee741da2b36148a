"""Who is near whom: pairs found cell by cell, and their contact history carried over.

Chunks of the cells are worked at side by side; the list comes out in the order of cells, however
many threads there are.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.partition import NUM_CHUNKS
from msg_bridge.kernels import kernel, threaded_kernel

__all__ = ["BOTH_ASLEEP", "find_pairs"]

BOTH_ASLEEP = 2
"""Mark in `touching` of an old pair that touches and is listed no more, as both rest."""


@threaded_kernel
def find_pairs(  # type: ignore[no-untyped-def]
    order, start, cells, shape, fast_outliers, active, sparse, position, predicted_radii,
    skin_widths, old_row,
    old_first, old_second, old_touching, old_spring, old_count,
    first, second, contact_flag, spring, begin, end, slabs,
):  # fmt: skip
    """Fill the table with all pairs closer than their sizes and skins together.

    Args:
        order, start, cells, shape: of `counting_sort_rows`, the strays not among them.
        strays: rows too fast for the cells: each is compared with all others, and their pairs come
            last.
        live: which rows move by forces.
        few: whether these are few: then only their cells are looked at, and all around them.
        position, sizes, skins: of the particles, by row; see `neighbours`.
        old_row: row of each in the old table, -1 if it has none.
        old_*: the old table. Pairs that `RESTS` are marked in it, their rows made the present ones.
        slabs: out, the first pair of each layer of cells along y, and the end.
        The rest: the new table.

    Returns:
        Number of pairs, or -1 where the table is too small; and how many old ones are so marked.
    """
    n = order.size
    at, is_active = np.empty((4, n), np.float32), np.empty(n, np.uint8)
    for c in prange(NUM_CHUNKS):
        _gather_sorted(
            c * n // NUM_CHUNKS,
            (c + 1) * n // NUM_CHUNKS,
            order,
            position,
            predicted_radii,
            skin_widths,
            active,
            at,
            is_active,
        )
    # Each chunk of the cells fills a stretch of the table; then the stretches are put together.
    found, room = np.zeros(NUM_CHUNKS, np.int64), first.size // NUM_CHUNKS
    for c in prange(NUM_CHUNKS):
        low, high = _chunk_start(c, cells, start), _chunk_start(c + 1, cells, start)
        found[c] = _find_chunk_pairs(
            low, high, order, start, cells, shape, sparse, at, is_active,
            first[c * room : (c + 1) * room], second[c * room : (c + 1) * room], begin, end,
        )  # fmt: skip
    if found.min() < 0:
        return -1, 0
    count = np.int64(0)  # typed, or what it is given to is compiled once more for this 0
    for c in range(NUM_CHUNKS):
        mine = order[_chunk_start(c, cells, start) : _chunk_start(c + 1, cells, start)]
        _compact_chunk(c * room, found[c], count, mine, first, second, begin, end)
        count += found[c]
    nx, ny, nz = shape
    for slab in range(ny):
        a = start[slab * nx * nz]
        slabs[slab] = begin[order[a]] if a < n else count
    count = _find_outlier_pairs(
        fast_outliers,
        active,
        position,
        predicted_radii,
        skin_widths,
        first,
        second,
        begin,
        end,
        count,
    )
    if count < 0:
        return -1, 0
    slabs[ny] = count
    new_row = np.full(old_row.max() + 1, -1, np.int32)
    for i in range(old_row.size):
        if old_row[i] >= 0:
            new_row[old_row[i]] = i
    for c in prange(NUM_CHUNKS):
        contact_flag[c * count // NUM_CHUNKS : (c + 1) * count // NUM_CHUNKS] = 0
    rest = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        rest[c] = _transfer_history(
            c * old_count // NUM_CHUNKS, (c + 1) * old_count // NUM_CHUNKS, new_row,
            active, old_first,
            old_second, old_touching, old_spring, second, begin, end, contact_flag, spring,
        )  # fmt: skip
    return count, rest.sum()


@kernel
def _gather_sorted(low, high, order, position, predicted_radii, skin_widths, active, at, is_active):  # type: ignore[no-untyped-def]
    """Places, sizes and who is live in the order of cells.

    float32 relative to a particle in the middle: near enough for a list with a skin.
    """
    middle = order[order.size // 2]
    for a in range(low, high):
        i = order[a]
        for axis in range(3):
            at[axis, a] = position[i, axis] - position[middle, axis]
        at[3, a], is_active[a] = predicted_radii[i] + skin_widths[i], active[i]


@kernel
def _chunk_start(c, cells, start):  # type: ignore[no-untyped-def]
    """First place of chunk `c`, that of a cell."""
    a = c * cells.size // NUM_CHUNKS
    return start[cells[a]] if a < cells.size else cells.size


@kernel
def _compact_chunk(begins, found, to, rows, first, second, begin, end):  # type: ignore[no-untyped-def]
    """Move what was found in a stretch of the table down to where it belongs."""
    if begins > to:
        for k in range(found):
            first[to + k] = first[begins + k]
            second[to + k] = second[begins + k]
    for i in rows:
        begin[i] += to
        end[i] += to


@kernel
def _mark_neighbours(around, is_active, own, others, mark):  # type: ignore[no-untyped-def]
    """Mark which of those around (x, y, z, size by row of `around`) are near number `own`.

    Two that are not `lively` are not. Marks up to a whole number of eight are written.
    """
    xa, ya, za, sa = around[0, own], around[1, own], around[2, own], around[3, own]
    xs, ys, zs, predicted_radii, alive = around[0], around[1], around[2], around[3], is_active[own]
    for m in range(np.uint64(others)):
        dx, dy, dz, near = xs[m] - xa, ys[m] - ya, zs[m] - za, predicted_radii[m] + sa
        mark[m] = np.uint8(dx * dx + dy * dy + dz * dz < near * near) & (alive | is_active[m])
    for m in range(others, (others + 7) // 8 * 8):
        mark[m] = np.uint8(0)


@kernel
def _find_chunk_pairs(  # type: ignore[no-untyped-def]
    begins, ends, order, start, cells, shape, sparse, at, is_active_at, first, second, begin, end
):
    """List the pairs of the cells at the places from `begins` to `ends`; -1 for want of room."""
    nx, _, nz = shape
    x, y, z, size = at[0], at[1], at[2], at[3]
    strips = 10 if sparse else 5
    low, high = np.zeros(10, np.int64), np.zeros(10, np.int64)
    around = np.empty((4, 512), np.float32)
    row = np.empty(512, np.uint32)
    is_active, mark = np.empty(512, np.uint8), np.zeros(520, np.uint8)
    marked = np.empty(mark.size // 8, np.int64)
    count, a = 0, begins
    while a < ends:
        # All of one cell have the same others around: half of the 27 cells, in 5 strips along z,
        # or all of them in 10.
        c = cells[a]
        end_of_cell = start[c + 1]
        awake = not sparse
        for b in range(a, end_of_cell):
            awake |= is_active_at[b] != 0
        if not awake:
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
            row = np.empty(2 * others, np.uint32)
            is_active, mark = np.empty(2 * others, np.uint8), np.zeros(2 * others + 8, np.uint8)
            marked = np.empty(mark.size // 8, np.int64)
        if count + (end_of_cell - a) * others > first.size:
            return -1
        m, after = 0, 0
        for strip in range(strips):
            if strip == 5:
                after = m  # here begin those that come before this cell in the order
            for b in range(low[strip], high[strip]):
                around[0, m], around[1, m], around[2, m] = x[b], y[b], z[b]
                around[3, m] = size[b]
                row[m], is_active[m] = order[b], is_active_at[b]
                m += 1
        words = mark[: mark.size // 8 * 8].view(np.uint64)
        for own in range(end_of_cell - a):
            i = row[own]
            begin[i] = count
            if sparse and not is_active[own]:
                end[i] = count
                continue
            _mark_neighbours(around, is_active, own, others, mark)
            # Few are near: eight marks are passed over at a time, and which without branches.
            some = 0
            for word in range(0 if sparse else own // 8, (others + 7) // 8):
                marked[some] = word
                some += words[word] != 0
            for n in range(some):
                word = marked[n]
                if not sparse:
                    for m in range(max(8 * word, own + 1), 8 * word + 8):
                        first[count] = i
                        second[count] = row[min(m, others - 1)]
                        count += np.int64(mark[m])
                else:
                    for m in range(8 * word, min(8 * word + 8, others)):
                        # Each pair once: of two that are live by the one that comes first.
                        before = m < own or m >= after
                        if mark[m] == 0 or m == own or (is_active[m] and before):
                            continue
                        first[count] = i
                        second[count] = row[m]
                        count += 1
            end[i] = count
        a = end_of_cell
    return count


@kernel
def _find_outlier_pairs(  # type: ignore[no-untyped-def]
    fast_outliers, active, position, predicted_radii, skin_widths, first, second, begin, end, count
):
    """List the pairs of strays from number `count` on; the end, or -1 for want of room."""
    n = active.size
    if fast_outliers.size == 0:
        return count
    around, is_active = np.empty((4, n), np.float32), np.empty(n, np.uint8)
    for j in range(n):
        for axis in range(3):
            around[axis, j] = position[j, axis] - position[fast_outliers[0], axis]
        around[3, j], is_active[j] = predicted_radii[j] + skin_widths[j], active[j]
    mark, stray = np.zeros((n + 7) // 8 * 8, np.uint8), np.zeros(n, np.bool_)
    words = mark.view(np.uint64)
    for i in fast_outliers:
        if count + n > first.size:
            return -1
        _mark_neighbours(around, is_active, i, n, mark)
        # Each pair once: of two strays by the one that comes first.
        stray[i] = True
        begin[i] = count
        for word in range(words.size):
            if words[word] == 0:
                continue
            for j in range(8 * word, 8 * word + 8):
                if mark[j] and not stray[j]:
                    first[count] = i
                    second[count] = j
                    count += 1
        end[i] = count
    return count


@kernel
def _transfer_history(  # type: ignore[no-untyped-def]
    low, high, new_row, active, old_first, old_second, old_touching, old_spring, second, begin, end,
    contact_flag, spring,
):  # fmt: skip
    """Carry history from the old table to the new: of the old pairs those that touch have one.

    Returns:
        How many are marked as both at rest.
    """
    # Who has a history is looked for without branches: no processor guesses which pairs touch.
    listed, count = np.empty(high - low, np.int64), 0
    for m in range(low, high):
        listed[count] = m
        count += old_touching[m] != 0
    rest = 0
    for m in listed[:count]:
        # Rows that were listed last before others were taken away may be beyond the end.
        i = new_row[old_first[m]] if old_first[m] < new_row.size else -1
        j = new_row[old_second[m]] if old_second[m] < new_row.size else -1
        if i < 0 or j < 0:
            continue
        if not (active[i] or active[j]):
            old_touching[m] = BOTH_ASLEEP
            old_first[m], old_second[m] = i, j
            rest += 1
            continue
        sign = np.float32(1.0)
        k = _find(second, begin[i], end[i], j)
        if k < 0:
            k = _find(second, begin[j], end[j], i)
            sign = np.float32(-1.0)
        if k >= 0:
            contact_flag[k] = 1
            for axis in range(3):
                spring[k, axis] = sign * old_spring[m, axis]
    return rest


@kernel
def _find(second, low, high, row):  # type: ignore[no-untyped-def]
    """Place of `row` in second[low:high], -1 if it is not there."""
    for k in range(low, high):
        if second[k] == row:
            return k
    return -1
