"""Compaction: a plate pushed into loose soil packs it, as track shoes and the back of a bucket do.

No soil is removed: the bulk volume of the loose soil under the plate shrinks, at most to its bank
volume. Firm soil does not yield. A column counts as under the plate if its centre is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.operations import compact_column
from soil_sim.columns.state import Columns
from soil_sim.tool_sweeps import SweptPairs, interpolate_key_point

__all__ = ["compact"]

_MAX_POSES = 64
"""Maximum number of poses of a plate in a tick."""

_MIN_AREA = 1e-12
"""Smallest value of twice the area of a triangle, seen from above [m^2]."""


def compact(columns: Columns, pairs: SweptPairs) -> NDArray[np.int64]:
    """Press loose soil down to the surface that plates sweep in a tick.

    Args:
        columns: the terrain; changed.
        pairs: compacting key-point pairs of one machine.

    Returns:
        Flat indices of the compacted columns, sorted.
    """
    if pairs.has_plate.size == 0:  # as with a machine that has no tracks
        return np.zeros(0, dtype=np.int64)
    compacted: NDArray[np.int64] = _compact(*pairs, columns.boxed_arrays, columns.frame)
    return np.unique(compacted) if compacted.size else compacted


@kernel
def _compact(points, has_plate, boxed_columns, frame):  # type: ignore[no-untyped-def]
    """Compact soil as `compact`; return a column once for each triangle that compacts it."""
    columns = boxed_columns.table
    compacted, count = np.empty(64, dtype=np.int64), np.int64(0)
    for n in range(points.shape[0] - 1):
        if not has_plate[n]:
            continue
        distance = 0.0
        for m in range(n, n + 2):
            for p in range(2):
                for axis in range(3):
                    distance = max(distance, abs(points[m, 1, p, axis] - points[m, 0, p, axis]))
        poses = min(max(1, int(np.ceil(2.0 * distance / frame.cell))), _MAX_POSES)
        for pose in range(1, poses + 1):
            t = pose / poses
            # Left and right end of this pair, then of the next.
            a = interpolate_key_point(points, (n, 0), t)
            b = interpolate_key_point(points, (n, 1), t)
            c = interpolate_key_point(points, (n + 1, 0), t)
            d = interpolate_key_point(points, (n + 1, 1), t)
            for third in (a, d):
                compacted, count = _compact_triangle(b, c, third, columns, frame, compacted, count)
    return compacted[:count]


@helper
def _compact_triangle(a, b, c, columns, frame, compacted, count):  # type: ignore[no-untyped-def]
    """Compact the columns whose centre is under a triangle down to it, and record them.

    Args:
        a, b, c: corners (x, y, z) [m].
        columns: `ColumnArrays` of the terrain; changed.
        frame: `GridFrame` of the terrain.
        compacted: flat indices of columns, of which the first `count` are in use; changed.
        count: number of indices in use.

    Returns:
        (`compacted`, or a larger array in its place, number of indices in use).
    """
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if abs(area) < _MIN_AREA:  # upright
        return compacted, count
    x0, x1 = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
    y0, y1 = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    first_row = max(np.ceil((frame.x_first - x1) / frame.cell), 0.0)
    last_row = min(np.floor((frame.x_first - x0) / frame.cell), frame.rows - 1.0)
    first_col = max(np.ceil((frame.y_first - y1) / frame.cell), 0.0)
    last_col = min(np.floor((frame.y_first - y0) / frame.cell), frame.cols - 1.0)
    if last_row < first_row or last_col < first_col:
        return compacted, count
    for i in range(np.int64(first_row), np.int64(last_row) + 1):
        x = frame.x_first - i * frame.cell
        for j in range(np.int64(first_col), np.int64(last_col) + 1):
            y = frame.y_first - j * frame.cell
            # Barycentric coordinates of the centre of the column.
            u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
            v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
            if u < 0.0 or v < 0.0 or u + v > 1.0:
                continue
            k = i * frame.cols + j
            excess = columns.height[k] - (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]))
            if excess > 0.0 and compact_column(columns, k, excess / columns.metres_per_mm3) > 0:
                if count == compacted.size:
                    larger = np.empty(2 * count, dtype=np.int64)
                    larger[:count] = compacted
                    compacted = larger
                compacted[count] = k
                count += 1
    return compacted, count
