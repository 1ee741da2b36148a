"""Painting: lowering subcolumns to what a tool's edges and plates sweep in a tick.

Two key-point pairs bound a plate; the pairs and the plates' sides are its edges. Through a tick
the plates are painted at poses half a subcolumn apart, and between poses each edge paints the quad
it swept. The plates alone would not do: seen from above a steep plate is narrower than the way
between poses, and an upright one has no area at all. The lower envelope of all is the sweep.

Along the edges' last pose all columns are noted, so that a plate too thin to cover the centre of
any subcolumn still stands in the columns it cuts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msg_bridge.kernels import helper, kernel

__all__ = ["SubcolumnGrid", "max_columns_touched", "rasterize_sweep"]

_MAX_POSES = 512
"""Poses painted in one tick, at most; beyond it plates leave gaps between poses, edges do not."""

_SAMPLE_OFFSET_U, _SAMPLE_OFFSET_V = 1e-3, 1.7e-3
"""Samples lie this much [subcolumns] off the centres. An edge on a row of centres, as maps and
tools in round numbers have, would else count half a subcolumn too much or, by rounding, too
little; two parts, so that edges at 45 degrees gain from it too."""

_SPAN_TOLERANCE = 1e-9
"""Widening of a triangle's rows [subcolumns], so that neighbours leave no crack by rounding."""


_POSE_TOLERANCE = 1e-6
"""Poses between two key points may lie this much [m] outside them, at coordinates up to 1e5 m."""


class SubcolumnGrid(NamedTuple):
    """The grid of subcolumns, for kernels.

    Attributes:
        rows, cols, cell, x_first, y_first: as in `Grid`.
        subcolumns_per_side: subcolumns along a side of a column.
    """

    rows: int
    cols: int
    cell: float
    x_first: float
    y_first: float
    subcolumns_per_side: int


@kernel
def max_columns_touched(points, has_plate, subgrid):  # type: ignore[no-untyped-def]
    """Upper bound of the number of columns the pairs and plates can touch in the tick."""
    most = 0.0
    for n in range(points.shape[0]):
        top, bottom, left, right = _bounding_columns(
            points, n, n + 2 if has_plate[n] else n + 1, subgrid
        )
        most += max(bottom - top + 1.0, 0.0) * max(right - left + 1.0, 0.0)
    return np.int64(min(most, 1.0 * subgrid.rows * subgrid.cols))


@helper
def _bounding_columns(points, first, end, subgrid):  # type: ignore[no-untyped-def]
    """First and last row, first and last column, as floats, of what pairs `first` to `end` may
    touch."""
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for m in range(first, end):
        for t in range(2):
            for p in range(2):
                x0, x1 = min(x0, points[m, t, p, 0]), max(x1, points[m, t, p, 0])
                y0, y1 = min(y0, points[m, t, p, 1]), max(y1, points[m, t, p, 1])
    # In columns from the first one's outer side; a little wider, lest rounding matters.
    return (
        max(np.floor((subgrid.x_first - x1) / subgrid.cell + 0.499), 0.0),
        min(np.floor((subgrid.x_first - x0) / subgrid.cell + 0.501), subgrid.rows - 1.0),
        max(np.floor((subgrid.y_first - y1) / subgrid.cell + 0.499), 0.0),
        min(np.floor((subgrid.y_first - y0) / subgrid.cell + 0.501), subgrid.cols - 1.0),
    )


