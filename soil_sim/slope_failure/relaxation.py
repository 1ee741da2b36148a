"""Slip: soil steeper than its angle of repose moves down (reference, section 3.1.2).

Every grid point within radius r (a Gauss circle) of a column is a neighbour it may slip to. The
neighbour with the largest excess of height over `tan(angle) * distance` receives half of that
excess, until no neighbour has any; columns disturbed by this are examined in turn, first in,
first out. The map's edge is a closed wall. Columns a tool stands in are held and take no part.

The angle is that of the higher column's soil, at its moisture: of the loose soil on top, and of the
firm soil under it. Firm soil does not slip as long as the face it stands on is no higher than its
cohesion carries (`soil_sim.slope_failure.stability`); beyond that it fails, is loose, and lies at its angle of
repose.

A tall heap that comes down at one point is let down a layer at a time, thinner than a column is
wide; halved at once it would run out flat.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns.state import Columns
from soil_sim.slope_failure.relax_cells import mark_disturbed, relax_cells
from soil_sim.slope_failure.relax_window import WindowRelaxation
from soil_sim.slope_failure.relaxation_parameters import CellQueue, RelaxationParameters
from soil_sim.slope_failure.runout import deposit_with_runout
from soil_sim.slope_failure.stability import stability_limits, unstable_columns

__all__ = ["RelaxationNoise", "SlopeRelaxation", "gauss_circle_offsets"]

_MIN_EXCESS_MM3 = 4
"""On a column: what is less cannot be shared."""

_VISITS_PER_CALL = 500
"""Looks after which it is asked again whether sweeping is less work."""

_VISITS_PER_CELL = 4
"""Looks to expect for each column that waits."""

_MIN_VISITS_FOR_WINDOW = 1000
"""Looks below which it is not worth asking."""

_PAIRS_PER_VISIT = 100
"""Pairs relaxed in the time of a look around a column."""

_MAX_PASSES_PER_CALL = 12
"""Sweeps between looks at how far a collapse has spread."""


def gauss_circle_offsets(radius: float) -> NDArray[np.int64]:
    """Offsets (row, col) of the lattice points within `radius` cells, the centre left out.

    Shape (n, 2), ordered by distance, then by direction. n is 4, 8, 12, 20, 24, 28, 36, 44, 48 for
    r = 1, sqrt 2, 2, sqrt 5, 2 sqrt 2, 3, sqrt 10, sqrt 13, 4 (the reference's Table 1 prints 42
    and 46 for the last two; counting the lattice gives 44 and 48).
    """
    reach = int(math.floor(radius + 1e-9))
    points = [
        (di, dj)
        for di in range(-reach, reach + 1)
        for dj in range(-reach, reach + 1)
        if 0 < di * di + dj * dj <= radius * radius + 1e-9
    ]
    points.sort(key=lambda p: (p[0] ** 2 + p[1] ** 2, math.atan2(p[1], p[0])))
    return np.array(points, dtype=np.int64)


class RelaxationNoise(NamedTuple):
    """Unevenness of nature in how soil slips.

    Attributes:
        steeper: tangent of each column's angle of repose, over that of its soil, flat; empty: 1.
        shape: how much chance there is in where soil comes to lie, 0 to 1: it does not always take
            the steepest way, and may roll on from where it could stay.
        seed: of that.
    """

    repose_tan_scale: NDArray[np.float64]
    jitter: float
    seed: int

    @property
    def is_active(self) -> bool:
        """Whether there is any."""
        return bool(self.repose_tan_scale.size) or self.jitter > 0.0


class SlopeRelaxation:
    """The columns waiting to be examined, and the rule by which they slip.

    Attributes:
        held: columns that neither give nor take soil, shape (rows, cols), uint8.
    """

    def __init__(
        self,
        columns: Columns,
        *,
        radius: float = 4.0,
        tolerance: float = 0.002,
        noise: RelaxationNoise | None = None,
    ) -> None:
        """
        Args:
            columns: the terrain this acts on.
            radius: of the neighbourhood [cells].
            tolerance: excess left standing, as a height in parts of a cell; at least that of a few
                mm^3 on a column.
            noise: unevenness of nature; None for soil that is the same everywhere.
        """
        self._columns = columns
        noise = noise or RelaxationNoise(np.zeros(0), 0.0, 0)
        offsets = gauss_circle_offsets(radius)
        # Finer than a few mm^3 on a column nothing can be levelled.
        finest = _MIN_EXCESS_MM3 * columns.metres_per_mm3
        repose_tan = columns.tables.repose_tan
        self._params = RelaxationParameters(
            columns.grid.rows,
            columns.grid.cols,
            offsets,
            np.hypot(offsets[:, 0], offsets[:, 1]) * columns.grid.cell,
            int(np.abs(offsets).max()),
            max(tolerance * columns.grid.cell, finest),
            repose_tan,
            stability_limits(
                columns.tables,
                offsets,
                columns.grid.shape,
                columns.grid.cell,
                float(columns.height.max()) - columns.floor,
            ),
            noise.repose_tan_scale,
            float(
                repose_tan.min()
                * (noise.repose_tan_scale.min() if noise.repose_tan_scale.size else 1.0)
            ),
            noise.jitter,
            np.array([noise.seed * 2 + 1], dtype=np.uint64),
        )
        size = columns.grid.rows * columns.grid.cols
        self._cell_queue = CellQueue(
            np.zeros(size + 1, dtype=np.int64),
            np.zeros(size, dtype=np.uint8),
            np.zeros(2, dtype=np.int64),
        )
        self.occupied: NDArray[np.uint8] = np.zeros(columns.grid.shape, dtype=np.uint8)
        self._first_index: NDArray[np.int32] = np.zeros(size, dtype=np.int32)
        self._window_relaxation = WindowRelaxation(columns, self._params)
        self._has_noise = noise.is_active
        self._num_visits = 0  # since all was at rest or a collapse was
        self._num_left_by_window = 0  # columns that the last collapse left to be examined

    @property
    def num_pending(self) -> int:
        """Columns still to be examined or swept."""
        return self._queue_length + self._window_relaxation.num_pending

    @property
    def _queue_length(self) -> int:
        first, end = self._cell_queue.head_tail.tolist()
        return int((end - first) % self._cell_queue.buffer.size)

    def mark_disturbed(
        self, cells: NDArray[np.integer], *, include_neighbours: bool = False
    ) -> None:
        """Note columns (flat indices) that may be too steep; with `around`, that lost soil.

        A column that lost soil gives cause to its neighbours, not to itself.
        """
        self._enqueue(cells, include_neighbours, lowered=include_neighbours)

    def _enqueue(
        self, cells: NDArray[np.integer], include_neighbours: bool, *, lowered: bool
    ) -> None:
        if cells.size:
            which = np.asarray(cells, dtype=np.int64)
            mark_disturbed(
                self._columns.arrays,
                which,
                include_neighbours,
                lowered,
                self._params,
                self._cell_queue,
            )

    def deposit_with_runout(
        self,
        cells: NDArray[np.int64],
        volume_mm3: NDArray[np.int64],
        soil: NDArray[np.uint8],
        moisture: NDArray[np.uint8],
        budget: int | None = None,
    ) -> int:
        """Put loose soil onto columns and let it run down to where it stays.

        Args:
            cells: flat indices, shape (n,); some may come more than once.
            volume_mm3: bank volume that comes to each of them, shape (n,); used up.
            soil: ids of its kind, shape (n,).
            moisture: of it [%], shape (n,).
            budget: of steps down; without, all that it takes. What is left waits for `relax`.

        Returns:
            The number of steps.
        """
        left = 2**62 if budget is None else budget
        what = (cells, volume_mm3, soil, moisture, self._first_index, left)
        occupied, columns = self.occupied.reshape(-1), self._columns.arrays
        return int(deposit_with_runout(columns, self._params, occupied, self._cell_queue, *what))

    def mark_all_disturbed(self) -> None:
        """Examine the whole map."""
        self.mark_disturbed(np.arange(self._columns.height.size))

    def relax(self, budget: int | None = None) -> int:
        """Let soil slip until all is at rest or `budget` looks around a column were had.

        A little soil is seen to column by column; where that has been more work than to sweep the
        whole of where soil still waits (`soil_sim.slope_failure.relax_window`), or will be, that is done.

        Returns:
            The number of looks around a column, sweeps counted as the work they are.
        """
        left = 2**62 if budget is None else budget
        spent = 0
        while left > 0 and self.num_pending:
            work = 0
            if self._window_relaxation.is_running or self._is_window_cheaper():
                work = self._relax_window(left)
            if work == 0:
                work = self._relax_cells(min(left, _VISITS_PER_CALL))
                self._num_visits += work
            spent += work
            left -= work
        if not self.num_pending:
            self._num_visits = self._num_left_by_window = 0
        return spent

    def _is_window_cheaper(self) -> bool:
        """Whether examining costs as much as it would to sweep, about a look for each column."""
        new = max(self._queue_length - self._num_left_by_window, 0)
        looks = self._num_visits + _VISITS_PER_CELL * new
        if looks < _MIN_VISITS_FOR_WINDOW:
            return False
        bounds = self._window_relaxation.bounds_including(self._pending_cells())
        return looks > (bounds[1] - bounds[0]) * (bounds[3] - bounds[2])

    def _relax_window(self, budget: int) -> int:
        """Sweep where columns wait; returns the work done, 0 if it cannot be done so."""
        collapse, waiting = self._window_relaxation, self._pending_cells()
        bounds = collapse.bounds_including(waiting)
        if self._has_noise or not collapse.is_supported(bounds):
            if collapse.is_running:
                self._enqueue(collapse.pop_touched(), include_neighbours=False, lowered=True)
            self._num_visits = 0  # not to be asked again at once
            return 0
        cost = max(
            1,
            (bounds[1] - bounds[0])
            * (bounds[3] - bounds[2])
            * collapse.num_directions
            // _PAIRS_PER_VISIT,
        )
        # The first sweep shows where anything moves at all.
        sweeps = max(1, min(budget // cost, _MAX_PASSES_PER_CALL)) if collapse.is_running else 1
        self._cell_queue.is_queued[waiting] = 0
        self._cell_queue.head_tail[:] = 0
        if collapse.relax(bounds, waiting, self.occupied, sweeps):
            # What is left too steep is little, and is seen to column by column.
            self._enqueue(collapse.pop_touched(), include_neighbours=False, lowered=True)
            self._num_visits, self._num_left_by_window = 0, self._queue_length
        return sweeps * cost

    def _pending_cells(self) -> NDArray[np.int64]:
        first, end = self._cell_queue.head_tail.tolist()
        buffer = self._cell_queue.buffer
        if first <= end:
            return buffer[first:end].copy()
        return np.concatenate([buffer[first:], buffer[:end]])

    def _relax_cells(self, budget: int) -> int:
        occupied = self.occupied.reshape(-1)
        return int(
            relax_cells(self._columns.arrays, self._params, occupied, self._cell_queue, budget)
        )

    def max_slope_excess(self) -> float:
        """Largest excess of any slope that can slip, as a tangent, held columns left out.

        Over tan(angle) of the soil on top, where that is loose; over that of the firm soil, where
        that is higher than it stands. Neighbours farther than the map is wide do not exist; -inf if
        no two columns are free.
        """
        worst = -math.inf
        columns, occupied = self._columns, self.occupied.astype(bool)
        rows, cols = columns.height.shape
        tables = columns.tables
        repose_tan = tables.repose_tan[columns.top_soil, columns.top_moisture]
        firm_slope = tables.repose_tan[columns.soil, columns.moisture]
        fails = unstable_columns(columns.arrays, self._params, self.occupied.reshape(-1))
        fails = fails.reshape(rows, cols)
        if self._params.repose_tan_scale.size:
            repose_tan = repose_tan * self._params.repose_tan_scale.reshape(repose_tan.shape)
            firm_slope = firm_slope * self._params.repose_tan_scale.reshape(repose_tan.shape)
        base = columns.floor + columns.firm * columns.metres_per_mm3
        for (di, dj), distance in zip(self._params.offsets, self._params.distance, strict=True):
            if abs(di) >= rows or abs(dj) >= cols:
                continue
            a = (slice(max(0, -di), rows - max(0, di)), slice(max(0, -dj), cols - max(0, dj)))
            b = (slice(max(0, di), rows - max(0, -di)), slice(max(0, dj), cols - max(0, -dj)))
            free = ~(occupied[a] | occupied[b])
            if free.any():
                over = columns.height[a] - columns.height[b] - repose_tan[a] * distance
                # Of a slope that is too steep only the loose soil on it can slip, or firm soil
                # that stands higher than it can.
                face = base[a] - columns.height[b] - firm_slope[a] * distance
                firm = np.where(fails[a], face, -math.inf)
                lies = np.where(
                    columns.loose[a] > 0, np.minimum(over, columns.loose_depth[a]), firm
                )
                excess = np.maximum(lies, firm)[free].max()
                worst = max(worst, excess / distance)
        return worst
