"""A part of the terrain, with fewer columns, as a cloud for display.

Unlike a map it has neither volumes nor a revision, so that it is not taken for the terrain itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray

from msg_bridge.codec.cdr import rows_to_cdr
from msg_bridge.codec.terrain import DISPLAY_FIELDS
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows

__all__ = ["MAX_VIEW_SIZE", "TERRAIN_VIEW", "view_slices", "view_to_cdr"]

MAX_VIEW_SIZE = 257
"""Number of rows, and of columns, that a view has at most by default."""

TERRAIN_VIEW = np.dtype([*DISPLAY_FIELDS, ("rut_depth", "<f4")])  # [m]
"""A point of a view, with layers as of a map."""


def view_slices(grid: Grid, region: Sequence[float], decimation: int) -> tuple[slice, slice]:
    """Return the rows and the columns of a terrain that a view shows.

    Args:
        grid: grid of the terrain.
        region: x and y of two opposite corners [m], map frame; empty: all of it. What lies outside
            of the terrain is left out; of a region that lies outside, the nearest column is shown.
        decimation: every how many-th row and column is shown; 0: so many that a view has at most
            MAX_VIEW_SIZE of either.

    Returns:
        Slices of the rows and the columns, whose step is the decimation.
    """
    spans = [(0, grid.rows - 1), (0, grid.cols - 1)]
    if region:
        x, y = sorted(region[0::2]), sorted(region[1::2])
        row = (grid.x_first - np.array(x[::-1])) / grid.cell
        col = (grid.y_first - np.array(y[::-1])) / grid.cell
        spans = [
            (int(np.clip(np.rint(first), 0, size - 1)), int(np.clip(np.rint(last), 0, size - 1)))
            for (first, last), size in zip((row, col), grid.shape, strict=True)
        ]
    longest = max(last + 1 - first for first, last in spans)
    step = decimation or -(-longest // MAX_VIEW_SIZE)
    rows, cols = (slice(first, last + 1, step) for first, last in spans)
    return rows, cols


def view_to_cdr(
    grid: Grid,
    rows: slice,
    cols: slice,
    layers: dict[str, NDArray[np.generic]],
    frame_id: str,
    stamp: Time,
) -> bytes:
    """Serialise a view as an organised cloud of TERRAIN_VIEW points.

    Args:
        grid: grid of the terrain.
        rows, cols: as of `view_slices`.
        layers: the layers of these rows and columns, by field; those that are missing are zeros.
        frame_id: the map frame.
        stamp: time of the terrain.
    """
    x = grid.x(np.arange(grid.rows)[rows])
    y = grid.y(np.arange(grid.cols)[cols])
    points: Rows = np.zeros((x.size, y.size), dtype=TERRAIN_VIEW)
    points["x"], points["y"] = x[:, np.newaxis], y
    for name, layer in layers.items():
        points[name] = layer
    return rows_to_cdr(points.reshape(-1), frame_id, stamp, height=x.size)