@kernel
def rasterize_sweep(points, has_plate, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Lower subcolumns to what the pairs sweep, and sum what they lose.

    Args:
        points, joined: of `SweptPairs`.
        height, floor: of `ColumnArrays`.
        refined: of `RefinedArrays`.
        raster: of `SubcolumnGrid`.
        count: the number of refined columns.
        tick: number of the tick.

    Returns:
        The number of refined columns.
    """
    _apply_height_changes(height, refined, subgrid, count)
    for n in range(points.shape[0]):
        if _is_airborne(points, n, n + 2 if has_plate[n] else n + 1, height, refined, subgrid):
            continue
        for edge in range(3 if has_plate[n] else 1):  # the pair itself, the left and right side
            a = n, (1 if edge == 2 else 0)
            b = (n, 1) if edge == 0 else (n + 1, edge - 1)
            count = _rasterize_edge(points, a, b, height, floor, refined, subgrid, count, tick)
        if has_plate[n]:
            count = _rasterize_plate(points, n, height, floor, refined, subgrid, count, tick)
    return count


@helper(inline="always")
def _is_airborne(points, first, end, height, refined, subgrid):  # type: ignore[no-untyped-def]
    """Whether pairs `first` to `end` stay above all columns they pass; cheaper than to paint."""
    lowest = np.inf
    for m in range(first, end):
        for t in range(2):
            for p in range(2):
                lowest = min(lowest, points[m, t, p, 2])
    lowest -= _POSE_TOLERANCE
    top, bottom, left, right = _bounding_columns(points, first, end, subgrid)
    if bottom < top or right < left:
        return True
    for i in range(np.int64(top), np.int64(bottom) + 1):
        for k in range(i * subgrid.cols + np.int64(left), i * subgrid.cols + np.int64(right) + 1):
            slot = refined.slot_of[k]
            if lowest <= height[k] or (slot >= 0 and lowest <= refined.initial_height[slot]):
                return False
    return True


@kernel
def _apply_height_changes(height, refined, subgrid, count):  # type: ignore[no-untyped-def]
    """Soil that slipped or landed since lifts or lowers all subcolumns of its column alike."""
    for slot in range(count):
        now = height[refined.cells[slot]]
        shift = now - refined.mean_height[slot]
        if shift != 0.0:
            refined.mean_height[slot] = now
            for q in range(subgrid.subcolumns_per_side * subgrid.subcolumns_per_side):
                refined.subcolumn_height[slot, q] += shift


@helper(inline="always")
def _rasterize_plate(points, n, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Paint the plate between pairs n and n + 1 at poses through the tick."""
    poses = 1
    for m in range(n, n + 2):
        for p in range(2):
            poses = max(poses, _num_poses(points, (m, p), subgrid))
    for s in range(1, poses + 1):
        t = s / poses
        a, b = _interpolate_key_point(points, (n, 0), t), _interpolate_key_point(points, (n, 1), t)
        c, d = (
            _interpolate_key_point(points, (n + 1, 0), t),
            _interpolate_key_point(points, (n + 1, 1), t),
        )
        count = _rasterize_quad(a, b, c, d, height, floor, refined, subgrid, count, tick)
    return count


@helper(inline="always")
def _rasterize_edge(points, a, b, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Paint what the edge from key point a to b, each (pair, end), sweeps between poses."""
    poses = max(_num_poses(points, a, subgrid), _num_poses(points, b, subgrid))
    (m, p), (n, q) = a, b
    from_a = points[m, 0, p, 0], points[m, 0, p, 1], points[m, 0, p, 2]
    from_b = points[n, 0, q, 0], points[n, 0, q, 1], points[n, 0, q, 2]
    for s in range(1, poses + 1):
        to_a, to_b = (
            _interpolate_key_point(points, a, s / poses),
            _interpolate_key_point(points, b, s / poses),
        )
        count = _rasterize_quad(
            from_a, from_b, to_a, to_b, height, floor, refined, subgrid, count, tick
        )
        from_a, from_b = to_a, to_b
    return _mark_occupied(from_a, from_b, height, floor, refined, subgrid, count, tick)


@helper(inline="always")
def _interpolate_key_point(points, which, t):  # type: ignore[no-untyped-def]
    """Where a key point (pair, end) is at a part t of the tick."""
    n, p = which
    return (
        (1 - t) * points[n, 0, p, 0] + t * points[n, 1, p, 0],
        (1 - t) * points[n, 0, p, 1] + t * points[n, 1, p, 1],
        (1 - t) * points[n, 0, p, 2] + t * points[n, 1, p, 2],
    )


@helper
def _num_poses(points, which, subgrid):  # type: ignore[no-untyped-def]
    """Poses through the tick for the way of a key point (pair, end): half a subcolumn apart, at
    least one."""
    n, p = which
    way = 0.0
    for axis in range(3):
        way = max(way, abs(points[n, 1, p, axis] - points[n, 0, p, axis]))
    return np.int64(
        min(max(np.ceil(way / (0.5 * subgrid.cell / subgrid.subcolumns_per_side)), 1.0), _MAX_POSES)
    )


@helper(inline="always")
def _mark_occupied(a, b, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Note the columns in which the edge from a to b lies below the surface."""
    length = max(abs(b[0] - a[0]), abs(b[1] - a[1]))
    steps = np.int64(min(np.ceil(length / subgrid.cell * subgrid.subcolumns_per_side), 1e6))
    for s in range(steps + 1):
        t = s / max(steps, 1)
        row = np.floor((subgrid.x_first - (1 - t) * a[0] - t * b[0]) / subgrid.cell + 0.5)
        col = np.floor((subgrid.y_first - (1 - t) * a[1] - t * b[1]) / subgrid.cell + 0.5)
        if 0.0 <= row < subgrid.rows and 0.0 <= col < subgrid.cols:
            k = np.int64(row) * subgrid.cols + np.int64(col)
            z = max((1 - t) * a[2] + t * b[2], floor)
            slot = refined.slot_of[k]
            if slot < 0:
                if not z < height[k]:
                    continue
                slot = count
                count += 1
                _refine_column(k, height, refined, slot)
            if z <= refined.initial_height[slot]:
                refined.last_tick[slot] = tick
    return count


@helper
def _refine_column(k, height, refined, slot):  # type: ignore[no-untyped-def]
    """Give column k, level so far, a slot."""
    top = height[k]
    refined.slot_of[k] = slot
    refined.cells[slot] = k
    refined.mean_height[slot] = top
    refined.initial_height[slot] = top
    for q in range(refined.subcolumn_height.shape[1]):
        refined.subcolumn_height[slot, q] = top
    for n in range(refined.removed_moments.shape[1]):
        refined.removed_moments[slot, n] = 0.0


@helper
def _rasterize_quad(a, b, c, d, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Lower subcolumns to the two triangles (a, b, c) and (b, d, c) of four corners."""
    count = _rasterize_triangle(a, b, c, height, floor, refined, subgrid, count, tick)
    return _rasterize_triangle(b, d, c, height, floor, refined, subgrid, count, tick)


@helper
def _rasterize_triangle(a, b, c, height, floor, refined, subgrid, count, tick):  # type: ignore[no-untyped-def]
    """Lower the subcolumns whose samples lie under a triangle; returns the refined columns."""
    # In units of subcolumns, so that the sample of subcolumn (fi, fj) lies at (fi, fj).
    subcolumns_per_side = subgrid.subcolumns_per_side
    fine = subgrid.cell / subcolumns_per_side
    shift = 0.5 * subcolumns_per_side - 0.5
    x, y = subgrid.x_first + shift * fine, subgrid.y_first + shift * fine
    ua, va = (x - a[0]) / fine - _SAMPLE_OFFSET_U, (y - a[1]) / fine - _SAMPLE_OFFSET_V
    ub, vb = (x - b[0]) / fine - _SAMPLE_OFFSET_U, (y - b[1]) / fine - _SAMPLE_OFFSET_V
    uc, vc = (x - c[0]) / fine - _SAMPLE_OFFSET_U, (y - c[1]) / fine - _SAMPLE_OFFSET_V
    area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
    if not 1e-9 < abs(area) < 1e18:
        return count
    z_u = ((b[2] - a[2]) * (vc - va) - (c[2] - a[2]) * (vb - va)) / area
    z_v = ((ub - ua) * (c[2] - a[2]) - (uc - ua) * (b[2] - a[2])) / area
    lowest = max(min(a[2], b[2], c[2]), floor)
    highest = max(a[2], b[2], c[2])
    # Clipped as floats: beyond the int range a cast is not defined.
    rows, cols = (
        float(subgrid.rows * subcolumns_per_side),
        float(subgrid.cols * subcolumns_per_side),
    )
    first = np.int64(min(max(np.ceil(min(ua, ub, uc)), 0.0), rows))
    last = np.int64(max(min(np.floor(max(ua, ub, uc)), rows - 1.0), -1.0))
    for fi in range(first, last + 1):
        # No calls with tables in this loop: numba counts references to each of their arrays.
        lo, hi = _extend_span(fi, ua, va, ub, vb, np.inf, -np.inf)
        lo, hi = _extend_span(fi, ub, vb, uc, vc, lo, hi)
        lo, hi = _extend_span(fi, uc, vc, ua, va, lo, hi)
        j0 = np.int64(min(max(np.ceil(lo - _SPAN_TOLERANCE), 0.0), cols))
        j1 = np.int64(max(min(np.floor(hi + _SPAN_TOLERANCE), cols - 1.0), -1.0))
        i = fi // subcolumns_per_side
        for fj in range(j0, j1 + 1):
            # Within the triangle's heights: a sliver's slopes are ill-conditioned.
            z = max(min(a[2] + z_u * (fi - ua) + z_v * (fj - va), highest), lowest)
            j = fj // subcolumns_per_side
            k = i * subgrid.cols + j
            slot = refined.slot_of[k]
            if slot < 0:
                if not z < height[k]:
                    continue
                slot = count
                count += 1
                _refine_column(k, height, refined, slot)
            if z <= refined.initial_height[slot]:
                refined.last_tick[slot] = tick
            q = (fi - i * subcolumns_per_side) * subcolumns_per_side + fj - j * subcolumns_per_side
            lost = refined.subcolumn_height[slot, q] - z
            if lost > 0.0:
                refined.subcolumn_height[slot, q] = z
                refined.removed_moments[slot, 0] += lost
                refined.removed_moments[slot, 1] += lost * (x - fi * fine)
                refined.removed_moments[slot, 2] += lost * (y - fj * fine)
                refined.removed_moments[slot, 3] += lost * (z + 0.5 * lost)
    return count


@helper(inline="always")
def _extend_span(u, ua, va, ub, vb, lo, hi):  # type: ignore[no-untyped-def]
    """Widen (lo, hi) by where the side from a to b crosses row u, if it does."""
    if (ua <= u) != (ub <= u):
        v = va + (u - ua) * (vb - va) / (ub - ua)
        lo, hi = min(lo, v), max(hi, v)
    return lo, hi
