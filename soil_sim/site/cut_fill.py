"""Cut and fill: bulk volume between the ground and a design surface.

The difference of each designed column from the design, and the totals, are stored as whole mm^3.
The totals therefore do not depend on whether columns were updated one by one, in any order, or all
recomputed; each column is rounded by at most half a mm^3. The volumes are bulk volumes, as measured
by a survey of both surfaces: loose soil counts with its swell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.kernels import kernel
from soil_sim.errors import SoilError
from soil_sim.site.design import DesignSurface
from soil_sim.terrain.height_map import as_height_array

__all__ = ["DEFAULT_TOLERANCE", "CutFill", "compare_to_design"]

DEFAULT_TOLERANCE = 0.05
"""Default tolerance [m]: maximum difference from the design of a finished cell."""

_CUT, _FILL, _WITHIN, _NUM_TOTALS = 0, 1, 2, 3
"""Slots of the totals: cut and fill [mm^3], number of cells within the tolerance."""

_MAX_TOTAL_MM3 = 2**62
"""Maximum sum over all columns [mm^3], within the range of an int64."""


class CutFill:
    """Cut and fill between the ground and a design; `update` applies changes of the ground.

    Attributes:
        surface: the design.
        tolerance: maximum difference from the design of a finished cell [m].
        designed_cells: number of cells that have a design.
    """

    def __init__(
        self, surface: DesignSurface, elevation: ArrayLike, tolerance: float = DEFAULT_TOLERANCE
    ) -> None:
        """Compare all cells; arguments and errors are those of `compare_to_design`."""
        grid = surface.grid
        if not (np.isfinite(tolerance) and tolerance >= 0.0):
            raise SoilError(f"tolerance is {tolerance!r} m; give a finite height, not negative")
        heights = as_height_array(elevation, "elevations")
        if heights.shape != grid.shape:
            raise SoilError(
                f"the elevation has shape {heights.shape}, the design {grid.shape}; give one for"
                " each cell"
            )
        self.surface = surface
        self.tolerance = tolerance
        self.designed_cells = int(surface.has_design.sum())
        self._difference = np.full(grid.shape, np.nan, dtype=np.float32)
        self._view = self._difference.view()
        self._view.setflags(write=False)
        self._mm3_per_metre = grid.cell_area_mm2 * 1e3
        self._max_column_mm3 = _MAX_TOTAL_MM3 // (grid.rows * grid.cols)
        self._volumes_mm3: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        # Initially every column is exactly at its design height.
        self._totals = np.zeros(_NUM_TOTALS, dtype=np.int64)
        self._totals[_WITHIN] = self.designed_cells
        indices = np.arange(heights.size)
        self._update_cells(indices, heights.reshape(-1))

    @property
    def cut(self) -> float:
        """Bulk volume to remove [m^3]: the sum of max(elevation - design, 0) * cell area."""
        return self.cut_mm3 * 1e-9

    @property
    def fill(self) -> float:
        """Bulk volume to add [m^3]: the sum of max(design - elevation, 0) * cell area."""
        return self.fill_mm3 * 1e-9

    @property
    def remaining(self) -> float:
        """Sum of cut and fill [m^3]; 0 if the ground equals the design."""
        return (self.cut_mm3 + self.fill_mm3) * 1e-9

    @property
    def cut_mm3(self) -> int:
        """`cut` in whole mm^3."""
        return int(self._totals[_CUT])

    @property
    def fill_mm3(self) -> int:
        """`fill` in whole mm^3."""
        return int(self._totals[_FILL])

    @property
    def within_tolerance(self) -> float:
        """Fraction of the designed cells that differ by at most the tolerance, 0..1.

        Volumes are compared: the comparison is exact to half a mm^3 over the area of a cell.
        """
        return int(self._totals[_WITHIN]) / self.designed_cells

    @property
    def difference(self) -> NDArray[np.float32]:
        """Elevation minus design [m], shape (rows, cols), NaN where there is no design.

        A read-only view that `update` changes. Positive values are soil to remove.
        """
        return self._view

    def update(
        self, rows: NDArray[np.integer], cols: NDArray[np.integer], elevation: ArrayLike
    ) -> None:
        """Apply new heights of cells; the result equals that of comparing all cells, bit by bit.

        Args:
            rows, cols: indices of the cells, shape (n,). The last entry of a repeated cell counts.
            elevation: new heights of the cells [m], shape (n,).

        Raises:
            SoilError: the shapes differ, a cell is outside of the map or a height is not finite;
                nothing was changed.
        """
        rows, cols = np.asarray(rows), np.asarray(cols)
        heights = np.asarray(elevation, dtype=np.float64)
        if not (rows.ndim == 1 and rows.shape == cols.shape == heights.shape):
            raise SoilError(
                f"rows, cols and elevation have shapes {rows.shape}, {cols.shape},"
                f" {heights.shape}; give one of each for every cell"
            )
        if rows.size == 0:
            return
        if rows.dtype.kind not in "iu" or cols.dtype.kind not in "iu":
            raise SoilError(
                f"rows and cols are of type {rows.dtype} and {cols.dtype}; give integers"
            )
        grid = self.surface.grid
        if min(rows.min(), cols.min()) < 0 or rows.max() >= grid.rows or cols.max() >= grid.cols:
            raise SoilError(
                f"a cell is outside of the map; give rows 0 to {grid.rows - 1}, cols 0 to"
                f" {grid.cols - 1}"
            )
        self._update_cells(rows.astype(np.int64) * grid.cols + cols.astype(np.int64), heights)

    def _update_cells(self, indices: NDArray[np.int64], heights: NDArray[np.float64]) -> None:
        """Apply new heights of cells, given by flat index, shape (n,)."""
        if not np.isfinite(heights).all():
            raise SoilError(
                f"{int((~np.isfinite(heights)).sum())} elevations are not finite; give the height"
                " of every cell"
            )
        difference = heights - self.surface.heights.reshape(-1)[indices]
        volume = np.rint(difference * self._mm3_per_metre)
        if (np.abs(volume) > self._max_column_mm3).any():  # false for NaN, without a design
            raise SoilError(
                f"a column is {np.nanmax(np.abs(difference)):g} m from the design, too much to sum"
                " over the map; use smaller cells or a smaller map"
            )
        limit = np.int64(min(np.rint(self.tolerance * self._mm3_per_metre), self._max_column_mm3))
        _apply_differences(
            indices,
            difference,
            volume,
            limit,
            self._difference.reshape(-1),
            self._volumes_mm3.reshape(-1),
            self._totals,
        )


def compare_to_design(
    surface: DesignSurface, elevation: ArrayLike, *, tolerance: float = DEFAULT_TOLERANCE
) -> CutFill:
    """Return the cut and fill between the ground and a design.

    Args:
        surface: the design.
        elevation: height of the ground [m], shape (rows, cols), matrix order, finite.
        tolerance: maximum difference from the design of a finished cell [m].

    Raises:
        SoilError: the elevation has another shape than the design or is not finite, the tolerance
            is negative or not finite, or the volumes do not fit into an int64 of mm^3.
    """
    return CutFill(surface, elevation, tolerance)


@kernel
def _apply_differences(  # type: ignore[no-untyped-def]
    indices, difference, volume, limit, all_differences, all_volumes, totals
):
    """Replace differences and volumes of some cells, and update the totals.

    Args:
        indices: flat indices of the cells, shape (n,).
        difference: elevation minus design [m], shape (n,), NaN without a design.
        volume: `difference` times the cell area [mm^3], shape (n,).
        limit: maximum volume of a finished cell [mm^3].
        all_differences, all_volumes: in and out, those of all cells, flat.
        totals: in and out, see `_CUT`, `_FILL` and `_WITHIN`.
    """
    for k in range(len(indices)):
        if np.isnan(difference[k]):
            continue
        i = indices[k]
        old, new = all_volumes[i], np.int64(volume[k])
        totals[_CUT] += max(new, 0) - max(old, 0)
        totals[_FILL] += max(-new, 0) - max(-old, 0)
        totals[_WITHIN] += np.int64(abs(new) <= limit) - np.int64(abs(old) <= limit)
        all_volumes[i] = new
        all_differences[i] = difference[k]
