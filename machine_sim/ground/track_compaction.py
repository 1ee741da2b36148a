"""Track compaction: depth by which tracks have compacted each column of the terrain.

The pressure under a track depends on its sinkage below the undisturbed surface. The soil publishes
the present heights but not the cause of a change: a column that became lower was compacted,
excavated, or failed as a slope. Its bank volume separates these cases, because compaction leaves
the volume unchanged. Tracks that return do not compact a rut further; soil that is added or removed
reduces the stored depth by the height it accounts for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import kernel

__all__ = ["TrackCompaction"]

_ROUNDING_TOLERANCE = 1e-4
"""Height change [m] below which it is a rounding error of messages."""


class TrackCompaction:
    """Compaction of each column; arrays have shape (rows, cols), float64.

    Attributes:
        volume_mm3: bank volume [mm^3]; NaN where unknown.
        compaction_depth: depth of the surface below the undisturbed surface [m].
        max_sinkage: maximum depth of soles below it [m], at least `compaction_depth`; soles
            write it.
    """

    def __init__(self, grid: Grid, swell: float) -> None:
        """
        Args:
            grid: grid of the columns.
            swell: maximum swell of the soils.
        """
        self.volume_mm3: NDArray[np.float64] = np.full(grid.shape, np.nan)
        self.compaction_depth: NDArray[np.float64] = np.zeros(grid.shape)
        self.max_sinkage: NDArray[np.float64] = np.zeros(grid.shape)
        self._bank_height_per_mm3 = 1e-3 / grid.cell_area_mm2  # [m/mm^3]
        self._max_loose_height_per_mm3 = self._bank_height_per_mm3 * (1.0 + swell)  # [m/mm^3]

    def continue_from(self, other: TrackCompaction) -> None:
        """Take the columns of one of the same grid."""
        self.volume_mm3[:] = other.volume_mm3
        self.compaction_depth[:] = other.compaction_depth
        self.max_sinkage[:] = other.max_sinkage

    def apply_changes(
        self,
        cells: NDArray[np.int64],
        rise: NDArray[np.float64],
        volume_mm3: NDArray[np.float64],
    ) -> None:
        """Update the compaction of changed columns.

        Args:
            cells: flat indices of the columns.
            rise: change of their surface height [m].
            volume_mm3: their present bank volume [mm^3]; NaN if unknown.
        """
        columns = (
            self.volume_mm3.reshape(-1),
            self.compaction_depth.reshape(-1),
            self.max_sinkage.reshape(-1),
        )
        _update_columns(
            cells,
            rise,
            volume_mm3,
            *columns,
            self._bank_height_per_mm3,
            self._max_loose_height_per_mm3,
        )


@kernel
def _update_columns(cells, rise, volume, known, compaction_depth, max_sinkage, bank, loose):  # type: ignore[no-untyped-def]
    """Update compaction depth and sinkage of columns; see `TrackCompaction.apply_changes`.

    Args:
        cells, rise, volume: see `TrackCompaction.apply_changes`.
        known: bank volumes before the change [mm^3], flat; out, the present ones.
        compaction_depth, max_sinkage: flat, updated in place.
        bank, loose: height per volume of bank soil and of the loosest soil [m/mm^3].
    """
    for n in range(cells.size):
        i = cells[n]
        volume_change = volume[n] - known[i]
        known[i] = volume[n]
        # Removed soil lowers a column by at most the height of loose soil; added soil raises it by
        # at least the height of bank soil.
        min_rise = volume_change * (loose if volume_change < 0.0 else bank)
        # An unknown volume (NaN) accounts for the whole rise.
        accounted = min_rise if min_rise > rise[n] else rise[n]
        compacted = accounted - rise[n]
        if compacted < _ROUNDING_TOLERANCE:
            compacted = 0.0
        compaction_depth[i] = max(compaction_depth[i] - abs(accounted), 0.0) + compacted
        max_sinkage[i] = max(max_sinkage[i] - abs(accounted), compaction_depth[i])
