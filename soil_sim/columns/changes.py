"""What a tick changed: which columns, by how much, and what their surface looks like now.

Changed is a column whose firm or loose volume, or the room it takes, or what its surface is of, is
another than a tick ago: not one that gave what it got. Where loose soil came to lie there is dirt,
except on ground that was as steep as it can be, from which it only passes (reference, section
3.1.2, step 4). Where firm soil went and none lies on it, it was laid bare.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import Columns, SurfaceMaterial

__all__ = ["ChangeTracker", "ColumnChanges"]

_MAX_COVER_ON_EXCAVATED = 0.005
"""Depth of loose soil that leaves firm soil visible [m]."""

_MIN_LOOSE_COVER = 0.0005
"""Depth of loose soil that is a stain, not soil that came to lie [m]."""

_STEEP_FRACTION = 0.99
"""Part of the steepest slope from which ground counts as being as steep as it can be."""

_EXCAVATED, _LOOSE = int(SurfaceMaterial.EXCAVATED), int(SurfaceMaterial.LOOSE)


class ColumnChanges(NamedTuple):
    """Columns that a tick changed.

    Attributes:
        cells: flat indices of those that changed, in row-major order.
        touched: those, then those that gave what they got.
        grown: by how much the bank volume of each of `touched` grew [mm^3].
    """

    cells: NDArray[np.int64]
    touched: NDArray[np.int64]
    volume_change_mm3: NDArray[np.int64]


class ChangeTracker:
    """Compares a terrain with what it was when last asked."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        # What is known of a column lies together, as it is asked for.
        self._previous = np.stack([layer.reshape(-1) for layer in self._layers()], axis=-1)

    def collect(self) -> ColumnChanges:
        """What changed since the last call; the `material` of these columns follows."""
        columns = self._columns
        touched = columns.pop_touched()
        if touched.size == 0:
            return ColumnChanges(touched, touched, touched)
        touched.sort()
        volume_change_mm3 = np.empty_like(touched)
        count = _find_changes(
            columns.arrays,
            columns.tables.repose_tan,
            columns.grid.rows,
            columns.grid.cols,
            columns.grid.cell,
            touched,
            volume_change_mm3,
            self._previous,
            columns.material.reshape(-1),
        )
        return ColumnChanges(touched[:count], touched, volume_change_mm3)

    def _layers(self) -> tuple[NDArray[np.int64], ...]:
        columns = self._columns
        surface = columns.top_soil.astype(np.int64) << 8 | columns.top_moisture
        return columns.firm, columns.loose, columns.bulk, surface


@kernel
def _find_changes(  # type: ignore[no-untyped-def]
    columns, repose_tan, rows, cols, cell, touched, volume_change_mm3, previous, material
):
    """Move those that changed to the front of `touched`; returns how many there are."""
    firm, loose, bulk = columns.firm, columns.loose, columns.bulk
    count = 0
    for n in range(touched.size):
        i = touched[n]
        same = (
            firm[i] == previous[i, 0] and loose[i] == previous[i, 1] and bulk[i] == previous[i, 2]
        )
        if not (same and _surface_key(columns, i) == previous[i, 3]):
            touched[n], touched[count] = touched[count], i
            count += 1
    for n in range(count):
        i = touched[n]
        bare = (
            firm[i] < previous[i, 0] and bulk[i] * columns.metres_per_mm3 < _MAX_COVER_ON_EXCAVATED
        )
        if bare:  # what came, too: ground that was dug keeps no thin cover
            material[i] = _EXCAVATED
            continue
        came = loose[i] > previous[i, 1] and bulk[i] * columns.metres_per_mm3 > _MIN_LOOSE_COVER
        if came and not _was_at_repose_angle(columns, repose_tan, rows, cols, cell, previous, i):
            material[i] = _LOOSE
    for n in range(touched.size):
        i = touched[n]
        volume_change_mm3[n] = firm[i] + loose[i] - previous[i, 0] - previous[i, 1]
    for n in range(count):
        i = touched[n]
        previous[i, 0], previous[i, 1], previous[i, 2] = firm[i], loose[i], bulk[i]
        previous[i, 3] = _surface_key(columns, i)
    return count


@helper(inline="always")
def _surface_key(columns, i):  # type: ignore[no-untyped-def]
    """Id and moisture of what the surface of a column is of, in one number."""
    if columns.loose[i] > 0:
        return np.int64(columns.loose_soil[i]) << 8 | np.int64(columns.loose_moisture[i])
    return np.int64(columns.soil[i]) << 8 | np.int64(columns.moisture[i])


@helper
def _was_at_repose_angle(columns, repose_tan, rows, cols, cell, previous, i):  # type: ignore[no-untyped-def]
    """Whether a column was at its angle of repose against one of its four neighbours."""
    tangent = repose_tan[columns.soil[i], columns.moisture[i]]
    if columns.loose[i] > 0:
        tangent = repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
    most = _STEEP_FRACTION * tangent * cell / columns.metres_per_mm3
    room = previous[i, 0] + previous[i, 2]
    row, col = i // cols, i % cols
    for r, c in ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)):
        if 0 <= r < rows and 0 <= c < cols:
            j = r * cols + c
            if room - previous[j, 0] - previous[j, 2] > most:
                return True
    return False
