"""The reference's digging rule: collision points lower the grid points around them (3.3.1).

Between the left and right key point of every pair, h points are interpolated. Each lowers the four
grid points around it to its own height wherever they are higher. As in the reference, poses are
sampled at the end of a tick and the cut is as wide as the grid makes it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import Rows, SweepAction
from msg_bridge.kernels import kernel
from soil_sim.columns.state import Columns, mix_moisture, remove_from_column
from soil_sim.excavation.swept_cut import RemovedSoil

__all__ = ["KeyPointCut", "collision_points"]


def collision_points(sweeps: Rows, num_interpolated: int) -> NDArray[np.float64]:
    """The `between` points on each key-point pair at the end of a tick.

    Args:
        sweeps: sound SWEEP rows, left and right end of each pair in turn.
        between: h, points interpolated between the ends, which are left out themselves.

    Returns:
        Shape (pairs * between, 3) [m], map frame; 7 pairs and h = 8 give the reference's 56.
    """
    cutting = sweeps[sweeps["action"] != SweepAction.COMPACT]
    ends = np.stack([cutting["x1"], cutting["y1"], cutting["z1"]], axis=-1).astype(np.float64)
    left, right = ends[0::2], ends[1::2]
    parts = (np.arange(1, num_interpolated + 1) / (num_interpolated + 1))[None, :, None]
    points: NDArray[np.float64] = left[:, None] + parts * (right - left)[:, None]
    return points.reshape(-1, 3)


class KeyPointCut:
    """Lowers the four grid points around each collision point."""

    def __init__(self, columns: Columns, *, num_interpolated: int = 8) -> None:
        """
        Args:
            columns: the terrain this cuts.
            between: h, points between the ends of a pair.
        """
        self._columns = columns
        self._num_interpolated = num_interpolated

    def excavate(self, sweeps: Rows) -> RemovedSoil:
        """Cut at the end poses of one tick's sound SWEEP rows."""
        grid = self._columns.grid
        removed: RemovedSoil = _lower_columns(
            collision_points(sweeps, self._num_interpolated),
            self._columns.arrays,
            grid.rows,
            grid.cols,
            grid.x_first,
            grid.y_first,
            grid.cell,
        )
        return removed


@kernel
def _lower_columns(points, columns, rows, cols, x_first, y_first, cell):  # type: ignore[no-untyped-def]
    """Lower the four grid points around each point; returns what was removed."""
    out = np.empty((4 * points.shape[0], 7))
    n = 0
    for p in range(points.shape[0]):
        row = np.floor((x_first - points[p, 0]) / cell)
        col = np.floor((y_first - points[p, 1]) / cell)
        # Compared as floats: beyond the int range a cast is not defined.
        if not (0.0 <= row <= rows - 2 and 0.0 <= col <= cols - 2):
            continue
        i0, j0 = np.int64(row), np.int64(col)
        z = max(points[p, 2], columns.floor)
        for i in range(i0, i0 + 2):
            for j in range(j0, j0 + 2):
                k = i * cols + j
                if not columns.height[k] > z:
                    continue
                top = columns.height[k]
                soil = columns.loose_soil[k]
                room = (top - z) / columns.metres_per_mm3
                loose, firm = remove_from_column(columns, k, room)
                bank = loose + firm
                if bank > 0:
                    out[n, 0] = k
                    out[n, 1] = bank
                    out[n, 2] = x_first - i * cell
                    out[n, 3] = y_first - j * cell
                    out[n, 4] = 0.5 * (top + z)
                    out[n, 5] = columns.soil[k] if firm > loose else soil
                    wet = columns.loose_moisture[k]  # taking does not change it
                    out[n, 6] = mix_moisture(loose, wet, firm, columns.moisture[k])
                    n += 1
    return out[:n]
