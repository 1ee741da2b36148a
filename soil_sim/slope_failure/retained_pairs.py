"""Pairs of columns of a window with a wall between them: no soil moves from one to the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper

__all__ = ["RetainedPairs", "retained_pairs"]


class RetainedPairs(NamedTuple):
    """Pairs between which a wall is, so that no soil slides.

    Attributes:
        cells: flat indices of the columns of each pair, shape (n, 2), int64; may have duplicates.
        starts: index of the first pair of each half of the pairs of each direction, in their order,
            and the number of pairs, shape (2 directions + 1,), int64.
    """

    cells: NDArray[np.int64]
    starts: NDArray[np.int64]


@helper(allocates=True)
def retained_pairs(is_wall, cols, directions):  # type: ignore[no-untyped-def]
    """Return the `RetainedPairs` of a window.

    Args:
        is_wall: columns of the wall, shape (rows, padded cols).
        cols: number of columns without those that pad the rows.
        directions: `PairDirections`.
    """
    rows, stride = is_wall.shape
    offsets, between = directions.offsets, directions.between
    walls = _wall_faces(is_wall[:, :cols])
    found = np.empty((walls.shape[0] * offsets.shape[0] * between.shape[1], 2), dtype=np.int64)
    group = np.empty(found.shape[0], dtype=np.int64)
    starts = np.zeros(2 * offsets.shape[0] + 1, dtype=np.int64)
    count = 0
    for w in range(walls.shape[0]):
        for k in range(offsets.shape[0]):
            di, dj = offsets[k, 0], offsets[k, 1]
            for n in range(between.shape[1]):
                ar, ac = between[k, n, 0, 0], between[k, n, 0, 1]
                br, bc = between[k, n, 1, 0], between[k, n, 1, 1]
                if ar == 0 and ac == 0:
                    continue
                row, col = walls[w, 0] - ar, walls[w, 1] - ac
                to_row, to_col = row + di, col + dj
                if not (0 <= row < rows and 0 <= col < cols):
                    continue
                if not (0 <= to_row < rows and 0 <= to_col < cols):
                    continue
                if is_wall[row, col] or is_wall[to_row, to_col] or not is_wall[row + br, col + bc]:
                    continue
                half = (row // di if di > 0 else col // dj) % 2
                group[count] = 2 * k + half
                starts[group[count] + 1] += 1
                found[count, 0], found[count, 1] = row * stride + col, to_row * stride + to_col
                count += 1
    for g in range(starts.size - 1):
        starts[g + 1] += starts[g]
    cells, next_of_group = np.empty((count, 2), dtype=np.int64), starts.copy()
    for m in range(count):
        at = next_of_group[group[m]]
        cells[at, 0], cells[at, 1] = found[m, 0], found[m, 1]
        next_of_group[group[m]] += 1
    return RetainedPairs(cells, starts)


@helper(allocates=True)
def _wall_faces(is_wall):  # type: ignore[no-untyped-def]
    """Return (row, col) of the columns of a wall beside one that is not of it, shape (n, 2).

    Every line through the wall enters it in one of these.
    """
    rows, cols = is_wall.shape
    faces, count = np.empty((is_wall.size, 2), dtype=np.int64), 0
    for i in range(rows):
        for j in range(cols):
            if not is_wall[i, j]:
                continue
            is_inside = (
                (i == 0 or is_wall[i - 1, j])
                and (i == rows - 1 or is_wall[i + 1, j])
                and (j == 0 or is_wall[i, j - 1])
                and (j == cols - 1 or is_wall[i, j + 1])
            )
            if not is_inside:
                faces[count, 0], faces[count, 1] = i, j
                count += 1
    return faces[:count]
