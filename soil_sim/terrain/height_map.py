"""Heights of a terrain in the matrix order of its grid; cropping, resampling and scaling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.georeference import Georeference

__all__ = ["HEIGHT_LIMIT", "HeightMap", "as_height_array", "validated_elevations"]

HEIGHT_LIMIT = 9000.0
"""Maximum absolute height [m]. Everest is 8849 m; the usual nodata values (-9999, -32768, 1e20) are
beyond the limit, so that an undeclared one is rejected."""

_SNAP_DISTANCE = 1e-9
"""Maximum distance at which a sample is moved to a grid point [cells]; its height is then exact."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights of the ground at the grid points. Each method returns a new map.

    Attributes:
        grid: grid of the heights.
        heights: height of the ground [m], shape (rows, cols), float64, read-only, in matrix
            order: row 0 at +x, column 0 at +y.
        georeference: georeference of the map, or None.

    Raises:
        TerrainError: the shape is not that of the grid, or a height is not a finite number within
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
                " give a grid with the rows and columns of the heights",
                TerrainErrorCode.SHAPE,
            )
        bad = np.argwhere(~(np.abs(heights) <= HEIGHT_LIMIT))
        if bad.size:
            row, col = (int(index) for index in bad[0])
            raise TerrainError(
                f"{len(bad)} of {heights.size} heights are invalid; the first is"
                f" {float(heights[row, col])} m at row {row}, col {col}; fill such cells or crop"
                f" them away (heights must be finite and within {HEIGHT_LIMIT:g} m)",
                TerrainErrorCode.HEIGHT,
            )
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def relief(self) -> float:
        """Highest minus lowest height [m]."""
        return float(self.heights.max() - self.heights.min())

    @property
    def elevations(self) -> NDArray[np.float64]:
        """Heights above the vertical datum of the georeference [m], shape (rows, cols)."""
        datum = self.georeference.elevation if self.georeference else 0.0
        return np.asarray(self.heights + datum)

    @property
    def max_slope(self) -> float:
        """Maximum slope angle [rad] between a grid point and one of its eight neighbours."""
        h, cell = self.heights, self.grid.cell
        rises = (
            np.abs(h[1:, :] - h[:-1, :]).max() / cell,
            np.abs(h[:, 1:] - h[:, :-1]).max() / cell,
            np.abs(h[1:, 1:] - h[:-1, :-1]).max() / (math.sqrt(2.0) * cell),
            np.abs(h[1:, :-1] - h[:-1, 1:]).max() / (math.sqrt(2.0) * cell),
        )
        return math.atan(max(rises))

    def cropped(self, row: int, col: int, rows: int, cols: int) -> HeightMap:
        """Return `rows` x `cols` grid points from (row, col); their centre is the new origin.

        Raises:
            TerrainError: the piece is smaller than 2 x 2 or extends beyond the map.
        """
        is_inside = 0 <= row <= row + rows <= self.grid.rows and 0 <= col <= col + cols <= (
            self.grid.cols
        )
        if not is_inside or rows < 2 or cols < 2:
            raise TerrainError(
                f"a piece of {rows} x {cols} from row {row}, col {col} is not within a map of"
                f" {self.grid.rows} x {self.grid.cols}; give at least 2 x 2 within it",
                TerrainErrorCode.OFF_MAP,
            )
        east = float(self.grid.x(row + 0.5 * (rows - 1)))
        north = float(self.grid.y(col + 0.5 * (cols - 1)))
        place = self.georeference.translated(east, north) if self.georeference else None
        piece = self.heights[row : row + rows, col : col + cols]
        return HeightMap(Grid(rows, cols, self.grid.cell), piece, place)

    def resampled(self, rows: int, cols: int, cell: float) -> HeightMap:
        """Return the terrain at `rows` x `cols` points with spacing `cell` [m] and the same centre.

        Heights between grid points are interpolated bilinearly. They are sampled, not averaged:
        detail finer than the spacing is lost.

        Raises:
            ParameterError: rows, cols or cell are out of range.
            TerrainError: a point is beyond the outer grid points of this map.
        """
        grid = Grid(rows, cols, cell)
        u = _snap_inside(self.grid.row(grid.x(np.arange(rows))), self.grid.rows)
        v = _snap_inside(self.grid.col(grid.y(np.arange(cols))), self.grid.cols)
        if u is None or v is None:
            available = [(n - 1) * self.grid.cell for n in self.grid.shape]
            wanted = [(n - 1) * cell for n in grid.shape]
            raise TerrainError(
                f"the requested points span {wanted[0]:g} x {wanted[1]:g} m, those of the map only"
                f" {available[0]:g} x {available[1]:g} m; request fewer points or a smaller"
                " spacing, or stretch the terrain first with with_cell",
                TerrainErrorCode.OFF_MAP,
            )
        return HeightMap(grid, _bilinear(self.heights, u, v), self.georeference)

    def with_cell(self, cell: float) -> HeightMap:
        """Return the heights with another spacing [m], as stretched terrain without georeference.

        Raises:
            ParameterError: the spacing is out of range.
        """
        return HeightMap(Grid(self.grid.rows, self.grid.cols, cell), self.heights)

    def with_relief(self, relief: float) -> HeightMap:
        """Return the heights scaled about their mean so that highest minus lowest is `relief` [m].

        The result is not the surveyed terrain and has no georeference.

        Raises:
            TerrainError: `relief` is negative or not finite, or the terrain is level.
        """
        if not (math.isfinite(relief) and relief >= 0.0):
            raise TerrainError(
                f"relief is {relief!r} m; give a finite range, not negative",
                TerrainErrorCode.ARGUMENT,
            )
        if self.relief == 0.0:
            raise TerrainError(
                "level terrain has no relief to scale; use rough terrain instead",
                TerrainErrorCode.ARGUMENT,
            )
        return self._scaled(relief / self.relief)

    def with_slope_limit(self, angle: float) -> HeightMap:
        """Return the heights scaled about their mean so that no slope exceeds `angle` [rad].

        Terrain within the limit is returned unchanged; scaled terrain has no georeference. Slopes
        are those to the eight neighbours of a grid point.

        Raises:
            TerrainError: `angle` is not between 0 and pi/2.
        """
        if not 0.0 < angle < 0.5 * math.pi:
            raise TerrainError(
                f"angle is {angle!r} rad; give one between 0 and pi/2", TerrainErrorCode.ARGUMENT
            )
        max_slope = self.max_slope
        if max_slope <= angle:
            return self
        # Slightly less than the exact factor, so that rounding cannot exceed the limit.
        return self._scaled((1.0 - 1e-9) * math.tan(angle) / math.tan(max_slope))

    def with_datum_raised(self, by: float) -> HeightMap:
        """Return the terrain with z = 0 raised by `by` [m]; elevations do not change.

        Heights near z = 0 have more digits in the 32-bit coordinates of messages.

        Raises:
            TerrainError: a height would exceed `HEIGHT_LIMIT`.
        """
        place = self.georeference.translated(0.0, 0.0, up=by) if self.georeference else None
        return HeightMap(self.grid, self.heights - by, place)

    def _scaled(self, factor: float) -> HeightMap:
        mean = self.heights.mean()
        return HeightMap(self.grid, mean + factor * (self.heights - mean))


