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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel, helper
from soil_sim.slope_failure.redistribute import redistribute
from soil_sim.slope_failure.relax_pairs import PairDirections, pair_directions, relax_passes
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.retained_pairs import retained_pairs
from soil_sim.slope_failure.wedge_failure import fail_wedges
from soil_sim.slope_failure.window import WindowBounds
from soil_sim.slope_failure.window_surface import copy_surface

__all__ = ["WindowRelaxation"]

_MARGIN_CELLS = 6
"""Margin around the disturbed columns that is relaxed, too, beyond the reach [cells]."""

_PAIRS_PER_VISIT = 100
"""Pairs relaxed in the time of a cell visit."""

_MAX_PASSES = 12
"""Passes after which the window is adapted to the spread of the failure."""


class _WindowDirections(NamedTuple):
    """Directions of the pairs of a pass over a window.

    Attributes:
        uniform: for windows with one angle of repose.
        varying: for all others.
    """

    uniform: PairDirections
    varying: PairDirections


class WindowRelaxation:
    """Relaxes a window over several calls, and keeps the columns that it touched.

    Attributes:
        total_passes: number of passes since creation.
    """

    def __init__(self, slopes: BoxedTable) -> None:
        """
        Args:
            slopes: `SlopeArrays` of the terrain to relax, boxed.
        """
        params: RelaxationParameters = slopes.source.params
        self._slopes, self._shape, self._reach = slopes, (params.rows, params.cols), params.reach
        self._directions: BoxedTable = box_table(
            _WindowDirections(
                *(
                    pair_directions(
                        params.offsets, params.distance[0], params.tolerance, is_uniform=is_uniform
                    )
                    for is_uniform in (True, False)
                )
            )
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

    def relax(self, bounds: WindowBounds, pending: NDArray[np.int64], budget: int) -> int:
        """Relax a window, from where the last call ended, until it is at rest or a budget is spent.

        Unstable faces fail first. Once the window is at rest, `pop_touched` has the columns to
        relax one by one.

        Args:
            bounds: window of `bounds_including`.
            pending: flat indices of columns to relax one by one afterwards: only that detects a
                drop beyond a neighbour that is stable.
            budget: number of cell visits; one pass is made at least.

        Returns:
            The cost in cell visits.
        """
        max_passes = _MAX_PASSES
        if self._active_bounds is None:
            # The first pass shows where anything moves at all, and loosens the soil. Not more at
            # once: the soil swells when the plan is applied, which makes slopes gentler.
            self._num_passes, max_passes = 0, 1
        cells, has_moved, num_passes, cost = _relax_window(
            self._slopes, self._directions, *bounds, self._num_passes, max_passes, budget
        )
        self._num_passes += num_passes
        self.total_passes += num_passes
        self._touched += [cells, pending]
        # Columns that have not moved are at rest, except around those that have.
        is_running = has_moved and cells.size > 0
        self._active_bounds = self._bounds_with_margin(cells) if is_running else None
        return int(cost)

    def pop_touched(self) -> NDArray[np.int64]:
        """Return the columns to relax one by one: near those pending, or that lost or gained.

        A running relaxation is ended, and all columns of its window are returned, too.

        Returns:
            Flat indices, sorted.
        """
        cols = self._shape[1]
        parts = self._touched.copy()
        if self._active_bounds is not None:
            parts.append(self._active_bounds.cells(cols))
        self._touched.clear()
        self._active_bounds = None
        cells = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
        if cells.size == 0:
            return cells
        bounds = self._bounds_with_margin(cells)
        near: NDArray[np.int64] = _cells_near(cells, cols, *bounds, self._reach)
        return near

    def _bounds_with_margin(self, cells: NDArray[np.int64]) -> WindowBounds:
        """Return the window with some columns (flat indices) and the margin around them."""
        bounds = WindowBounds.enclosing(cells, self._shape[1])
        return bounds.expanded(self._margin, self._shape)


@fixed_signature_kernel
def _relax_window(  # type: ignore[no-untyped-def]
    slopes, boxed_directions, first_row, end_row, first_col, end_col, num_done, max_passes, budget
):
    """Plan the relaxation of a window on a copy of its surface, and apply it.

    Args:
        slopes: `SlopeArrays`, boxed; the columns and the queue are changed.
        boxed_directions: `_WindowDirections`, boxed.
        first_row, end_row, first_col, end_col: see `WindowBounds`.
        num_done: number of passes over the failure in earlier calls.
        max_passes: maximum number of passes.
        budget: number of cell visits; one pass is made at least.

    Returns:
        (flat indices of the columns that lost or gained; whether the last pass moved anything;
        number of passes; cost in cell visits).
    """
    columns, params, occupied, queue = slopes.table
    bounds = WindowBounds(first_row, end_row, first_col, end_col)
    fail_wedges(columns, params, occupied, queue, bounds)
    surface = copy_surface(columns, params, occupied, bounds)
    all_directions = boxed_directions.table
    directions = all_directions.uniform if surface.is_uniform else all_directions.varying
    num_directions = (directions.num_shortest + directions.distance.size) // 2
    num_pairs = surface.heights.shape[0] * surface.num_cols * num_directions
    pass_cost = max(1, num_pairs // _PAIRS_PER_VISIT)
    max_passes = max(1, min(budget // pass_cost, max_passes))
    heights = surface.heights.copy()
    retained = retained_pairs(heights, surface.num_cols, directions)
    has_moved, num_passes = relax_passes(
        heights, surface, directions, retained, num_done, max_passes
    )
    rows, cols, change = _planned_changes(surface, heights)
    cells = (rows + first_row) * params.cols + cols + first_col
    if cells.size > 0:
        shape = (end_row - first_row, end_col - first_col)
        redistribute(columns, cells, rows, cols, change, shape, params.reach)
    return cells, has_moved, num_passes, max_passes * pass_cost


@helper(allocates=True)
def _planned_changes(surface, heights):  # type: ignore[no-untyped-def]
    """Return where heights differ from a surface: (row, column in the window, difference [m])."""
    before, after = surface.heights.reshape(-1), heights.reshape(-1)
    size = 0
    for k in range(after.size):
        size += abs(after[k] - before[k]) > 0.0  # false for walls
    rows, cols, change = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)
    num_rows, num_cols = heights.shape[0], surface.num_cols
    if surface.is_transposed:
        num_rows, num_cols = num_cols, num_rows
    count = 0
    for i in range(num_rows):
        for j in range(num_cols):
            a, b = (j, i) if surface.is_transposed else (i, j)
            difference = heights[a, b] - surface.heights[a, b]
            if abs(difference) > 0.0:
                rows[count], cols[count], change[count] = i, j, difference
                count += 1
    return rows, cols, change


@fixed_signature_kernel
def _cells_near(cells, cols, first_row, end_row, first_col, end_col, reach):  # type: ignore[no-untyped-def]
    """Return the columns of a window within `reach` rows and columns of some of its columns.

    Args:
        cells: flat indices of these; may have duplicates.
        cols: number of columns of the map.
        first_row, end_row, first_col, end_col: see `WindowBounds`.
        reach: distance [cells].

    Returns:
        Flat indices, sorted.
    """
    rows, width = end_row - first_row, end_col - first_col
    marks = np.zeros((rows, width + 2 * reach), np.uint8)
    for i in cells:
        row = i // cols
        marks[row - first_row, i - row * cols - first_col + reach] = 1
    in_row = np.zeros((rows + 2 * reach, width), np.uint8)
    for r in range(rows):
        for step in range(2 * reach + 1):
            for c in range(width):
                in_row[r + reach, c] |= marks[r, c + step]
    near, count = np.empty(rows * width, np.int64), 0
    is_near = np.empty(width, np.uint8)
    for r in range(rows):
        is_near[:] = 0
        for step in range(2 * reach + 1):
            for c in range(width):
                is_near[c] |= in_row[r + step, c]
        for c in range(width):
            near[count] = (first_row + r) * cols + first_col + c
            count += is_near[c]
    return near[:count]
