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

from soil_sim.columns.state import Columns
from soil_sim.slope_failure.redistribute import redistribute
from soil_sim.slope_failure.relax_pairs import (
    PairDirections,
    pair_directions,
    relax_pass,
    retained_pairs,
)
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.window import WindowBounds
from soil_sim.slope_failure.window_surface import WindowSurface, copy_surface

__all__ = ["WindowRelaxation"]

_MARGIN_CELLS = 6
"""Margin around the disturbed columns that is relaxed, too, beyond the reach [cells]."""

_PAIRS_PER_VISIT = 100
"""Pairs relaxed in the time of a cell visit."""

_MAX_PASSES = 12
"""Passes after which the window is adapted to the spread of the failure."""

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
        self._directions, self._all_directions = (
            pair_directions(
                params.offsets, columns.grid.cell, params.tolerance, is_uniform=is_uniform
            )
            for is_uniform in (True, False)
        )
        self._margin = _MARGIN_CELLS + params.reach
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

    def relax(
        self,
        bounds: WindowBounds,
        pending: NDArray[np.int64],
        occupied: NDArray[np.uint8],
        budget: int,
    ) -> int:
        """Relax a window, from where the last call ended, until it is at rest or a budget is spent.

        Once it is at rest, `pop_touched` has the columns to relax one by one.

        Args:
            bounds: window of `bounds_including`.
            pending: flat indices of columns to relax one by one afterwards: only that detects a
                drop beyond a neighbour that is stable.
            occupied: marks of `columns.occupancy`, shape (rows, cols).
            budget: number of cell visits; one pass is made at least.

        Returns:
            The cost in cell visits.
        """
        surface = copy_surface(self._columns, self._params, occupied, bounds)
        heights = surface.heights.copy()
        pass_cost = self._pass_cost(surface)
        max_passes = max(1, min(budget // pass_cost, _MAX_PASSES))
        if self._active_bounds is None:
            # The first pass shows where anything moves at all, and loosens the soil. Not more at
            # once: the soil swells when the plan is applied, which makes slopes gentler.
            self._num_passes, max_passes = 0, 1
        has_moved = self._run_passes(heights, surface, max_passes)
        corner = (bounds.first_row, bounds.first_col)
        change = surface.changes_of(heights)
        cells = redistribute(self._columns, corner, change, self._params.reach)
        self._touched += [cells, pending]
        # Columns that have not moved are at rest, except around those that have.
        is_running = has_moved and cells.size > 0
        self._active_bounds = self._bounds_with_margin(cells) if is_running else None
        return max_passes * pass_cost

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

    def _directions_of(self, surface: WindowSurface) -> PairDirections:
        """Return the directions in which pairs of a window are relaxed."""
        return self._directions if surface.is_uniform else self._all_directions

    def _pass_cost(self, surface: WindowSurface) -> int:
        """Return the cost of a pass [cell visits]."""
        num_pairs = surface.heights.size * len(self._directions_of(surface).offsets)
        return max(1, num_pairs // _PAIRS_PER_VISIT)

    def _run_passes(
        self, heights: NDArray[np.float32], surface: WindowSurface, max_passes: int
    ) -> bool:
        """Run passes until nothing moves; return whether the last one moved anything."""
        directions = self._directions_of(surface)
        retained = retained_pairs(surface.is_wall, directions)
        has_moved = True
        done = 0
        while has_moved and done < max_passes:
            ramp = min(self._num_passes / _RAMP_PASSES, 1.0)
            fraction = _INITIAL_FRACTION + (_FINAL_FRACTION - _INITIAL_FRACTION) * ramp
            backward = self._num_passes % 2 == 1
            has_moved = bool(
                relax_pass(
                    heights,
                    surface.floor,
                    surface.tangents,
                    directions,
                    retained,
                    np.float32(fraction),
                    backward,
                )
            )
            self._num_passes += 1
            done += 1
        self.total_passes += done
        return has_moved

    def _bounds_with_margin(self, cells: NDArray[np.int64]) -> WindowBounds:
        """Return the window with some columns (flat indices) and the margin around them."""
        grid = self._columns.grid
        bounds = WindowBounds.enclosing(cells, grid.cols)
        return bounds.expanded(self._margin, grid.shape)


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
