"""Relaxation of large failures: all columns of a window at once, in passes over it.

Relaxing one column after the other is best for a small volume of soil, and slow where a wall
collapses: each column is visited again and again. Here, all pairs of columns of a window are
relaxed, direction by direction (`soil_sim.slope_failure.relax_pairs`), until nothing moves.

The passes work on a copy of the heights in float32 and only plan which columns lose and gain
height. The plan is then applied in whole mm^3 (`soil_sim.slope_failure.redistribute`), so that the
volume stays exact. Slopes that remain too steep because of swell and rounding are relaxed column by
column afterwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel
from soil_sim.columns.occupancy import FREE
from soil_sim.columns.state import Columns
from soil_sim.slope_failure.redistribute import redistribute
from soil_sim.slope_failure.relax_pairs import pair_directions, relax_pass, retained_pairs
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.window import WindowBounds

__all__ = ["WindowRelaxation"]

_MARGIN_CELLS = 6
"""Margin around the disturbed columns that is relaxed, too, beyond the reach [cells]."""

_WALL_HEIGHT = np.float32(1e6)
"""Height of columns that neither give nor receive soil [m]."""

_INITIAL_FRACTION, _FINAL_FRACTION, _RAMP_PASSES = 0.5, 0.9, 8
"""Fraction of an excess that a column gives: first, later, and the number of passes between. A
larger fraction is faster, but a tall heap would spread too far at first."""


class WindowRelaxation:
    """Relaxes a window over several calls, and keeps the columns that it touched.

    Attributes:
        total_passes: number of passes since creation.
    """

    def __init__(self, columns: Columns, params: RelaxationParameters) -> None:
        """
        Args:
            columns: terrain to relax.
            params: angles of repose, neighbourhood and tolerance.
        """
        self._columns, self._params = columns, params
        self._directions = pair_directions(params.offsets, columns.grid.cell, params.tolerance)
        self._active_bounds: WindowBounds | None = None
        self._num_passes = 0  # of the current relaxation
        self._touched: list[NDArray[np.int64]] = []
        self.total_passes = 0

    @property
    def is_running(self) -> bool:
        """Whether a relaxation has begun and its window has not come to rest."""
        return self._active_bounds is not None

    @property
    def num_pending(self) -> int:
        """Number of columns in the window of a running relaxation."""
        return 0 if self._active_bounds is None else self._active_bounds.num_cells

    @property
    def num_directions(self) -> int:
        """Number of directions in which pairs are relaxed in a pass."""
        return int(self._directions.offsets.shape[0])

    def bounds_including(self, cells: NDArray[np.int64]) -> WindowBounds:
        """Return a window with disturbed columns, a margin, and the window of a running relaxation.

        Args:
            cells: flat indices of the columns; at least one unless a relaxation is running.
        """
        if cells.size == 0:
            assert self._active_bounds is not None, "there are columns to relax"
            return self._active_bounds
        bounds = self._bounds_with_margin(cells)
        return bounds if self._active_bounds is None else bounds.union(self._active_bounds)

    def is_supported(self, bounds: WindowBounds) -> bool:
        """Return whether a window has one kind of soil with one angle of repose, as passes need."""
        columns = self._columns
        return bool(
            _is_uniform(columns.arrays, columns.tables.repose_tan, columns.grid.cols, bounds)
        )

    def relax(
        self,
        bounds: WindowBounds,
        pending: NDArray[np.int64],
        occupied: NDArray[np.uint8],
        max_passes: int,
    ) -> bool:
        """Relax a window in at most `max_passes` passes, from where the last call ended.

        Args:
            bounds: window of `bounds_including`.
            pending: flat indices of columns to relax one by one afterwards: only that detects a
                drop beyond a neighbour that is stable.
            occupied: marks of `columns.occupancy`, shape (rows, cols).
            max_passes: number of passes.

        Returns:
            Whether the window is at rest; then `pop_touched` has the columns to relax one by one.
        """
        if self._active_bounds is None:
            self._num_passes = 0
        initial, floor = self._copy_heights(bounds, occupied)
        is_tall = initial.shape[0] > initial.shape[1]
        if is_tall:  # long rows are faster, and the directions are symmetric
            initial, floor = np.ascontiguousarray(initial.T), np.ascontiguousarray(floor.T)
        heights = initial.copy()
        has_moved = self._run_passes(heights, floor, bounds, max_passes)
        change = (heights - initial).astype(np.float64)
        change = np.ascontiguousarray(change.T) if is_tall else change
        corner = (bounds.first_row, bounds.first_col)
        cells = redistribute(self._columns, corner, change, self._params.reach)
        self._touched += [cells, pending]
        # Columns that have not moved are at rest, except around those that have.
        is_running = has_moved and cells.size > 0
        self._active_bounds = self._bounds_with_margin(cells) if is_running else None
        return not is_running

    def pop_touched(self) -> NDArray[np.int64]:
        """Return the columns to relax one by one: near those pending, or that lost or gained.

        A running relaxation is ended, and all columns of its window are returned, too.

        Returns:
            Flat indices, sorted.
        """
        cols = self._columns.grid.cols
        parts = self._touched.copy()
        if self._active_bounds is not None:
            parts.append(self._active_bounds.cells(cols))
        self._touched.clear()
        self._active_bounds = None
        cells = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
        if cells.size == 0:
            return cells
        bounds = self._bounds_with_margin(cells)
        i, j = np.divmod(cells, cols)
        is_far = np.ones(bounds.shape, dtype=np.uint8)
        is_far[i - bounds.first_row, j - bounds.first_col] = 0
        near_rows, near_cols = np.nonzero(_window_min(is_far, self._params.reach) == 0)
        return (near_rows + bounds.first_row) * cols + near_cols + bounds.first_col

    def _run_passes(
        self,
        heights: NDArray[np.float32],
        floor: NDArray[np.float32],
        bounds: WindowBounds,
        max_passes: int,
    ) -> bool:
        """Run passes until nothing moves; return whether the last one moved anything."""
        columns = self._columns
        corner = bounds.first_row, bounds.first_col  # all columns are of the same soil
        repose_tan = columns.tables.repose_tan[
            columns.top_soil[corner], columns.top_moisture[corner]
        ]
        limits = (repose_tan * self._directions.distance).astype(np.float32)
        retained = retained_pairs(heights >= _WALL_HEIGHT, self._directions)
        has_moved = True
        done = 0
        while has_moved and done < max_passes:
            ramp = min(self._num_passes / _RAMP_PASSES, 1.0)
            fraction = _INITIAL_FRACTION + (_FINAL_FRACTION - _INITIAL_FRACTION) * ramp
            backward = self._num_passes % 2 == 1
            has_moved = bool(
                relax_pass(
                    heights,
                    floor,
                    self._directions,
                    retained,
                    limits,
                    np.float32(fraction),
                    backward,
                )
            )
            self._num_passes += 1
            done += 1
        self.total_passes += done
        return has_moved

    def _copy_heights(
        self, bounds: WindowBounds, occupied: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the heights of a window above its lowest point, and the stable firm soil [m]."""
        columns, window = self._columns, bounds.slices
        lowest = float(columns.height[window].min())
        heights = (columns.height[window] - lowest).astype(np.float32)
        floor = np.empty_like(heights)
        _stable_floor(columns.arrays, self._params, bounds, lowest, floor)
        # An occupied column is a wall: too high to receive soil, and without soil to give.
        is_wall = occupied[window] != FREE
        heights[is_wall] = floor[is_wall] = _WALL_HEIGHT
        return heights, floor

    def _bounds_with_margin(self, cells: NDArray[np.int64]) -> WindowBounds:
        """Return the window with some columns (flat indices) and the margin around them."""
        grid = self._columns.grid
        bounds = WindowBounds.enclosing(cells, grid.cols)
        return bounds.expanded(_MARGIN_CELLS + self._params.reach, grid.shape)


