"""Slope relaxation: soil steeper than its angle of repose slides down (reference, section 3.1.2).

Every grid point within a radius r (a Gauss circle) of a column is a neighbour that soil may slide
to. The neighbour with the largest excess of height over `tan(angle) * distance` receives half of
that excess, until no neighbour has any; the columns disturbed by this are relaxed in turn, first
in, first out. The edge of the map is a closed wall. Columns that a tool is in take no part, and
none slides over them (`soil_sim.slope_failure.neighbourhood`): a tool retains the soil ahead of it.

The angle is that of the soil of the higher column at its moisture: of the loose soil on top, and of
the firm soil below it. Firm soil does not slide as long as its face is no higher than its cohesion
supports (`soil_sim.slope_failure.stability`); beyond that a wedge of it fails, becomes loose
(`soil_sim.slope_failure.wedge_failure`), and comes to rest at its angle of repose.

A tall heap that collapses at one point slides in layers thinner than the width of a column: with
half of its height at once it would run out flat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import BoxedTable, box_table
from soil_sim.columns.state import Columns
from soil_sim.slope_failure.cell_queue import (
    create_cell_queue,
    pop_all,
    queue_length,
    queued_cells,
)
from soil_sim.slope_failure.noise import RelaxationNoise
from soil_sim.slope_failure.relax_cells import enqueue_disturbed, relax_cells
from soil_sim.slope_failure.relax_window import WindowRelaxation
from soil_sim.slope_failure.relaxation_parameters import SlopeArrays, relaxation_parameters
from soil_sim.slope_failure.runout import ColumnShares, deposit_with_runout
from soil_sim.slope_failure.slope_excess import max_slope_excess

__all__ = ["SlopeRelaxation"]

_UNLIMITED = 2**62
"""Budget of cell visits that is never spent."""

_VISITS_PER_CALL = 500
"""Cell visits after which the cost of relaxing the window is estimated again."""

_VISITS_PER_CELL = 4
"""Expected cell visits for each column in the queue."""

_MAX_VISITS_PER_CHECK = 2
"""Maximum cell visits for a column that is at rest."""

_MIN_VISITS_FOR_WINDOW = 1000
"""Cell visits below which relaxing a window is not considered."""


class SlopeRelaxation:
    """The columns to relax, and the algorithms that relax them.

    Attributes:
        occupied: marks of `columns.occupancy`, shape (rows, cols), uint8.
        is_enabled: whether `relax` does anything; disabled, all slopes stay as they are.
        uses_windows: whether large failures may be relaxed in windows.
    """

    def __init__(
        self,
        columns: Columns,
        *,
        radius: float = 4.0,
        tolerance: float = 0.002,
        noise: RelaxationNoise | None = None,
        uses_windows: bool = True,
    ) -> None:
        """
        Args:
            columns: terrain to relax.
            radius: radius of the neighbourhood [cells].
            tolerance: excess of height that is not relaxed [cells]; at least that of a few mm^3.
            noise: random variation; None for soil that is the same everywhere.
            uses_windows: whether large failures may be relaxed in windows.
        """
        self._columns = columns
        noise = noise or RelaxationNoise(np.zeros(0), 0.0, 0)
        self._params = relaxation_parameters(columns, radius, tolerance, noise)
        self._queue = create_cell_queue(columns.height.size)
        self.occupied: NDArray[np.uint8] = np.zeros(columns.grid.shape, dtype=np.uint8)
        self._boxed_slopes: BoxedTable = box_table(
            SlopeArrays(columns.arrays, self._params, self.occupied.reshape(-1), self._queue)
        )
        self.is_enabled = True
        self.uses_windows = uses_windows
        self._first_index: NDArray[np.int32] = np.zeros(columns.height.size, dtype=np.int32)
        self._window_relaxation = WindowRelaxation(self._boxed_slopes)
        self._has_jitter = noise.jitter > 0.0
        self._num_visits = 0  # since all was at rest, or since the last window
        self._num_left_by_window = 0  # queued columns that the last window left

    @property
    def num_pending(self) -> int:
        """Number of columns in the queue and in the window of a running relaxation."""
        return queue_length(self._queue) + self._window_relaxation.num_pending

    @property
    def num_window_passes(self) -> int:
        """Number of passes over windows since creation."""
        return self._window_relaxation.total_passes

    def mark_disturbed(
        self, cells: NDArray[np.integer], *, include_neighbours: bool = False
    ) -> None:
        """Enqueue columns (flat indices) that may be too steep.

        Args:
            cells: flat indices of the columns.
            include_neighbours: whether the columns have lost soil, so that those around them may be
                too steep, too.
        """
        self._enqueue(cells, include_neighbours=include_neighbours, is_lowered=include_neighbours)

    def mark_all_disturbed(self) -> None:
        """Enqueue all columns of the map."""
        self.mark_disturbed(np.arange(self._columns.height.size))

    def deposit_with_runout(self, shares: ColumnShares, budget: int | None = None) -> int:
        """Add loose soil to columns and let it run down to where it stays.

        Args:
            shares: soil to add; its volumes are set to 0.
            budget: maximum number of steps; unlimited if None. Columns with soil that could not run
                out within the budget are enqueued.

        Returns:
            The number of steps.
        """
        return int(
            deposit_with_runout(
                self._boxed_slopes,
                shares,
                self._first_index,
                _UNLIMITED if budget is None else budget,
            )
        )

    def relax(self, budget: int | None = None) -> int:
        """Relax slopes until all are at rest or a budget of cell visits is spent.

        Columns are relaxed one by one; where that has cost, or will cost, more than relaxing the
        whole window of the pending columns, the window is relaxed.

        Args:
            budget: maximum number of cell visits; unlimited if None.

        Returns:
            The number of cell visits, or their equivalent for windows.
        """
        remaining = _UNLIMITED if budget is None else budget
        spent = min_remaining = 0
        num_pending = self.num_pending
        while self.is_enabled and remaining > min_remaining and num_pending:
            if self._window_relaxation.is_running or self._is_window_cheaper():
                visits = self._relax_window(remaining)
                # Copying the surface, and applying what the passes changed, takes as long as some
                # passes: a last call for one or two passes would waste time.
                min_remaining = visits if self._window_relaxation.is_running else 0
            else:
                visits = self._relax_cells(min(remaining, _VISITS_PER_CALL))
                self._num_visits += visits
                min_remaining = 0
            spent += visits
            remaining -= visits
            num_pending = self.num_pending
        if not num_pending:
            self._num_visits = self._num_left_by_window = 0
        return spent

    def max_slope_excess(self) -> float:
        """Return the largest excess of the slopes that can fail, as a tangent.

        See `soil_sim.slope_failure.slope_excess`.
        """
        return max_slope_excess(self._columns, self._params, self.occupied)

    def _enqueue(
        self, cells: NDArray[np.integer], *, include_neighbours: bool, is_lowered: bool
    ) -> None:
        if cells.size:
            enqueue_disturbed(
                self._boxed_slopes,
                np.ascontiguousarray(cells, dtype=np.int64),
                include_neighbours,
                is_lowered,
            )

    def _is_window_cheaper(self) -> bool:
        """Return whether cell visits cost as much as a window: about a visit for each column.

        Those in which the columns that the last window left are checked once do not count.
        """
        num_new = max(queue_length(self._queue) - self._num_left_by_window, 0)
        num_checks = _MAX_VISITS_PER_CHECK * self._num_left_by_window
        visits = self._num_visits - num_checks + _VISITS_PER_CELL * num_new
        if not self.uses_windows or self._has_jitter or visits < _MIN_VISITS_FOR_WINDOW:
            return False
        bounds = self._window_relaxation.bounds_including(queued_cells(self._queue))
        return visits > bounds.num_cells

    def _relax_window(self, budget: int) -> int:
        """Relax the window of all pending columns; return the cost in visits."""
        window, pending = self._window_relaxation, pop_all(self._queue)
        bounds = window.bounds_including(pending)
        cost = window.relax(bounds, pending, budget)
        if not window.is_running:
            # The remaining excess is small, and is relaxed column by column.
            self._enqueue(window.pop_touched(), include_neighbours=False, is_lowered=True)
            self._num_visits, self._num_left_by_window = 0, queue_length(self._queue)
        return cost

    def _relax_cells(self, budget: int) -> int:
        """Relax queued columns one by one; return the number of visits."""
        return int(relax_cells(self._boxed_slopes, budget))
