"""A terrain's heights in the grid's matrix order, and the ways to fit them to a site."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError
from soil_sim.terrain.georeference import Georeference

__all__ = ["HEIGHT_LIMIT", "HeightMap", "as_height_array", "validated_elevations"]

HEIGHT_LIMIT = 9000.0
"""Largest height or depth taken for real [m]: Everest is 8849 m, and the usual marks of a missing
value (-9999, -32768, 1e20) lie beyond it, so that an undeclared one cannot become a pit."""

_SNAP_DISTANCE = 1e-9
"""A sample this close to a grid point [cells] is that point: rounding must not blur heights."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights of the ground at the grid points. Each method returns a new map.

    Attributes:
        grid: where each height lies.
        heights: height of the ground [m], shape (rows, cols), float64, read-only, in matrix
            order: row 0 at +x, column 0 at +y.
        georeference: where the map lies, or None where it is map-local ground.

    Raises:
        TerrainError: the shape is not the grid's, or a height is not a finite number within
            `HEIGHT_LIMIT`; the message names the cell.
    """

    grid: Grid
    heights: NDArray[np.float64]
    georeference: Georeference | None = None

    def __post_init__(self) -> None:
        heights = as_height_array(self.heights).copy()
        if heights.shape != self.grid.shape:
            raise TerrainError(
                f"heights have shape {heights.shape}, the grid {self.grid.shape};"
                " give a grid with the rows and columns of the heights"
            )
        bad = np.argwhere(~(np.abs(heights) <= HEIGHT_LIMIT))
        if bad.size:
            row, col = (int(index) for index in bad[0])
            raise TerrainError(
                f"{len(bad)} of {heights.size} heights cannot be ground; the first is"
                f" {float(heights[row, col])} m at row {row}, col {col}; fill such cells or crop"
                f" them away (finite heights within {HEIGHT_LIMIT:g} m are taken)"
            )
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def relief(self) -> float:
        """Highest minus lowest height [m]."""
        return float(self.heights.max() - self.heights.min())

    @property
    def elevations(self) -> NDArray[np.float64]:
        """Heights above the georeference's vertical datum [m], shape (rows, cols)."""
        datum = self.georeference.elevation if self.georeference else 0.0
        return np.asarray(self.heights + datum)

    @property
    def max_slope(self) -> float:
        """Steepest angle [rad] from a grid point to one of its eight neighbours."""
        h, cell = self.heights, self.grid.cell
        rises = (
            np.abs(h[1:, :] - h[:-1, :]).max() / cell,
            np.abs(h[:, 1:] - h[:, :-1]).max() / cell,
            np.abs(h[1:, 1:] - h[:-1, :-1]).max() / (math.sqrt(2.0) * cell),
            np.abs(h[1:, :-1] - h[:-1, 1:]).max() / (math.sqrt(2.0) * cell),
        )
        return math.atan(max(rises))

    def cropped(self, row: int, col: int, rows: int, cols: int) -> HeightMap:
        """The `rows` x `cols` grid points from (row, col) on, their centre the new origin.

        Raises:
            TerrainError: the piece is smaller than 2 x 2 or reaches beyond the map.
        """
        inside = 0 <= row <= row + rows <= self.grid.rows and 0 <= col <= col + cols <= (
            self.grid.cols
        )
        if not inside or rows < 2 or cols < 2:
            raise TerrainError(
                f"a piece of {rows} x {cols} from row {row}, col {col} is not in a map of"
                f" {self.grid.rows} x {self.grid.cols}; give at least 2 x 2 within it"
            )
        east = float(self.grid.x(row + 0.5 * (rows - 1)))
        north = float(self.grid.y(col + 0.5 * (cols - 1)))
        place = self.georeference.translated(east, north) if self.georeference else None
        piece = self.heights[row : row + rows, col : col + cols]
        return HeightMap(Grid(rows, cols, self.grid.cell), piece, place)

    def resampled(self, rows: int, cols: int, cell: float) -> HeightMap:
        """The same ground at `rows` x `cols` points `cell` [m] apart, about the same centre.

        Heights between grid points are bilinear. They are sampled, not averaged: at a coarser
        spacing, detail finer than it is dropped.

        Raises:
            ParameterError: no grid has such rows, columns or spacing.
            TerrainError: a point would lie beyond the outer grid points of this map.
        """
        grid = Grid(rows, cols, cell)
        u = _snap_inside(self.grid.row(grid.x(np.arange(rows))), self.grid.rows)
        v = _snap_inside(self.grid.col(grid.y(np.arange(cols))), self.grid.cols)
        if u is None or v is None:
            have = [(n - 1) * self.grid.cell for n in self.grid.shape]
            want = [(n - 1) * cell for n in grid.shape]
            raise TerrainError(
                f"the points asked for span {want[0]:g} x {want[1]:g} m, those of the map only"
                f" {have[0]:g} x {have[1]:g} m; ask for fewer points or a smaller spacing, or"
                " stretch the ground first by with_cell"
            )
        return HeightMap(grid, _bilinear(self.heights, u, v), self.georeference)

    def with_cell(self, cell: float) -> HeightMap:
        """The same heights `cell` [m] apart: stretched ground, so without georeference.

        Raises:
            ParameterError: no grid has such a spacing.
        """
        return HeightMap(Grid(self.grid.rows, self.grid.cols, cell), self.heights)

    def with_relief(self, relief: float) -> HeightMap:
        """Heights scaled about their mean until highest minus lowest is `relief` [m].

        It is no longer the surveyed ground, so the georeference is dropped.

        Raises:
            TerrainError: `relief` is negative or not finite, or the ground is level.
        """
        if not (math.isfinite(relief) and relief >= 0.0):
            raise TerrainError(f"relief is {relief!r} m; give a finite range, not negative")
        if self.relief == 0.0:
            raise TerrainError("level ground has no relief to scale; make rough ground instead")
        return self._scaled(relief / self.relief)

    def with_slope_limit(self, angle: float) -> HeightMap:
        """Heights scaled about their mean until no neighbour is steeper than `angle` [rad].

        Ground that is gentler already is returned as it is, georeference and all; scaled ground
        has none. Neighbours are the eight around a grid point.

        Raises:
            TerrainError: `angle` is not between 0 and pi/2.
        """
        if not 0.0 < angle < 0.5 * math.pi:
            raise TerrainError(f"angle is {angle!r} rad; give one between 0 and pi/2")
        steepest = self.max_slope
        if steepest <= angle:
            return self
        # A hair less than the exact factor, so that rounding cannot exceed the limit.
        return self._scaled((1.0 - 1e-9) * math.tan(angle) / math.tan(steepest))

    def with_datum_raised(self, by: float) -> HeightMap:
        """The same ground with z = 0 moved up `by` [m]; elevations stay what they are.

        Site ground near z = 0 keeps more digits in the exchange's 32-bit coordinates.

        Raises:
            TerrainError: the heights would leave `HEIGHT_LIMIT`.
        """
        place = self.georeference.translated(0.0, 0.0, up=by) if self.georeference else None
        return HeightMap(self.grid, self.heights - by, place)

    def _scaled(self, factor: float) -> HeightMap:
        mean = self.heights.mean()
        return HeightMap(self.grid, mean + factor * (self.heights - mean))


