"""Kernels of the contact surface: heights between grid points, changed cells, rising cells."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "MAX_MOISTURE",
    "GroundLayers",
    "apply_map_updates",
    "raise_surface",
    "set_cells",
    "surface_at",
]

MAX_MOISTURE = 100
"""Maximum moisture for which soil parameters are defined [% of saturation]."""

_ROUNDING_TOLERANCE = 1e-4
"""Height change [m] below which it is a rounding error of messages."""


class GroundLayers(NamedTuple):
    """Layers of `Ground` that change with the terrain, shape (rows, cols) each.

    Attributes:
        elevation, surface, undisturbed_surface, rut_depth, max_sinkage: as of `Ground` [m].
        soil, moisture, changed: as of `Ground`.
        is_rising: whether each cell rises.
    """

    elevation: NDArray[np.float64]
    surface: NDArray[np.float64]
    undisturbed_surface: NDArray[np.float64]
    rut_depth: NDArray[np.float64]
    max_sinkage: NDArray[np.float64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    changed: NDArray[np.bool_]
    is_rising: NDArray[np.bool_]


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
def apply_map_updates(rows, num_soils, boxed_layers, rising, num_rising):  # type: ignore[no-untyped-def]
    """Apply MAP_UPDATE rows, all of them or none.

    Args:
        rows: MAP_UPDATE rows.
        num_soils: number of soils of the run.
        boxed_layers, rising, num_rising: as for `set_cells`.

    Returns:
        Number of cells that rise now; -1 if nothing was changed because a row is off the map, has
        an unknown soil or a height that is not finite.
    """
    layers = boxed_layers.table
    num_rows, num_cols = layers.elevation.shape
    for n in range(rows.size):
        row = rows[n]
        is_on_map = row.row < num_rows and row.col < num_cols
        if not (is_on_map and row.soil < num_soils and np.isfinite(row.z)):
            return -1
    for n in range(rows.size):
        row = rows[n]
        i, j = np.int64(row.row), np.int64(row.col)
        layers.soil[i, j], layers.moisture[i, j] = row.soil, min(row.moisture, MAX_MOISTURE)
        height, rut = np.float64(row.z), np.float64(row.rut_depth)
        if _set_cell(i, j, height, rut, layers):
            rising[num_rising] = i * num_cols + j
            num_rising += 1
    return num_rising


@fixed_signature_kernel
def set_cells(cells, heights, rut_depths, boxed_layers, rising, num_rising):  # type: ignore[no-untyped-def]
    """Set the heights and the depths of ruts of changed cells.

    Args:
        cells: flat indices of the changed cells.
        heights, rut_depths: their new heights and depths of ruts [m].
        boxed_layers: `GroundLayers`, boxed; updated.
        rising: flat indices of the cells that rise, with space for the changed cells; updated.
        num_rising: number of cells that rise already.

    Returns:
        Number of cells that rise now; a cell that was lowered again may be among them.
    """
    layers = boxed_layers.table
    cols = layers.elevation.shape[1]
    for n in range(cells.size):
        if _set_cell(cells[n] // cols, cells[n] % cols, heights[n], rut_depths[n], layers):
            rising[num_rising] = cells[n]
            num_rising += 1
    return num_rising


@helper(forceinline=True)
def _set_cell(i, j, height, rut, layers):  # type: ignore[no-untyped-def]
    """Set the height and the depth of the rut of cell (i, j) [m].

    Returns:
        Whether the cell begins to rise.
    """
    elevation, surface, rut_depth = layers.elevation, layers.surface, layers.rut_depth
    max_sinkage, undisturbed_surface = layers.max_sinkage, layers.undisturbed_surface
    pressed = max(rut - rut_depth[i, j], 0.0)
    moved = abs(height - elevation[i, j] + pressed)  # height of soil added or removed
    if moved > _ROUNDING_TOLERANCE:
        max_sinkage[i, j] -= moved
    max_sinkage[i, j] = max(max_sinkage[i, j], rut)
    elevation[i, j], rut_depth[i, j] = height, rut
    layers.changed[i, j] = True
    undisturbed = height + rut
    surface[i, j] = min(surface[i, j], height)
    undisturbed_surface[i, j] = min(undisturbed_surface[i, j], undisturbed)
    is_below = surface[i, j] < height or undisturbed_surface[i, j] < undisturbed
    if is_below and not layers.is_rising[i, j]:
        layers.is_rising[i, j] = True
        return True
    return False


@fixed_signature_kernel
def raise_surface(rising, step, boxed_layers):  # type: ignore[no-untyped-def]
    """Raise cells by `step` [m] at most.

    Args:
        rising: flat indices of the cells; updated.
        step: maximum rise [m].
        boxed_layers: `GroundLayers`, boxed; updated.

    Returns:
        Number of those still below their heights, which are moved to the front of `rising`.
    """
    layers = boxed_layers.table
    elevation, surface = layers.elevation, layers.surface
    undisturbed_surface = layers.undisturbed_surface
    cols = elevation.shape[1]
    count = 0
    for n in range(rising.size):
        i, j = rising[n] // cols, rising[n] % cols
        undisturbed = elevation[i, j] + layers.rut_depth[i, j]
        surface[i, j] = min(surface[i, j] + step, elevation[i, j])
        undisturbed_surface[i, j] = min(undisturbed_surface[i, j] + step, undisturbed)
        layers.changed[i, j] = True
        is_below = surface[i, j] < elevation[i, j] or undisturbed_surface[i, j] < undisturbed
        layers.is_rising[i, j] = is_below
        if is_below:
            rising[count] = rising[n]
            count += 1
    return count
