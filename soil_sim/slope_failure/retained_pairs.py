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
def retained_pairs(heights, cols, directions):  # type: ignore[no-untyped-def]
    """Return the `RetainedPairs` of a window.

    Args:
        heights: surface, `WALL` in columns of the wall, shape (rows, padded cols), float32.
        cols: number of columns without those that pad the rows, which are of the wall.
        directions: `PairDirections`.
    """
    rows, stride = heights.shape
    offsets, between = directions.offsets, directions.between
    # With rows of wall before and after the window, as there are columns of wall beside it, no
    # neighbour of a column needs to be compared with the bounds of the window.
    margin = (offsets.max() + 1) * stride
    is_wall = np.ones(heights.size + 2 * margin, np.bool_)
    _mark_wall(heights.reshape(-1), is_wall, np.uint64(margin))
    faces = np.empty(rows * cols, np.int64)
    num_faces = _find_wall_faces(is_wall, margin, (rows, stride), cols, faces)
    found = np.empty((num_faces * offsets.shape[0] * between.shape[1], 2), dtype=np.int64)
    ends = np.empty(offsets.shape[0], np.int64)
    count = _find_retained(is_wall, faces[:num_faces], stride, directions, found, ends)
    group = np.empty(count, dtype=np.int64)
    starts = np.zeros(2 * offsets.shape[0] + 1, dtype=np.int64)
    k = 0
    for m in range(count):
        while m == ends[k]:
            k += 1
        found[m, 0] -= margin
        found[m, 1] -= margin
        row, col = found[m, 0] // stride, found[m, 0] % stride
        group[m] = 2 * k + (row // offsets[k, 0] if offsets[k, 0] > 0 else col // offsets[k, 1]) % 2
        starts[group[m] + 1] += 1
    for g in range(starts.size - 1):
        starts[g + 1] += starts[g]
    cells, next_of_group = np.empty((count, 2), dtype=np.int64), starts.copy()
    for m in range(count):
        at = next_of_group[group[m]]
        cells[at, 0], cells[at, 1] = found[m, 0], found[m, 1]
        next_of_group[group[m]] += 1
    return RetainedPairs(cells, starts)


@helper
def _mark_wall(heights, is_wall, margin):  # type: ignore[no-untyped-def]
    """Mark the columns of a wall, from index `margin` on; all arrays are flat."""
    for i in range(np.uint64(heights.size)):  # unsigned, for vector instructions
        is_wall[margin + i] = np.isnan(heights[i])


@helper
def _find_retained(is_wall, faces, stride, directions, found, ends):  # type: ignore[no-untyped-def]
    """Write the pairs between which a wall is, direction by direction; return their number.

    Args:
        is_wall: columns of the wall, with a margin, flat.
        faces: columns of `_find_wall_faces`.
        stride: number of columns of a row.
        directions: `PairDirections`.
        found: out, flat indices of the columns of each pair in `is_wall`.
        ends: out, number of pairs up to the end of each direction.
    """
    offsets, between = directions.offsets, directions.between
    count = 0
    for k in range(offsets.shape[0]):
        to_end = offsets[k, 0] * stride + offsets[k, 1]
        for n in range(between.shape[1]):
            to_face = between[k, n, 0, 0] * stride + between[k, n, 0, 1]
            if to_face == 0:  # the rest pads the table
                break
            to_other = between[k, n, 1, 0] * stride + between[k, n, 1, 1]
            for w in range(faces.size):
                start = faces[w] - to_face
                is_open = not (is_wall[np.uint64(start)] or is_wall[np.uint64(start + to_end)])
                if is_open and is_wall[np.uint64(start + to_other)]:
                    found[count, 0], found[count, 1] = start, start + to_end
                    count += 1
        ends[k] = count
    return count


@helper
def _find_wall_faces(is_wall, margin, shape, cols, faces):  # type: ignore[no-untyped-def]
    """Write the columns of a wall beside one that is not of it, and return their number.

    Every line through the wall enters it in one of these.

    Args:
        is_wall: columns of the wall, with a margin, flat.
        margin: index of the first column of the window in it.
        shape: number of rows, and of columns of a padded row.
        cols: number of columns of a row without those that pad it.
        faces: out, indices of the columns in `is_wall`.
    """
    rows, stride = shape
    count = 0
    one, row = np.uint64(1), np.uint64(stride)
    for i in range(rows):
        first = margin + i * stride
        for k in range(np.uint64(first), np.uint64(first + cols)):
            if is_wall[k] and not (
                is_wall[k - row] and is_wall[k + row] and is_wall[k - one] and is_wall[k + one]
            ):
                faces[np.uint64(count)] = k
                count += 1
    return count