def validated_elevations(height_map: HeightMap) -> NDArray[np.float64]:
    """Elevations [m], shape (rows, cols), that a reader will not take for missing.

    Raises:
        TerrainError: an elevation beyond `HEIGHT_LIMIT`.
    """
    elevations = height_map.elevations
    largest = float(np.abs(elevations).max())
    if largest > HEIGHT_LIMIT:
        raise TerrainError(
            f"elevations reach {largest:g} m, beyond the {HEIGHT_LIMIT:g} m that are read back;"
            " correct the elevation of the georeference, or save heights as .npz"
        )
    return elevations


def as_height_array(values: ArrayLike, what: str = "heights") -> NDArray[np.float64]:
    """`values` as float64 heights, shape (rows, cols); their range is not looked at.

    Args:
        values: rows of numbers.
        what: the values' name in errors.

    Raises:
        TerrainError: not real numbers, not two-dimensional, or smaller than 2 x 2.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise TerrainError(f"{what} are not rectangular; give as many in every row") from error
    if array.dtype.kind not in "iuf":
        raise TerrainError(f"{what} are of type {array.dtype}; give integers or real numbers")
    if array.ndim != 2 or min(array.shape) < 2:
        raise TerrainError(
            f"{what} have shape {array.shape}; give two dimensions of at least 2 cells each"
        )
    return array.astype(np.float64, copy=False)


def _snap_inside(index: NDArray[np.float64], count: int) -> NDArray[np.float64] | None:
    """Fractional indices, those on a grid point made exact; None if one is not in 0..count-1."""
    nearest = np.rint(index)
    index = np.where(np.abs(index - nearest) <= _SNAP_DISTANCE * count, nearest, index)
    return index if index.min() >= 0.0 and index.max() <= count - 1 else None


def _bilinear(
    heights: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights at fractional rows `u` and columns `v`, shape (len(u), len(v))."""
    i = np.minimum(u.astype(np.intp), heights.shape[0] - 2)
    j = np.minimum(v.astype(np.intp), heights.shape[1] - 2)
    s, t = (u - i)[:, None], (v - j)[None, :]
    along_x = heights[i] * (1.0 - s) + heights[i + 1] * s
    return np.asarray(along_x[:, j] * (1.0 - t) + along_x[:, j + 1] * t)
