"""The digging rule of the 2014 reference: collision points lower the grid points around them.

Between the left and right key point of every pair, h points are interpolated (section 3.3.1). Each
lowers those of the four grid points around it that are higher than itself to its own height. As in
the reference, only the poses at the end of a tick are used, and the width of the cut depends on the
grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import Rows, SweepAction
from msg_bridge.kernels import kernel
from soil_sim.columns.operations import mix_moisture, remove_from_column
from soil_sim.columns.state import Columns
from soil_sim.excavation.removed_soil import REMOVED_SOIL, RemovedSoil

__all__ = ["KeyPointCut", "collision_points"]


def collision_points(sweeps: Rows, num_interpolated: int) -> NDArray[np.float64]:
    """Return the points interpolated on each key-point pair at the end of a tick.

    Args:
        sweeps: valid SWEEP rows, left and right end of each pair in turn.
        num_interpolated: h, number of points between the ends, which are excluded.

    Returns:
        Points [m], map frame, shape (pairs * h, 3); 7 pairs and h = 8 give the 56 of the reference.
    """
    cutting = sweeps[sweeps["action"] != SweepAction.COMPACT]
    ends = np.stack([cutting["x1"], cutting["y1"], cutting["z1"]], axis=-1).astype(np.float64)
    left, right = ends[0::2], ends[1::2]
    fractions = (np.arange(1, num_interpolated + 1) / (num_interpolated + 1))[None, :, None]
    points: NDArray[np.float64] = left[:, None] + fractions * (right - left)[:, None]
    return points.reshape(-1, 3)


class KeyPointCut:
    """Lowers the four grid points around each collision point."""

    def __init__(self, columns: Columns, *, num_interpolated: int = 8) -> None:
        """
        Args:
            columns: terrain to cut.
            num_interpolated: h, number of points between the ends of a pair.
        """
        self._columns = columns
        self._num_interpolated = num_interpolated

    def excavate(self, sweeps: Rows) -> RemovedSoil:
        """Cut at the end poses of the valid SWEEP rows of one tick; return the removed soil."""
        points = collision_points(sweeps, self._num_interpolated)
        removed: RemovedSoil = _lower_columns(points, self._columns.arrays, self._columns.frame)
        return removed


@kernel
def _lower_columns(points, columns, frame):  # type: ignore[no-untyped-def]
    """Lower the four grid points around each point; return `REMOVED_SOIL` records."""
    removed = np.empty(4 * points.shape[0], REMOVED_SOIL)
    count = 0
    for p in range(points.shape[0]):
        row = np.floor((frame.x_first - points[p, 0]) / frame.cell)
        col = np.floor((frame.y_first - points[p, 1]) / frame.cell)
        # Compared as floats: a cast of a number beyond the range of integers is undefined.
        if not (0.0 <= row <= frame.rows - 2 and 0.0 <= col <= frame.cols - 2):
            continue
        first_row, first_col = np.int64(row), np.int64(col)
        z = max(points[p, 2], columns.floor)
        for i in range(first_row, first_row + 2):
            for j in range(first_col, first_col + 2):
                k = i * frame.cols + j
                top = columns.height[k]
                if not top > z:
                    continue
                x, y = frame.x_first - i * frame.cell, frame.y_first - j * frame.cell
                bulk = (top - z) / columns.metres_per_mm3
                loose, firm = remove_from_column(columns, k, bulk)
                if loose + firm == 0:
                    continue
                record = removed[count]
                record.cell, record.volume_mm3 = k, loose + firm
                record.x, record.y, record.z = x, y, 0.5 * (top + z)
                # Removing soil changes neither the kinds nor the moistures of a column.
                record.soil = columns.soil[k] if firm > loose else columns.loose_soil[k]
                record.moisture = mix_moisture(
                    loose, columns.loose_moisture[k], firm, columns.moisture[k]
                )
                count += 1
    return removed[:count]
