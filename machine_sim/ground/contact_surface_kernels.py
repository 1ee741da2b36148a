"""Kernels of the contact surface: heights between grid points, changed cells, rising cells."""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = ["MAX_MOISTURE", "apply_map_updates", "raise_surface", "set_cells", "surface_at"]

MAX_MOISTURE = 100
"""Maximum moisture for which soil parameters are defined [% of saturation]."""

_ROUNDING_TOLERANCE = 1e-4
"""Height change [m] below which it is a rounding error of messages."""


@kernel(inline="always")
def surface_at(surface, x_first, y_first, inverse_cell, x, y):  # type: ignore[no-untyped-def]
    """Return the bilinear height [m] and the slopes dz/dx, dz/dy at (x, y) [m], map frame.

    Beyond the outer grid points the height of the edge continues horizontally: the slope toward
    the edge is 0 there, and the slope along the edge is that of the edge.
    """
    rows, cols = surface.shape
    row, col = (x_first - x) * inverse_cell, (y_first - y) * inverse_cell
    u = min(max(row, 0.0), rows - 1.0)
    v = min(max(col, 0.0), cols - 1.0)
    is_beyond_x, is_beyond_y = u != row, v != col
    i = min(int(math.floor(u)), rows - 2)
    j = min(int(math.floor(v)), cols - 2)
    u -= i
    v -= j
    a, b = surface[i, j], surface[i, j + 1]
    c, d = surface[i + 1, j], surface[i + 1, j + 1]
    height = (a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u
    slope_x = 0.0 if is_beyond_x else -((c - a) * (1 - v) + (d - b) * v) * inverse_cell
    slope_y = 0.0 if is_beyond_y else -((b - a) * (1 - u) + (d - c) * u) * inverse_cell
    return height, slope_x, slope_y


@kernel
def apply_map_updates(  # type: ignore[no-untyped-def]
    rows,
    num_soils,
    soil,
    moisture,
    elevation,
    surface,
    rut_depth,
    max_sinkage,
    undisturbed_surface,
    changed,
    is_rising,
    rising,
    num_rising,
):
    """Apply MAP_UPDATE rows, all of them or none.

    Args:
        rows: MAP_UPDATE rows.
        num_soils: number of soils of the run.
        soil, moisture: layers of `Ground`, updated.
        elevation, surface, rut_depth, max_sinkage, undisturbed_surface: as for `set_cells`.
        changed, is_rising, rising, num_rising: as for `set_cells`.

    Returns:
        Number of cells that rise now; -1 if nothing was changed because a row is off the map, has
        an unknown soil or a height that is not finite.
    """
    for n in range(rows.size):
        row = rows[n]
        is_on_map = row.row < elevation.shape[0] and row.col < elevation.shape[1]
        if not (is_on_map and row.soil < num_soils and np.isfinite(row.z)):
            return -1
    for n in range(rows.size):
        row = rows[n]
        i, j = np.int64(row.row), np.int64(row.col)
        soil[i, j], moisture[i, j] = row.soil, min(row.moisture, MAX_MOISTURE)
        num_rising = _set_cell(
            i,
            j,
            np.float64(row.z),
            np.float64(row.rut_depth),
            elevation,
            surface,
            rut_depth,
            max_sinkage,
            undisturbed_surface,
            changed,
            is_rising,
            rising,
            num_rising,
        )
    return num_rising


@fixed_signature_kernel
def set_cells(  # type: ignore[no-untyped-def]
    cells,
    heights,
    rut_depths,
    elevation,
    surface,
    rut_depth,
    max_sinkage,
    undisturbed_surface,
    changed,
    is_rising,
    rising,
    num_rising,
):
    """Set the heights and the depths of ruts of changed cells.

    Args:
        cells: flat indices of the changed cells.
        heights, rut_depths: their new heights and depths of ruts [m].
        elevation, surface, rut_depth, max_sinkage, undisturbed_surface: layers of `Ground` [m],
            updated.
        changed: set where a cell has changed, shape (rows, cols).
        is_rising: whether each cell rises, shape (rows, cols); updated.
        rising: flat indices of the cells that rise, with space for the changed cells; updated.
        num_rising: number of cells that rise already.

    Returns:
        Number of cells that rise now; a cell that was lowered again may be among them.
    """
    cols = elevation.shape[1]
    for n in range(cells.size):
        num_rising = _set_cell(
            cells[n] // cols,
            cells[n] % cols,
            heights[n],
            rut_depths[n],
            elevation,
            surface,
            rut_depth,
            max_sinkage,
            undisturbed_surface,
            changed,
            is_rising,
            rising,
            num_rising,
        )
    return num_rising


@helper(forceinline=True)
def _set_cell(  # type: ignore[no-untyped-def]
    i,
    j,
    height,
    rut,
    elevation,
    surface,
    rut_depth,
    max_sinkage,
    undisturbed_surface,
    changed,
    is_rising,
    rising,
    num_rising,
):
    """Set the height and the depth of the rut of cell (i, j) [m]; else as `set_cells`."""
    pressed = max(rut - rut_depth[i, j], 0.0)
    moved = abs(height - elevation[i, j] + pressed)  # height of soil added or removed
    if moved > _ROUNDING_TOLERANCE:
        max_sinkage[i, j] -= moved
    max_sinkage[i, j] = max(max_sinkage[i, j], rut)
    elevation[i, j], rut_depth[i, j] = height, rut
    changed[i, j] = True
    undisturbed = height + rut
    surface[i, j] = min(surface[i, j], height)
    undisturbed_surface[i, j] = min(undisturbed_surface[i, j], undisturbed)
    is_below = surface[i, j] < height or undisturbed_surface[i, j] < undisturbed
    if is_below and not is_rising[i, j]:
        is_rising[i, j] = True
        rising[num_rising] = i * elevation.shape[1] + j
        return num_rising + 1
    return num_rising


@fixed_signature_kernel
def raise_surface(  # type: ignore[no-untyped-def]
    rising, step, elevation, surface, rut_depth, undisturbed_surface, changed, is_rising
):
    """Raise cells by `step` [m] at most.

    Returns:
        Number of those still below their heights, which are moved to the front of `rising`.
    """
    cols = elevation.shape[1]
    count = 0
    for n in range(rising.size):
        i, j = rising[n] // cols, rising[n] % cols
        undisturbed = elevation[i, j] + rut_depth[i, j]
        surface[i, j] = min(surface[i, j] + step, elevation[i, j])
        undisturbed_surface[i, j] = min(undisturbed_surface[i, j] + step, undisturbed)
        changed[i, j] = True
        is_rising[i, j] = surface[i, j] < elevation[i, j] or undisturbed_surface[i, j] < undisturbed
        if is_rising[i, j]:
            rising[count] = rising[n]
            count += 1
    return count
