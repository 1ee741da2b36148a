"""Rasterization of swept tools: lower subcolumns to the surface that a tool sweeps in a tick.

Two consecutive key-point pairs bound a plate; the pairs and the two sides of the plate are its
edges. The plates are rasterized at poses half a subcolumn apart through the tick, and each edge
rasterizes the quad that it sweeps between two poses. The plates alone would not be enough: seen
from above, a steep plate is narrower than the distance between poses, and an upright one has no
area at all. The lower envelope of all of these is the swept surface.

All columns along the last pose of the edges are marked as occupied, so that a plate too thin to
cover the centre of a subcolumn still occupies the columns that it cuts.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import fixed_signature_kernel, helper, kernel
from soil_sim.excavation.rasterize_triangle import rasterize_quad, refine_column
from soil_sim.tool_sweeps import interpolate_key_point

__all__ = ["apply_height_changes", "max_columns_touched", "rasterize_sweep"]

_MAX_POSES = 512
"""Maximum number of poses rasterized in a tick; beyond it plates leave gaps between poses, edges do
not."""

_POSE_TOLERANCE = 1e-6
"""Rounding error of poses between two key points [m], at coordinates up to 1e5 m."""

_BOUNDS_TOLERANCE = 1e-3
"""Extension of bounding rows and columns against rounding [cells]."""


@fixed_signature_kernel
def max_columns_touched(points, has_plate, boxed_raster):  # type: ignore[no-untyped-def]
    """Return an upper bound of the number of columns that pairs and plates touch in the tick.

    Args:
        points: key points at both times and ends, shape (pairs, 2 times, 2 ends, 3), map frame [m].
        has_plate: whether a plate joins each pair to the next one, shape (pairs,).
        boxed_raster: `RasterTables`, boxed.
    """
    grid = boxed_raster.table.grid
    total = 0.0
    for n in range(points.shape[0]):
        end = n + 2 if has_plate[n] else n + 1
        first_row, last_row, first_col, last_col = _bounds(points, n, end, grid)
        total += max(last_row - first_row + 1.0, 0.0) * max(last_col - first_col + 1.0, 0.0)
    return np.int64(min(total, 1.0 * grid.rows * grid.cols))


@helper
def _bounds(points, first, end, grid):  # type: ignore[no-untyped-def]
    """Return the bounds of the columns that pairs `first` to `end` - 1 touch, as floats.

    Returns:
        (first row, last row, first column, last column), clipped to the map.
    """
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for m in range(first, end):
        for t in range(2):
            for p in range(2):
                x0, x1 = min(x0, points[m, t, p, 0]), max(x1, points[m, t, p, 0])
                y0, y1 = min(y0, points[m, t, p, 1]), max(y1, points[m, t, p, 1])
    low, high = 0.5 - _BOUNDS_TOLERANCE, 0.5 + _BOUNDS_TOLERANCE
    return (
        max(np.floor((grid.x_first - x1) / grid.cell + low), 0.0),
        min(np.floor((grid.x_first - x0) / grid.cell + high), grid.rows - 1.0),
        max(np.floor((grid.y_first - y1) / grid.cell + low), 0.0),
        min(np.floor((grid.y_first - y0) / grid.cell + high), grid.cols - 1.0),
    )


@kernel
def rasterize_sweep(points, has_plate, raster, count):  # type: ignore[no-untyped-def]
    """Lower subcolumns to the surface that pairs and plates sweep, and sum what they lose.

    Args:
        points: key points at both times and ends, shape (pairs, 2 times, 2 ends, 3), map frame [m].
        has_plate: whether a plate joins each pair to the next one, shape (pairs,).
        raster: the `Raster`; its refined columns are changed.
        count: number of refined columns.

    Returns:
        The number of refined columns.
    """
    apply_height_changes(raster, count)
    raster.removed_moments[:count] = 0.0  # slots not in use are cleared when they are allocated
    for n in range(points.shape[0]):
        end = n + 2 if has_plate[n] else n + 1
        if _is_airborne(points, n, end, raster):
            continue
        # The pair, then the left and the right side of the plate, as (pair, end) of two key points;
        # in one loop, so that the code for an edge is compiled once.
        for edge in range(3 if has_plate[n] else 1):
            a = n, (1 if edge == 2 else 0)
            b = (n, 1) if edge == 0 else (n + 1, edge - 1)
            count = _rasterize_edge(points, a, b, raster, count)
        if has_plate[n]:
            count = _rasterize_plate(points, n, raster, count)
    return count


@helper
def apply_height_changes(raster, count):  # type: ignore[no-untyped-def]
    """Add to the subcolumns the height changes of their columns since the last sweep."""
    for slot in range(count):
        height = raster.height[raster.cells[slot]]
        shift = height - raster.mean_height[slot]
        if shift != 0.0:
            raster.mean_height[slot] = height
            for q in range(raster.subcolumn_height.shape[1]):
                raster.subcolumn_height[slot, q] += shift


@helper(forceinline=True)
def _is_airborne(points, first, end, raster):  # type: ignore[no-untyped-def]
    """Return whether pairs `first` to `end` - 1 stay above all columns.

    This is cheaper than to rasterize them.
    """
    cols = raster.grid.cols
    lowest = np.inf
    for m in range(first, end):
        for t in range(2):
            for p in range(2):
                lowest = min(lowest, points[m, t, p, 2])
    lowest -= _POSE_TOLERANCE
    first_row, last_row, first_col, last_col = _bounds(points, first, end, raster.grid)
    if last_row < first_row or last_col < first_col:
        return True
    for i in range(np.int64(first_row), np.int64(last_row) + 1):
        for k in range(i * cols + np.int64(first_col), i * cols + np.int64(last_col) + 1):
            slot = raster.slot_of[k]
            if lowest <= raster.height[k] or (slot >= 0 and lowest <= raster.initial_height[slot]):
                return False
    return True


@helper(forceinline=True)
def _rasterize_plate(points, n, raster, count):  # type: ignore[no-untyped-def]
    """Rasterize the plate between pairs n and n + 1 at poses through the tick."""
    poses = 1
    for m in range(n, n + 2):
        for p in range(2):
            poses = max(poses, _num_poses(points, (m, p), raster.grid))
    for s in range(1, poses + 1):
        t = s / poses
        a = interpolate_key_point(points, (n, 0), t)
        b = interpolate_key_point(points, (n, 1), t)
        c = interpolate_key_point(points, (n + 1, 0), t)
        d = interpolate_key_point(points, (n + 1, 1), t)
        count = rasterize_quad(a, b, c, d, raster, count)
    return count


@helper(forceinline=True)
def _rasterize_edge(points, a, b, raster, count):  # type: ignore[no-untyped-def]
    """Rasterize the quads that the edge from key point a to b, each (pair, end), sweeps."""
    poses = max(_num_poses(points, a, raster.grid), _num_poses(points, b, raster.grid))
    (m, p), (n, q) = a, b
    from_a = points[m, 0, p, 0], points[m, 0, p, 1], points[m, 0, p, 2]
    from_b = points[n, 0, q, 0], points[n, 0, q, 1], points[n, 0, q, 2]
    for s in range(1, poses + 1):
        to_a = interpolate_key_point(points, a, s / poses)
        to_b = interpolate_key_point(points, b, s / poses)
        count = rasterize_quad(from_a, from_b, to_a, to_b, raster, count)
        from_a, from_b = to_a, to_b
    return _mark_occupied(from_a, from_b, raster, count)


@helper
def _num_poses(points, which, grid):  # type: ignore[no-untyped-def]
    """Return the number of poses, half a subcolumn apart, for the path of a key point (pair, end).

    At least one.
    """
    n, p = which
    distance = 0.0
    for axis in range(3):
        distance = max(distance, abs(points[n, 1, p, axis] - points[n, 0, p, axis]))
    spacing = 0.5 * grid.cell / grid.subcolumns_per_side
    return np.int64(min(max(np.ceil(distance / spacing), 1.0), _MAX_POSES))


@helper(forceinline=True)
def _mark_occupied(a, b, raster, count):  # type: ignore[no-untyped-def]
    """Mark the columns in which the edge from point a to b lies below the surface."""
    grid = raster.grid
    length = max(abs(b[0] - a[0]), abs(b[1] - a[1]))
    steps = np.int64(min(np.ceil(length / grid.cell * grid.subcolumns_per_side), 1e6))
    for s in range(steps + 1):
        t = s / max(steps, 1)
        row = np.floor((grid.x_first - (1 - t) * a[0] - t * b[0]) / grid.cell + 0.5)
        col = np.floor((grid.y_first - (1 - t) * a[1] - t * b[1]) / grid.cell + 0.5)
        if 0.0 <= row < grid.rows and 0.0 <= col < grid.cols:
            k = np.int64(row) * grid.cols + np.int64(col)
            z = max((1 - t) * a[2] + t * b[2], raster.floor)
            slot = raster.slot_of[k]
            if slot < 0:
                if not z < raster.height[k]:
                    continue
                slot = count
                count += 1
                refine_column(raster, k, slot)
            if z <= raster.initial_height[slot]:
                raster.last_tick[slot] = raster.tick
    return count
