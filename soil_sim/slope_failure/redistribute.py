"""Booking a collapse: heights that were planned to change, as whole mm^3 of soil.

What the columns that lose height really hold is taken from them, in bank volume, and shared out
among those of the same failure that gain, exactly. Soil never goes from one failure to another.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel
from soil_sim.columns.state import Columns, add_loose, remove_from_column, stochastic_round

__all__ = ["redistribute"]


def redistribute(
    columns: Columns, corner: tuple[int, int], change: NDArray[np.float64], reach: int
) -> NDArray[np.int64]:
    """Do what was planned for a window, failure by failure.

    Args:
        columns: the terrain; changed.
        corner: (row, col) of the window's first column.
        change: of height [m], of the window's columns, shape (rows, cols).
        reach: how far soil slips at once [cells].

    Returns:
        Flat indices of the columns that lose or gain.
    """
    rows, cols = np.nonzero(change)
    if rows.size == 0:
        return np.zeros(0, dtype=np.int64)
    failure = _label_balanced_failures(change, rows, cols, reach)
    order = np.argsort(failure, kind="stable")
    cells = (rows + corner[0]) * columns.grid.cols + cols + corner[1]
    ends = np.concatenate([[0], np.flatnonzero(np.diff(failure[order])) + 1, [cells.size]])
    _distribute(columns.arrays, cells[order], change[rows, cols][order], ends)
    return np.asarray(cells, dtype=np.int64)


def _label_balanced_failures(
    change: NDArray[np.float64], rows: NDArray[np.intp], cols: NDArray[np.intp], reach: int
) -> NDArray[np.int64]:
    """Number of the failure that each column belongs to that lost or gained.

    In each there are both: soil may have passed from one to another over columns that kept none of
    it, so that they are looked for in ever larger blocks.
    """
    lost, moved, block = change[rows, cols] < 0.0, change != 0.0, reach
    while True:
        number = _label_failures(moved, block)[rows, cols]
        losers = np.bincount(number, lost) > 0
        gainers = np.bincount(number, ~lost) > 0
        if (losers == gainers).all() or block >= max(change.shape):
            return np.asarray(number, dtype=np.int64)
        block *= 2


@kernel
def _label_failures(moved, side):  # type: ignore[no-untyped-def]
    """Number of the failure that each column that moved belongs to, from 1; 0 if it did not.

    Found by square blocks of `side` columns: two columns are of one failure if their blocks touch,
    or if a third one's touches both.
    """
    rows, cols = moved.shape
    block_rows, block_cols = -(-rows // side), -(-cols // side)
    block = np.zeros((block_rows, block_cols), dtype=np.int64)  # -1: something moved in it
    for i in range(rows):
        for j in range(cols):
            if moved[i, j]:
                block[i // side, j // side] = -1
    stack = np.empty((block.size, 2), dtype=np.int64)
    count = 0
    for i in range(block_rows):
        for j in range(block_cols):
            if block[i, j] >= 0:
                continue
            count += 1
            block[i, j] = count
            stack[0, 0], stack[0, 1] = i, j
            size = 1
            while size:
                size -= 1
                a, b = stack[size, 0], stack[size, 1]
                for p in range(max(a - 1, 0), min(a + 2, block_rows)):
                    for q in range(max(b - 1, 0), min(b + 2, block_cols)):
                        if block[p, q] < 0:
                            block[p, q] = count
                            stack[size, 0], stack[size, 1] = p, q
                            size += 1
    number = np.zeros((rows, cols), dtype=np.int64)
    for i in range(rows):
        for j in range(cols):
            if moved[i, j]:
                number[i, j] = block[i // side, j // side]
    return number


@kernel
def _distribute(columns, cells, change, ends):  # type: ignore[no-untyped-def]
    """Take height [m] from the columns that lose and share what that was among those that gain.

    Exact to the mm^3, each failure for itself: failure n is cells[ends[n] : ends[n + 1]].
    """
    for n in range(ends.size - 1):
        bank = np.int64(0)
        water = whole = 0.0
        kind = columns.soil[cells[ends[n]]]
        last = -1
        for m in range(ends[n], ends[n + 1]):
            i = cells[m]
            if change[m] > 0.0:
                whole += change[m]
                last = m
                continue
            loose, firm = remove_from_column(columns, i, -change[m] / columns.metres_per_mm3)
            bank += loose + firm
            water += 1.0 * loose * columns.loose_moisture[i] + 1.0 * firm * columns.moisture[i]
        if bank == 0:
            continue
        wet = stochastic_round(water / bank, bank)
        bulking_factor = columns.bulking_factor[kind]
        if last < 0:  # rounding left no column that gains: it stays where it was
            bulk = np.int64(bank * bulking_factor + 0.5)
            add_loose(columns, cells[ends[n]], bank, bulk, kind, wet)
            continue
        given, part = np.int64(0), 0.0
        for m in range(ends[n], ends[n + 1]):
            if change[m] <= 0.0:
                continue
            part += change[m]
            through = bank if m == last else np.int64(bank * min(part / whole, 1.0))
            share = through - given
            if share > 0:
                bulk = np.int64(share * bulking_factor + 0.5)
                add_loose(columns, cells[m], share, bulk, kind, wet)
            given = max(given, through)
