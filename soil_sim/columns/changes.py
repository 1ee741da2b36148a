"""Changes of the terrain in a tick: which columns, what volume, and the material of the surface.

A column is changed if its firm or loose volume, its height, or the kind or moisture of its surface,
differs from the end of the previous tick. A column that gave away exactly what it received is not.

The surface becomes loose where loose soil was deposited, except on a slope that was at its angle of
repose, over which soil only passes (reference, section 3.1.2, step 4). It becomes excavated where
firm soil was removed and almost no loose soil covers it, or undisturbed soil was pressed down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import fixed_signature_kernel, helper
from soil_sim.columns.state import Columns, SurfaceMaterial

__all__ = ["ChangeTracker", "ColumnChanges"]

_MAX_COVER_ON_EXCAVATED = 0.005
"""Depth of loose soil below which excavated firm soil remains visible [m]."""

_MIN_LOOSE_COVER = 0.0005
"""Depth of loose soil below which the surface does not count as loose [m]."""

_MIN_RUT_DEPTH = 0.003
"""Depth of a rut from which undisturbed soil counts as exposed [m]."""

_STEEP_FRACTION = 0.99
"""Fraction of the limiting slope from which a column counts as being at its angle of repose."""

_UNDISTURBED, _EXCAVATED, _LOOSE = (
    int(SurfaceMaterial.UNDISTURBED),
    int(SurfaceMaterial.EXCAVATED),
    int(SurfaceMaterial.LOOSE),
)

_FIRM, _LOOSE_VOLUME, _BULK, _SURFACE = range(4)
"""Fields of a row of the previous state: volumes [mm^3], `_surface_key` of the surface.

The bulk volume is that of loose soil less the packing of firm soil: with the volume of firm soil it
gives the height."""


class ColumnChanges(NamedTuple):
    """Columns that a tick changed.

    Attributes:
        cells: flat indices of the changed columns, in row-major order, int64.
        touched: those, followed by the columns that were touched but not changed (unsorted), int64.
        volume_change_mm3: increase of the bank volume of each of `touched` [mm^3], int64.
    """

    cells: NDArray[np.int64]
    touched: NDArray[np.int64]
    volume_change_mm3: NDArray[np.int64]


class ChangeTracker:
    """Compares a terrain with its state at the previous call."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        # One row for each column: the fields of a column are read together.
        self._previous = np.stack([layer.reshape(-1) for layer in self._layers()], axis=-1)

    def collect(self) -> ColumnChanges:
        """Return the changes since the previous call, and update the material of the columns."""
        columns = self._columns
        touched = columns.pop_touched()
        if touched.size == 0:
            return ColumnChanges(touched, touched, touched)
        touched.sort()
        volume_change_mm3 = np.empty_like(touched)
        count = _find_changes(
            columns.boxed_arrays,
            columns.tables.repose_tan,
            columns.frame,
            touched,
            volume_change_mm3,
            self._previous,
            columns.material.reshape(-1),
        )
        return ColumnChanges(touched[:count], touched, volume_change_mm3)

    def _layers(self) -> tuple[NDArray[np.int64], ...]:
        """Return the layers in the order of the fields of the previous state."""
        columns = self._columns
        surface = columns.top_soil.astype(np.int64) << 8 | columns.top_moisture
        return columns.firm, columns.loose, columns.bulk - columns.packing, surface


@fixed_signature_kernel
def _find_changes(  # type: ignore[no-untyped-def]
    boxed_columns, repose_tan, frame, touched, volume_change_mm3, previous, material
):
    """Move the changed columns to the front of `touched`; return their number."""
    columns = boxed_columns.table
    firm, loose, bulk = columns.firm, columns.loose, columns.bulk
    count = 0
    for n in range(touched.size):
        i = touched[n]
        is_volume_same = (
            firm[i] == previous[i, _FIRM]
            and loose[i] == previous[i, _LOOSE_VOLUME]
            and bulk[i] - columns.packing[i] == previous[i, _BULK]
        )
        if not (is_volume_same and _surface_key(columns, i) == previous[i, _SURFACE]):
            touched[n], touched[count] = touched[count], i
            count += 1
    for n in range(count):
        i = touched[n]
        cover = bulk[i] * columns.metres_per_mm3
        if firm[i] < previous[i, _FIRM] and cover < _MAX_COVER_ON_EXCAVATED:
            material[i] = _EXCAVATED  # also where a thin layer of loose soil was deposited
            continue
        rut_depth = columns.rut_volume[i] * columns.metres_per_mm3
        if material[i] == _UNDISTURBED and rut_depth > _MIN_RUT_DEPTH:
            material[i] = _EXCAVATED
        is_deposited = loose[i] > previous[i, _LOOSE_VOLUME] and cover > _MIN_LOOSE_COVER
        if is_deposited and not _was_at_repose_angle(columns, repose_tan, frame, previous, i):
            material[i] = _LOOSE
    for n in range(touched.size):
        i = touched[n]
        before = previous[i, _FIRM] + previous[i, _LOOSE_VOLUME]
        volume_change_mm3[n] = firm[i] + loose[i] - before
    for n in range(count):
        i = touched[n]
        previous[i, _FIRM] = firm[i]
        previous[i, _LOOSE_VOLUME] = loose[i]
        previous[i, _BULK] = bulk[i] - columns.packing[i]
        previous[i, _SURFACE] = _surface_key(columns, i)
    return count


@helper(forceinline=True)
def _surface_key(columns, i):  # type: ignore[no-untyped-def]
    """Return kind and moisture of the surface of column i packed into one integer."""
    if columns.loose[i] > 0:
        return np.int64(columns.loose_soil[i]) << 8 | np.int64(columns.loose_moisture[i])
    return np.int64(columns.soil[i]) << 8 | np.int64(columns.moisture[i])


@helper
def _was_at_repose_angle(columns, repose_tan, frame, previous, i):  # type: ignore[no-untyped-def]
    """Return whether column i was at its angle of repose against one of its four neighbours."""
    tangent = repose_tan[columns.soil[i], columns.moisture[i]]
    if columns.loose[i] > 0:
        tangent = repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
    limit = _STEEP_FRACTION * tangent * frame.cell / columns.metres_per_mm3
    volume = previous[i, _FIRM] + previous[i, _BULK]
    row, col = i // frame.cols, i % frame.cols
    for r, c in ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)):
        if 0 <= r < frame.rows and 0 <= c < frame.cols:
            j = r * frame.cols + c
            if volume - previous[j, _FIRM] - previous[j, _BULK] > limit:
                return True
    return False
