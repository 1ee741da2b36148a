"""Redistribution: apply planned changes of height as whole mm^3 of soil.

The soil actually in the columns that lose height is removed, in bank volume, and divided among the
columns of the same failure that gain height, exactly. No soil is transferred between failures.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.operations import add_loose, remove_from_column, stochastic_round
from soil_sim.columns.state import Columns

__all__ = ["redistribute"]


def redistribute(
    columns: Columns, corner: tuple[int, int], change: NDArray[np.float64], reach: int
) -> NDArray[np.int64]:
    """Apply planned height changes of a window, failure by failure.

    Args:
        columns: the terrain; changed.
        corner: (row, col) of the first column of the window.
        change: planned changes of height [m], shape (rows, cols) of the window.
        reach: maximum distance that soil slides at once [cells].

    Returns:
        Flat indices of the columns that lose or gain.
    """
    rows, cols = np.nonzero(change)
    if rows.size == 0:
        return np.zeros(0, dtype=np.int64)
    failure = _label_balanced_failures(change, rows, cols, reach)
    order = np.argsort(failure, kind="stable")
    cells = (rows + corner[0]) * columns.grid.cols + cols + corner[1]
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(failure[order])) + 1, [cells.size]])
    _redistribute(columns.arrays, cells[order], change[rows, cols][order], bounds)
    return np.asarray(cells, dtype=np.int64)


def _label_balanced_failures(
    change: NDArray[np.float64], rows: NDArray[np.intp], cols: NDArray[np.intp], reach: int
) -> NDArray[np.int64]:
    """Return the number of the failure that each changed column belongs to.

    Every failure has columns that lose and columns that gain. Soil may have moved between them over
    columns that did not change: the side of the blocks that connect columns is doubled until all
    failures are balanced.
    """
    is_loss, has_changed, side = change[rows, cols] < 0.0, change != 0.0, reach
    while True:
        failure = _label_failures(has_changed, side)[rows, cols]
        has_losses = np.bincount(failure, is_loss) > 0
        has_gains = np.bincount(failure, ~is_loss) > 0
        if (has_losses == has_gains).all() or side >= max(change.shape):
            return np.asarray(failure, dtype=np.int64)
        side *= 2


@kernel
def _label_failures(has_changed, side):  # type: ignore[no-untyped-def]
    """Return the number of the failure of each changed column, from 1; 0 for unchanged ones.

    Connected components of square blocks of `side` columns: two columns belong to one failure if
    their blocks are adjacent, or connected by adjacent blocks with changed columns.
    """
    rows, cols = has_changed.shape
    block_rows, block_cols = -(-rows // side), -(-cols // side)
    block = np.zeros((block_rows, block_cols), dtype=np.int64)  # -1: changed, without a number yet
    for i in range(rows):
        for j in range(cols):
            if has_changed[i, j]:
                block[i // side, j // side] = -1
    stack = np.empty((block.size, 2), dtype=np.int64)
    count = 0
    for i in range(block_rows):
        for j in range(block_cols):
            if block[i, j] < 0:
                count += 1
                _fill_component(block, i, j, count, stack)
    failure = np.zeros((rows, cols), dtype=np.int64)
    for i in range(rows):
        for j in range(cols):
            if has_changed[i, j]:
                failure[i, j] = block[i // side, j // side]
    return failure


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


@kernel
def _redistribute(columns, cells, change, bounds):  # type: ignore[no-untyped-def]
    """Remove soil from the columns that lose height, and divide it among those that gain.

    Exact to the mm^3, separately for each failure: failure n is cells[bounds[n] : bounds[n + 1]].

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        cells: flat indices of the columns, sorted by failure.
        change: planned changes of height [m], none of them 0.
        bounds: index of the first column of each failure, and the number of columns.
    """
    for n in range(bounds.size - 1):
        first, end = bounds[n], bounds[n + 1]
        bank = np.int64(0)
        water = total_gain = 0.0
        kind = columns.soil[cells[first]]
        last = -1  # index of the last column that gains
        for m in range(first, end):
            i = cells[m]
            if change[m] > 0.0:
                total_gain += change[m]
                last = m
                continue
            loose, firm = remove_from_column(columns, i, -change[m] / columns.metres_per_mm3)
            bank += loose + firm
            water += 1.0 * loose * columns.loose_moisture[i] + 1.0 * firm * columns.moisture[i]
        if bank == 0:
            continue
        moisture = stochastic_round(water / bank, bank)
        bulking_factor = columns.bulking_factor[kind]
        if last < 0:  # by rounding no column gains: the soil stays where it was
            bulk = np.int64(bank * bulking_factor + 0.5)
            add_loose(columns, cells[first], bank, bulk, kind, moisture)
            continue
        # Rounding cumulative volumes, not the volumes themselves, keeps their sum exact.
        distributed, gain = np.int64(0), 0.0
        for m in range(first, end):
            if change[m] <= 0.0:
                continue
            gain += change[m]
            cumulative = bank if m == last else np.int64(bank * min(gain / total_gain, 1.0))
            volume = cumulative - distributed
            if volume > 0:
                bulk = np.int64(volume * bulking_factor + 0.5)
                add_loose(columns, cells[m], volume, bulk, kind, moisture)
            distributed = max(distributed, cumulative)
