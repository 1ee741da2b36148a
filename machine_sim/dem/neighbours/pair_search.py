"""Search for neighbouring pairs, cell by cell.

Chunks of the cells are searched in parallel. The list is in the order of cells for any number
of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.compaction import COMPACTION_SIZE, append_pairs, copy_vector, move_rows
from machine_sim.dem.neighbours.neighbourhood import (
    REACH,
    allocate_neighbourhood,
    list_all_pairs,
    list_later_pairs,
    mark_neighbours,
)
from machine_sim.dem.partition import NUM_CHUNKS
from machine_sim.dem.state import AWAKE
from msg_bridge.kernels import helper, threaded_kernel

__all__ = ["SearchParticles", "find_pairs", "mark_active"]

_NUM_STRIPS = 5
"""Strips of three cells along z: half of the 27 cells about a cell, in the order of cells; those of
the other half follow."""


class SearchParticles(NamedTuple):
    """Data of all particles for the search, by row.

    Attributes:
        position: centres [m], shape (n, 3).
        reach: predicted contact radius plus skin width [m], shape (n,).
        active: whether each particle moves by forces; two that do not are no pair.
    """

    position: NDArray[np.float64]
    reach: NDArray[np.float64]
    active: NDArray[np.bool_]


@helper
def mark_active(particles, active):  # type: ignore[no-untyped-def]
    """Mark the particles of a `ParticleColumns` that move by forces."""
    sleep_state, frozen = particles.sleep_state, particles.frozen
    for i in range(active.size):
        active[i] = sleep_state[i] == AWAKE and not frozen[i]


@threaded_kernel
def find_pairs(grid, fast_outliers, sparse, particles, first, second, begin, end, slabs):  # type: ignore[no-untyped-def]
    """List all pairs closer than the sum of their reaches.

    Args:
        grid: `CellGrid` of the particles without the fast outliers.
        fast_outliers: rows too fast for the cells: each is compared with all other particles, and
            their pairs come last.
        sparse: whether active particles are few: then only their cells are searched, and the cells
            on all sides of them.
        particles: `SearchParticles`.
        first, second, begin, end: out, arrays of the new `PairTable`.
        slabs: out, first pair of each layer of cells along y, and the end.

    Returns:
        Number of pairs, or -1 where the table is too small.
    """
    order, n = grid.order, grid.order.size
    # Strips of these are copied in whole vectors.
    packed = np.empty((4, n + COMPACTION_SIZE), np.float32)
    row, is_active = (
        np.empty(n + COMPACTION_SIZE, np.uint32),
        np.empty(n + COMPACTION_SIZE, np.uint8),
    )
    for c in prange(NUM_CHUNKS):
        _pack_sorted(
            c * n // NUM_CHUNKS, (c + 1) * n // NUM_CHUNKS, order, particles, packed, row, is_active
        )
    # Each chunk of the cells fills a section of the table; then the sections are joined.
    num_found, capacity = np.zeros(NUM_CHUNKS, np.int64), first.size // NUM_CHUNKS
    for c in prange(NUM_CHUNKS):
        low, high = _chunk_start(c, grid), _chunk_start(c + 1, grid)
        num_found[c] = _find_chunk_pairs(
            low, high, grid, sparse, packed, row, is_active,
            first[c * capacity : (c + 1) * capacity], second[c * capacity : (c + 1) * capacity],
            begin, end,
        )  # fmt: skip
    if num_found.min() < 0:
        return -1
    # The 0 is typed, or the functions it is passed to are compiled once more for its literal.
    count = np.int64(0)
    for c in range(NUM_CHUNKS):
        rows = order[_chunk_start(c, grid) : _chunk_start(c + 1, grid)]
        _move_section(c * capacity, num_found[c], count, rows, first, second, begin, end)
        count += num_found[c]
    nx, ny, nz = grid.shape
    for slab in range(ny):
        place = grid.start[slab * nx * nz]
        slabs[slab] = begin[order[place]] if place < n else count
    count = _find_outlier_pairs(fast_outliers, particles, first, second, begin, end, count)
    slabs[ny] = count
    return count


@helper(forceinline=True)
def _pack_sorted(low, high, order, particles, packed, row, is_active):  # type: ignore[no-untyped-def]
    """Copy positions, reaches, rows and activity in the order of cells.

    Positions are in float32 relative to a particle in the middle, which is accurate enough for a
    list with a skin.
    """
    position, middle = particles.position, order[order.size // 2]
    reach, active = particles.reach, particles.active
    for place in range(low, high):
        i = order[place]
        for axis in range(3):
            packed[axis, place] = position[i, axis] - position[middle, axis]
        packed[REACH, place], row[place], is_active[place] = reach[i], i, active[i]


@helper(forceinline=True)
def _chunk_start(c, grid):  # type: ignore[no-untyped-def]
    """Return the first place of chunk `c`, which is the first of a cell."""
    place = c * grid.cell.size // NUM_CHUNKS
    return grid.start[grid.cell[place]] if place < grid.cell.size else grid.cell.size


@helper(forceinline=True)
def _move_section(source, count, target, rows, first, second, begin, end):  # type: ignore[no-untyped-def]
    """Move a section of the table to its final position, and shift the ranges of its rows."""
    if source > target:
        move_rows(first, source, target, count)
        move_rows(second, source, target, count)
    for i in rows:
        begin[i] += target
        end[i] += target


@helper(allocates=True, forceinline=True)
def _find_chunk_pairs(  # type: ignore[no-untyped-def]
    low, high, grid, sparse, packed, row, is_active, first, second, begin, end
):
    """List the pairs of the cells at places `low` to `high` - 1.

    All particles of a cell have the same neighbourhood: half of the 27 cells, or all of them where
    active particles are few.

    Returns:
        Number of pairs, or -1 where the section of the table is too small.
    """
    strip_low, strip_high = np.zeros(2 * _NUM_STRIPS, np.int64), np.zeros(2 * _NUM_STRIPS, np.int64)
    around = allocate_neighbourhood(512)
    order, start, cell, shape = grid.order, grid.start, grid.cell, grid.shape
    count, place = 0, low
    while place < high:
        c = cell[place]
        end_of_cell = start[c + 1]
        if sparse and not is_active[place:end_of_cell].any():
            for k in range(place, end_of_cell):
                begin[order[k]] = end[order[k]] = count
            place = end_of_cell
            continue
        size = _find_strips(c, place, start, shape, sparse, strip_low, strip_high)
        if size + COMPACTION_SIZE > around.row.size:
            around = allocate_neighbourhood(2 * size)
        if count + (end_of_cell - place) * size + COMPACTION_SIZE > first.size:
            return -1
        num_after = _gather(strip_low, strip_high, sparse, packed, row, is_active, around)
        for own in range(end_of_cell - place):
            i = around.row[own]
            begin[i] = count
            if not sparse:
                count = list_later_pairs(own, size, around, first, second, count)
            elif around.is_active[own]:
                count = list_all_pairs(own, size, num_after, around, first, second, count)
            end[i] = count
        place = end_of_cell
    return count


@helper(forceinline=True)
def _find_strips(c, place, start, shape, sparse, low, high):  # type: ignore[no-untyped-def]
    """Find the places of the particles about cell `c`, in strips along z.

    Strips 0 to 4 are the cell itself and those after it in the order of cells; strips 5 to 9, used
    only if `sparse`, are those before it. `start` and `shape` are those of the `CellGrid`.

    Returns:
        Number of particles in the strips.
    """
    nx, nz = shape[0], shape[2]
    low[0], high[0] = place, start[c + 2]
    low[_NUM_STRIPS], high[_NUM_STRIPS] = start[c - 1], place
    for half in range(1, _NUM_STRIPS):
        offset = nz if half == 1 else (nx + half - 3) * nz
        low[half], high[half] = start[c + offset - 1], start[c + offset + 2]
        low[_NUM_STRIPS + half] = start[c - offset - 1]
        high[_NUM_STRIPS + half] = start[c - offset + 2]
    size = 0
    for strip in range(2 * _NUM_STRIPS if sparse else _NUM_STRIPS):
        size += high[strip] - low[strip]
    return size


@helper(forceinline=True)
def _gather(low, high, sparse, packed, row, is_active, around):  # type: ignore[no-untyped-def]
    """Copy the particles of the strips into a neighbourhood, those of the cell itself first.

    What is copied beyond the end of a strip is overwritten by the next one.

    Returns:
        Number of particles in the strips that are not before the cell in the order.
    """
    m, num_after = np.int64(0), np.int64(0)
    for strip in range(2 * _NUM_STRIPS if sparse else _NUM_STRIPS):
        if strip == _NUM_STRIPS:
            num_after = m
        for place in range(low[strip], high[strip], COMPACTION_SIZE):
            at = m + place - low[strip]
            for quantity in range(4):
                copy_vector(packed[quantity], place, around.packed[quantity], at)
            copy_vector(row, place, around.row, at)
            copy_vector(is_active, place, around.is_active, at)
        m += high[strip] - low[strip]
    return num_after


@helper(allocates=True, forceinline=True)
def _find_outlier_pairs(fast_outliers, particles, first, second, begin, end, count):  # type: ignore[no-untyped-def]
    """List the pairs of fast outliers after the `count` pairs in the table.

    Returns:
        Number of pairs in the table, or -1 where it is too small.
    """
    position, reach, active = particles.position, particles.reach, particles.active
    n = active.size
    if fast_outliers.size == 0:
        return count
    size = n + COMPACTION_SIZE
    packed, row = np.empty((4, size), np.float32), np.empty(size, np.uint32)
    is_active, mark = np.empty(size, np.uint8), np.empty(size, np.uint8)
    is_listed = np.zeros(n, np.bool_)
    for j in range(n):
        for axis in range(3):
            packed[axis, j] = position[j, axis] - position[fast_outliers[0], axis]
        packed[REACH, j], row[j], is_active[j] = reach[j], j, active[j]
    for i in fast_outliers:
        if count + n + COMPACTION_SIZE > first.size:
            return -1
        mark_neighbours(packed, is_active, i, n, mark)
        # Each pair is listed once: a pair of two outliers by the first of them.
        is_listed[i] = True
        for j in range(np.uint64(n)):
            mark[j] &= np.uint8(not is_listed[j])
        begin[i] = count
        for low in range(0, n, COMPACTION_SIZE):
            count = append_pairs(np.uint32(i), row, mark, low, first, second, count)
        end[i] = count
    return count