def validated_elevations(height_map: HeightMap) -> NDArray[np.float64]:
    """Return the elevations [m], shape (rows, cols), of a map whose file can be read again.

    Raises:
        TerrainError: an elevation exceeds `HEIGHT_LIMIT`.
    """
    elevations = height_map.elevations
    highest = float(np.abs(elevations).max())
    if highest > HEIGHT_LIMIT:
        raise TerrainError(
            f"elevations reach {highest:g} m, beyond the limit of {HEIGHT_LIMIT:g} m;"
            " correct the elevation of the georeference, or save heights as .npz",
            TerrainErrorCode.HEIGHT,
        )
    return elevations


def as_height_array(values: ArrayLike, what: str = "heights") -> NDArray[np.float64]:
    """Return values as float64, shape (rows, cols), without a check of their range.

    Args:
        values: rows of numbers.
        what: name of the values in errors.

    Raises:
        TerrainError: the values are not real numbers, not two-dimensional, or smaller than 2 x 2.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise TerrainError(
            f"{what} are not rectangular; give rows of equal length", TerrainErrorCode.SHAPE
        ) from error
    if array.dtype.kind not in "iuf":
        raise TerrainError(
            f"{what} are of type {array.dtype}; give integers or real numbers",
            TerrainErrorCode.UNSUPPORTED,
        )
    if array.ndim != 2 or min(array.shape) < 2:
        raise TerrainError(
            f"{what} have shape {array.shape}; give two dimensions of at least 2 cells each",
            TerrainErrorCode.SHAPE,
        )
    return array.astype(np.float64, copy=False)


def _snap_inside(index: NDArray[np.float64], count: int) -> NDArray[np.float64] | None:
    """Return fractional indices, exact next to grid points; None if one is not in 0..count-1."""
    nearest = np.rint(index)
    index = np.where(np.abs(index - nearest) <= _SNAP_DISTANCE * count, nearest, index)
    return index if index.min() >= 0.0 and index.max() <= count - 1 else None


def _bilinear(
    heights: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return heights at fractional rows `u` and columns `v`, shape (len(u), len(v))."""
    i = np.minimum(u.astype(np.intp), heights.shape[0] - 2)
    j = np.minimum(v.astype(np.intp), heights.shape[1] - 2)
    s, t = (u - i)[:, None], (v - j)[None, :]
    along_x = heights[i] * (1.0 - s) + heights[i + 1] * s
    return np.asarray(along_x[:, j] * (1.0 - t) + along_x[:, j + 1] * t)
