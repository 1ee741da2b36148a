"""Redistribution: apply planned changes of height as whole mm^3 of soil.

The soil actually in the columns that lose height is removed, in bank volume, and divided among the
columns of the same failure that gain height, exactly. No soil is transferred between failures.

Soil of several kinds and moistures is not mixed over a failure: along a path through it, what is
lost first is deposited first. The path crosses the failure to and fro in strips, from one end of
its longer side to the other, so that soil stays at that end and on that side at which it failed.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.columns.operations import add_loose, remove_from_column

__all__ = ["redistribute"]

_STRIP_WIDTH = 8
"""Width of the strips in which a path crosses a failure [cells]: a cache line of a layer."""


@helper(allocates=True)
def redistribute(columns, cells, rows, cols, change, shape, reach):  # type: ignore[no-untyped-def]
    """Apply planned height changes of a window, failure by failure.

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        cells: flat indices of the columns that lose or gain, at least one.
        rows, cols: their position in the window [cells].
        change: planned changes of height [m], none of them 0.
        shape: rows and columns of the window.
        reach: maximum distance that soil slides at once [cells].
    """
    failure = _label_balanced_failures(rows, cols, change, shape, reach)
    order, bounds = _order_along_paths(failure, rows, cols)
    _redistribute(columns, cells[order], change[order], bounds)


@helper(allocates=True)
def _label_balanced_failures(rows, cols, change, shape, reach):  # type: ignore[no-untyped-def]
    """Return the number of the failure that each changed column belongs to, from 1.

    Every failure has columns that lose and columns that gain. Soil may have moved between them over
    columns that did not change: the side of the blocks that connect columns is doubled until all
    failures are balanced.
    """
    side = reach
    while True:
        failure, count = _label_failures(rows, cols, shape, side)
        if side >= max(shape) or _is_balanced(failure, count, change):
            return failure
        side *= 2


@helper(allocates=True)
def _is_balanced(failure, count, change):  # type: ignore[no-untyped-def]
    """Return whether each of `count` failures has columns that lose and columns that gain."""
    has_loss, has_gain = np.zeros(count + 1, np.bool_), np.zeros(count + 1, np.bool_)
    for m in range(failure.size):
        if change[m] < 0.0:
            has_loss[failure[m]] = True
        else:
            has_gain[failure[m]] = True
    return (has_loss == has_gain).all()


@helper(allocates=True)
def _label_failures(rows, cols, shape, side):  # type: ignore[no-untyped-def]
    """Return the number of the failure of each changed column, from 1, and that of failures.

    Connected components of square blocks of `side` columns: two columns belong to one failure if
    their blocks are adjacent, or connected by adjacent blocks with changed columns.
    """
    block_rows, block_cols = -(-shape[0] // side), -(-shape[1] // side)
    block = np.zeros((block_rows, block_cols), dtype=np.int64)  # -1: changed, without a number yet
    block_at = np.arange(max(shape)) // side  # read for each column, which is faster than to divide
    for m in range(rows.size):
        block[block_at[rows[m]], block_at[cols[m]]] = -1
    stack = np.empty((block.size, 2), dtype=np.int64)
    count = 0
    for i in range(block_rows):
        for j in range(block_cols):
            if block[i, j] < 0:
                count += 1
                _fill_component(block, i, j, count, stack)
    failure = np.empty(rows.size, dtype=np.int64)
    for m in range(rows.size):
        failure[m] = block[block_at[rows[m]], block_at[cols[m]]]
    return failure, count


@helper
def _fill_component(block, i, j, number, stack):  # type: ignore[no-untyped-def]
    """Number the blocks connected to block (i, j); `stack` is scratch, shape (blocks, 2)."""
    block[i, j] = number
    stack[0, 0], stack[0, 1] = i, j
    size = 1
    while size:
        size -= 1
        a, b = stack[size, 0], stack[size, 1]
        for p in range(max(a - 1, 0), min(a + 2, block.shape[0])):
            for q in range(max(b - 1, 0), min(b + 2, block.shape[1])):
                if block[p, q] < 0:
                    block[p, q] = number
                    stack[size, 0], stack[size, 1] = p, q
                    size += 1


@helper(allocates=True)
def _order_along_paths(failure, rows, cols):  # type: ignore[no-untyped-def]
    """Return the order of columns along the path through their failure.

    Args:
        failure: number of the failure of each column, from 1.
        rows, cols: its position.

    Returns:
        (indices, failure by failure; index of the first column of each failure in their order, and
        the number of columns).
    """
    num_failures = failure.max()
    low, high = np.empty((2, num_failures), np.int64), np.empty((2, num_failures), np.int64)
    low[:], high[:] = np.iinfo(np.int64).max, -1
    for m in range(failure.size):
        n = failure[m] - 1
        low[0, n], high[0, n] = min(low[0, n], rows[m]), max(high[0, n], rows[m])
        low[1, n], high[1, n] = min(low[1, n], cols[m]), max(high[1, n], cols[m])
    # Counting sort by strip and position across it; numbers of a failure follow those before it.
    first_key = np.zeros(num_failures + 1, np.int64)
    for n in range(num_failures):
        sides = high[0, n] - low[0, n] + 1, high[1, n] - low[1, n] + 1
        num_strips = (max(sides) - 1) // _STRIP_WIDTH + 1
        first_key[n + 1] = first_key[n] + num_strips * min(sides)
    keys = np.empty(failure.size, np.int64)
    starts = np.zeros(first_key[num_failures] + 1, np.int64)
    for m in range(failure.size):
        n = failure[m] - 1
        along, across = rows[m] - low[0, n], cols[m] - low[1, n]
        width = high[1, n] - low[1, n] + 1
        if width > high[0, n] - low[0, n] + 1:
            along, across, width = across, along, high[0, n] - low[0, n] + 1
        strip = along // _STRIP_WIDTH
        if strip % 2 == 1:
            across = width - 1 - across
        keys[m] = first_key[n] + strip * width + across
        starts[keys[m] + 1] += 1
    for key in range(starts.size - 1):
        starts[key + 1] += starts[key]
    bounds = starts[first_key]
    order = np.empty(failure.size, np.int64)
    for m in range(failure.size):
        order[starts[keys[m]]] = m
        starts[keys[m]] += 1
    return order, bounds


@helper(allocates=True)
def _redistribute(columns, cells, change, bounds):  # type: ignore[no-untyped-def]
    """Remove soil from the columns that lose height, and divide it among those that gain.

    Exact to the mm^3, separately for each failure: failure n is cells[bounds[n] : bounds[n + 1]].

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        cells: flat indices of the columns, sorted by failure, and in it along its longer side.
        change: planned changes of height [m], none of them 0.
        bounds: index of the first column of each failure, and the number of columns.
    """
    volumes = np.empty(2 * cells.size, np.int64)
    kinds, moistures = np.empty(volumes.size, np.uint8), np.empty(volumes.size, np.uint8)
    _move_lots(columns, cells, change, bounds, volumes, kinds, moistures)


@helper
def _move_lots(columns, cells, change, bounds, volumes, kinds, moistures):  # type: ignore[no-untyped-def]
    """Redistribute soil as `_redistribute`, without counts of references to the columns.

    `volumes`, `kinds` and `moistures` are scratch: the lots of soil that was lost, in order; two
    for each column.
    """
    for n in range(bounds.size - 1):
        first, end = bounds[n], bounds[n + 1]
        bank = np.int64(0)
        total_gain = 0.0
        count = 0
        last = -1  # index of the last column that gains
        for m in range(first, end):
            i = np.uint64(cells[m])  # faster, see `msg_bridge.kernels.decorators`
            if change[m] > 0.0:
                total_gain += change[m]
                last = m
                continue
            kind, moisture = columns.loose_soil[i], columns.loose_moisture[i]
            loose, firm = remove_from_column(columns, i, -change[m] / columns.metres_per_mm3)
            bank += loose + firm
            lots = ((loose, kind, moisture), (firm, columns.soil[i], columns.moisture[i]))
            for volume, kind, moisture in lots:
                if volume == 0:
                    continue
                if count > 0 and kinds[count - 1] == kind and moistures[count - 1] == moisture:
                    volumes[count - 1] += volume
                    continue
                volumes[count], kinds[count], moistures[count] = volume, kind, moisture
                count += 1
        if last < 0:  # by rounding no column gains: the soil stays where it was
            for lot in range(count):
                _add_lot(columns, np.uint64(cells[first]), volumes[lot], kinds[lot], moistures[lot])
            continue
        # Rounding cumulative volumes, not the volumes themselves, keeps their sum exact.
        distributed, gain = np.int64(0), 0.0
        lot = 0
        for m in range(first, end):
            if change[m] <= 0.0:
                continue
            gain += change[m]
            cumulative = bank if m == last else np.int64(bank * min(gain / total_gain, 1.0))
            while distributed < cumulative:
                volume = min(cumulative - distributed, volumes[lot])
                _add_lot(columns, np.uint64(cells[m]), volume, kinds[lot], moistures[lot])
                distributed += volume
                volumes[lot] -= volume
                if volumes[lot] == 0:
                    lot += 1


@helper(forceinline=True)
def _add_lot(columns, i, bank, kind, moisture):  # type: ignore[no-untyped-def]
    """Deposit soil of a bank volume [mm^3], freshly loosened, on column i."""
    bulk = np.int64(bank * columns.bulking_factor[kind] + 0.5)
    add_loose(columns, i, bank, bulk, kind, moisture)
