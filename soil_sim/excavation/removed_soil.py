"""Records of the soil that a tool removed from columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper
from soil_sim.columns.operations import mix_moisture, remove_from_column

__all__ = ["REMOVED_SOIL", "RemovedSoil", "remove_soil"]

REMOVED_SOIL = np.dtype(
    [
        ("cell", np.int64),  # flat index of the column
        ("volume_mm3", np.int64),  # bank volume [mm^3], above 0
        ("x", np.float64),  # centroid [m], map frame
        ("y", np.float64),
        ("z", np.float64),
        ("soil", np.uint8),  # id of the kind: the firm soil's if most of the volume was firm
        ("moisture", np.uint8),  # [%], mean of loose and firm soil by volume
    ],
    align=True,
)

RemovedSoil = NDArray[np.void]
"""Records of dtype `REMOVED_SOIL`, shape (n,)."""


@helper(inline="always")
def remove_soil(columns, i, bulk, centroid, removed, count):  # type: ignore[no-untyped-def]
    """Remove a bulk volume [mm^3] from the top of column i, and record it.

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        i: flat index of the column.
        bulk: bulk volume [mm^3].
        centroid: (x, y, z) of the removed soil [m].
        removed: records, of which the first `count` are in use; changed.
        count: number of records in use.

    Returns:
        The number of records in use, one more unless the volume was less than 1 mm^3.
    """
    loose, firm = remove_from_column(columns, i, bulk)
    if loose + firm == 0:
        return count
    record = removed[count]
    record.cell, record.volume_mm3 = i, loose + firm
    record.x, record.y, record.z = centroid
    # Removing soil changes neither the kinds nor the moistures of a column.
    record.soil = columns.soil[i] if firm > loose else columns.loose_soil[i]
    record.moisture = mix_moisture(loose, columns.loose_moisture[i], firm, columns.moisture[i])
    return count + 1
