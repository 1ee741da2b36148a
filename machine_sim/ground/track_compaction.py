"""How far the ground was pressed: what a machine's copy of the terrain remembers of its tracks.

A track is borne by the depth it is below the ground as it was before tracks came. The soil tells
where that ground is now, not why: a column that fell was pressed, dug, or slid away. Its volume
tells them apart, as pressing moves none. What tracks pressed they press no further when they come
again; soil that comes or goes makes the ground forget as much of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import kernel

__all__ = ["TrackCompaction"]

_ROUNDING_TOLERANCE = 1e-4
"""Less than this [m] is what messages round."""


class TrackCompaction:
    """The memory of each column; arrays have shape (rows, cols).

    Attributes:
        volume_mm3: bank volume, float64; NaN where it is not known.
        packed: how far the surface was pressed below where it would be [m].
        sunk: how far a sole was below that, at least `packed` [m]; soles write it.
    """

    def __init__(self, grid: Grid, swell: float) -> None:
        """
        Args:
            grid: where each column stands.
            swell: the largest of the soils.
        """
        self.volume_mm3: NDArray[np.float64] = np.full(grid.shape, np.nan)
        self.compaction_depth: NDArray[np.float64] = np.zeros(grid.shape)
        self.max_sinkage: NDArray[np.float64] = np.zeros(grid.shape)
        self._bank_height_per_mm3 = 1e-3 / grid.cell_area_mm2  # height of a mm^3 [m]
        self._max_loose_height_per_mm3 = self._bank_height_per_mm3 * (
            1.0 + swell
        )  # the most it can have

    def apply_changes(
        self,
        cells: NDArray[np.int64],
        rise: NDArray[np.float64],
        volume_mm3: NDArray[np.float64],
    ) -> None:
        """Follow columns that changed.

        Args:
            cells: their flat indices.
            rise: of their surface [m].
            volume_mm3: bank volume they have now; NaN if not known.
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
    for n in range(cells.size):
        i = cells[n]
        came = volume[n] - known[i]
        known[i] = volume[n]
        # Soil that goes takes at most the room of loose soil with it, and brings at least its own.
        least = came * (loose if came < 0.0 else bank)
        explained = least if least > rise[n] else rise[n]  # what is not known explains nothing
        pressed = explained - rise[n]
        if pressed < _ROUNDING_TOLERANCE:
            pressed = 0.0
        compaction_depth[i] = max(compaction_depth[i] - abs(explained), 0.0) + pressed
        max_sinkage[i] = max(max_sinkage[i] - abs(explained), compaction_depth[i])
