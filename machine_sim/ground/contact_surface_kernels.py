"""Kernels of the contact surface: heights between grid points, changed cells, rising cells."""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import fixed_signature_kernel, kernel

__all__ = ["raise_surface", "set_cells", "surface_at"]

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
):
    """Set the heights and the depths of ruts of changed cells.

    Args:
        cells: flat indices of the changed cells.
        heights, rut_depths: their new heights and depths of ruts [m].
        elevation, surface, rut_depth, max_sinkage, undisturbed_surface: layers of `Ground` [m],
            updated.
        changed: set where a cell has changed, shape (rows, cols).
        is_rising: whether each cell rises, shape (rows, cols); updated.
        rising: flat indices of the cells that rise already.

    Returns:
        Flat indices of the cells that rise now; a cell that was lowered again may be among them.
    """
    cols = elevation.shape[1]
    still_rising = np.empty(rising.size + cells.size, dtype=np.int64)
    for n in range(rising.size):  # not a slice, which compiles much longer
        still_rising[n] = rising[n]
    count = rising.size
    for n in range(cells.size):
        i, j = cells[n] // cols, cells[n] % cols
        pressed = max(rut_depths[n] - rut_depth[i, j], 0.0)
        moved = abs(heights[n] - elevation[i, j] + pressed)  # height of soil added or removed
        if moved > _ROUNDING_TOLERANCE:
            max_sinkage[i, j] -= moved
        max_sinkage[i, j] = max(max_sinkage[i, j], rut_depths[n])
        elevation[i, j], rut_depth[i, j] = heights[n], rut_depths[n]
        changed[i, j] = True
        undisturbed = heights[n] + rut_depths[n]
        surface[i, j] = min(surface[i, j], heights[n])
        undisturbed_surface[i, j] = min(undisturbed_surface[i, j], undisturbed)
        is_below = surface[i, j] < heights[n] or undisturbed_surface[i, j] < undisturbed
        if is_below and not is_rising[i, j]:
            is_rising[i, j] = True
            still_rising[count] = cells[n]
            count += 1
    return still_rising[:count].copy()


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
