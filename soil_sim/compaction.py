"""Pressing: a plate that is pushed into loose soil packs it, as tracks do and the back of a bucket.

Nothing is taken away: the room of the loose soil under the plate shrinks, down to what it took
undisturbed. Firm soil does not give. A column counts as under the plate if its centre is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import Columns, compact_column
from soil_sim.tool_sweeps import SweptPairs

__all__ = ["compact"]

_MAX_POSES = 64
"""Poses of a plate looked at in one tick, at most."""


def compact(columns: Columns, pairs: SweptPairs) -> NDArray[np.int64]:
    """Pack the loose soil above where plates went in a tick.

    Args:
        columns: the terrain; changed.
        pairs: pressing key-point pairs of one source; joined ones bound a plate.

    Returns:
        Flat indices of the columns packed, in order.
    """
    if pairs.has_plate.size == 0:  # as with a machine that has no tracks
        return np.zeros(0, dtype=np.int64)
    grid = columns.grid
    packed: NDArray[np.int64] = _compact(
        *pairs,
        columns.arrays,
        grid.rows,
        grid.cols,
        grid.x_first,
        grid.y_first,
        grid.cell,
    )
    return np.unique(packed) if packed.size else packed


@kernel
def _compact(points, has_plate, columns, rows, cols, x_first, y_first, cell):  # type: ignore[no-untyped-def]
    """`press`; a column is told once for each triangle that packs it."""
    packed, count = np.empty(64, dtype=np.int64), np.int64(0)
    for n in range(points.shape[0] - 1):
        if not has_plate[n]:
            continue
        way = 0.0
        for m in range(n, n + 2):
            for p in range(2):
                for axis in range(3):
                    way = max(way, abs(points[m, 1, p, axis] - points[m, 0, p, axis]))
        poses = min(max(1, int(np.ceil(2.0 * way / cell))), _MAX_POSES)
        for pose in range(1, poses + 1):
            t = pose / poses
            # Left and right of this pair, then of the next.
            a, b = _interpolate_key_point(points, n, 0, t), _interpolate_key_point(points, n, 1, t)
            c, d = (
                _interpolate_key_point(points, n + 1, 0, t),
                _interpolate_key_point(points, n + 1, 1, t),
            )
            for third in (a, d):
                packed, count = _compact_triangle(
                    b, c, third, columns, rows, cols, x_first, y_first, cell, packed, count
                )
    return packed[:count]


@helper(inline="always")
def _interpolate_key_point(points, n, p, t):  # type: ignore[no-untyped-def]
    """Where an end of a pair is at a part t of the tick."""
    return (
        points[n, 0, p, 0] + t * (points[n, 1, p, 0] - points[n, 0, p, 0]),
        points[n, 0, p, 1] + t * (points[n, 1, p, 1] - points[n, 0, p, 1]),
        points[n, 0, p, 2] + t * (points[n, 1, p, 2] - points[n, 0, p, 2]),
    )


@helper
def _compact_triangle(  # type: ignore[no-untyped-def]
    a, b, c, columns, rows, cols, x_first, y_first, cell, packed, count
):
    """Pack the columns whose centre is under a triangle down to it, and note them.

    Returns:
        (flat indices noted, with room for more; how many).
    """
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if abs(area) < 1e-12:  # seen from above it is a line
        return packed, count
    x0, x1 = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
    y0, y1 = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    top = max(np.ceil((x_first - x1) / cell), 0.0)
    bottom = min(np.floor((x_first - x0) / cell), rows - 1.0)
    left = max(np.ceil((y_first - y1) / cell), 0.0)
    right = min(np.floor((y_first - y0) / cell), cols - 1.0)
    if bottom < top or right < left:
        return packed, count
    for i in range(np.int64(top), np.int64(bottom) + 1):
        x = x_first - i * cell
        for j in range(np.int64(left), np.int64(right) + 1):
            y = y_first - j * cell
            u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
            v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
            if u < 0.0 or v < 0.0 or u + v > 1.0:
                continue
            k = i * cols + j
            over = columns.height[k] - (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]))
            if over > 0.0 and compact_column(columns, k, over / columns.metres_per_mm3) > 0:
                if count == packed.size:
                    more = np.empty(2 * count, dtype=np.int64)
                    for n in range(count):
                        more[n] = packed[n]
                    packed = more
                packed[count] = k
                count += 1
    return packed, count