def _window_min(values: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Return the smallest value within `reach` rows and columns of each column."""
    smallest = values.copy()
    for axis in (0, 1):
        source = smallest.copy()
        for step in range(1, reach + 1):
            if step >= values.shape[axis]:
                break
            low, high = [slice(None)] * 2, [slice(None)] * 2
            low[axis], high[axis] = slice(None, -step), slice(step, None)
            a, b = tuple(low), tuple(high)
            smallest[a] = np.minimum(smallest[a], source[b])
            smallest[b] = np.minimum(smallest[b], source[a])
    return smallest


@kernel
def _stable_floor(columns, params, bounds, lowest, floor):  # type: ignore[no-untyped-def]
    """Write the height above `lowest` [m] of the firm soil of a window that is stable to `floor`.

    Of soil with cohesion all, after `fail_wedges`. All columns are of one kind of soil.
    """
    limit = params.stability.neighbour_height
    for r in range(floor.shape[0]):
        for c in range(floor.shape[1]):
            i = (bounds.first_row + r) * params.cols + bounds.first_col + c
            height = columns.floor
            if limit[columns.soil[i], columns.moisture[i], 0] > 0.0:
                height += columns.firm[i] * columns.metres_per_mm3
            floor[r, c] = height - lowest


@kernel
def _is_uniform(columns, repose_tan, cols, bounds):  # type: ignore[no-untyped-def]
    """Return whether all soil of a window is of one kind and has one angle of repose."""
    first = bounds.first_row * cols + bounds.first_col
    kind = columns.soil[first]
    tangent = repose_tan[kind, columns.moisture[first]]
    for r in range(bounds.first_row, bounds.end_row):
        for i in range(r * cols + bounds.first_col, r * cols + bounds.end_col):
            if columns.soil[i] != kind or repose_tan[kind, columns.moisture[i]] != tangent:
                return False
            if columns.loose[i] > 0 and (
                columns.loose_soil[i] != kind
                or repose_tan[kind, columns.loose_moisture[i]] != tangent
            ):
                return False
    return True
