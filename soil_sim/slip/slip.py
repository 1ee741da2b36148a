"""Slip: soil steeper than its angle of repose moves down (reference, section 3.1.2).

Every grid point within radius r (a Gauss circle) of a column is a neighbour it may slip to. The
neighbour with the largest excess of height over `tan(angle) * distance` receives half of that
excess, until no neighbour has any; columns disturbed by this are examined in turn, first in,
first out. The map's edge is a closed wall. Columns a tool stands in are held and take no part.

The angle is that of the higher column's soil, at its moisture: of the loose soil on top, and of the
firm soil under it. Firm soil does not slip as long as the face it stands on is no higher than its
cohesion carries (`soil_sim.slip.face`); beyond that it fails, is loose, and lies at its angle of
repose.

A tall heap that comes down at one point is let down a layer at a time, thinner than a column is
wide; halved at once it would run out flat.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns import Columns
from soil_sim.slip.collapse import Collapse
from soil_sim.slip.examine import disturb, examine
from soil_sim.slip.face import faces_of, which_are_too_high
from soil_sim.slip.pour import pour
from soil_sim.slip.rule import Ring, SlipRule

__all__ = ["Slip", "SlipNoise", "gauss_circle"]

_FEWEST_MM3 = 4
"""On a column: what is less cannot be shared."""

_AT_ONCE = 500
"""Looks after which it is asked again whether sweeping is less work."""

_LOOKS_EACH = 4
"""Looks to expect for each column that waits."""

_LEAST_WORK = 1000
"""Looks below which it is not worth asking."""

_PAIRS_OF_WORK = 100
"""Pairs relaxed in the time of a look around a column."""

_MOST_SWEEPS = 12
"""Sweeps between looks at how far a collapse has spread."""


def gauss_circle(radius: float) -> NDArray[np.int64]:
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


class SlipNoise(NamedTuple):
    """Unevenness of nature in how soil slips.

    Attributes:
        steeper: tangent of each column's angle of repose, over that of its soil, flat; empty: 1.
        shape: how much chance there is in where soil comes to lie, 0 to 1: it does not always take
            the steepest way, and may roll on from where it could stay.
        seed: of that.
    """

    steeper: NDArray[np.float64]
    shape: float
    seed: int

    @property
    def uneven(self) -> bool:
        """Whether there is any."""
        return bool(self.steeper.size) or self.shape > 0.0


class Slip:
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
        noise: SlipNoise | None = None,
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
        noise = noise or SlipNoise(np.zeros(0), 0.0, 0)
        offsets = gauss_circle(radius)
        # Finer than a few mm^3 on a column nothing can be levelled.
        finest = _FEWEST_MM3 * columns.metres_per_mm3
        slope = columns.tables.slope
        self._rule = SlipRule(
            columns.grid.rows,
            columns.grid.cols,
            offsets,
            np.hypot(offsets[:, 0], offsets[:, 1]) * columns.grid.cell,
            int(np.abs(offsets).max()),
            max(tolerance * columns.grid.cell, finest),
            slope,
            faces_of(
                columns.tables,
                offsets,
                columns.grid.shape,
                columns.grid.cell,
                float(columns.height.max()) - columns.floor,
            ),
            noise.steeper,
            float(slope.min() * (noise.steeper.min() if noise.steeper.size else 1.0)),
            noise.shape,
            np.array([noise.seed * 2 + 1], dtype=np.uint64),
        )
        size = columns.grid.rows * columns.grid.cols
        self._ring = Ring(
            np.zeros(size + 1, dtype=np.int64),
            np.zeros(size, dtype=np.uint8),
            np.zeros(2, dtype=np.int64),
        )
        self.held: NDArray[np.uint8] = np.zeros(columns.grid.shape, dtype=np.uint8)
        self._first_of: NDArray[np.int32] = np.zeros(size, dtype=np.int32)
        self._collapse = Collapse(columns, self._rule)
        self._uneven = noise.uneven
        self._looks = 0  # since all was at rest or a collapse was
        self._swept = 0  # columns that the last collapse left to be examined

    @property
    def waiting(self) -> int:
        """Columns still to be examined or swept."""
        return self._queue_length + self._collapse.waiting

    @property
    def _queue_length(self) -> int:
        first, end = self._ring.ends.tolist()
        return int((end - first) % self._ring.queue.size)

    def disturb(self, cells: NDArray[np.integer], *, around: bool = False) -> None:
        """Note columns (flat indices) that may be too steep; with `around`, that lost soil.

        A column that lost soil gives cause to its neighbours, not to itself.
        """
        self._push(cells, around, sunk=around)

    def _push(self, cells: NDArray[np.integer], around: bool, *, sunk: bool) -> None:
        if cells.size:
            which = np.asarray(cells, dtype=np.int64)
            disturb(self._columns.arrays, which, around, sunk, self._rule, self._ring)

    def pour(
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
        what = (cells, volume_mm3, soil, moisture, self._first_of, left)
        held, columns = self.held.reshape(-1), self._columns.arrays
        return int(pour(columns, self._rule, held, self._ring, *what))

    def disturb_all(self) -> None:
        """Examine the whole map."""
        self.disturb(np.arange(self._columns.height.size))

    def relax(self, budget: int | None = None) -> int:
        """Let soil slip until all is at rest or `budget` looks around a column were had.

        A little soil is seen to column by column; where that has been more work than to sweep the
        whole of where soil still waits (`soil_sim.slip.collapse`), or will be, that is done.

        Returns:
            The number of looks around a column, sweeps counted as the work they are.
        """
        left = 2**62 if budget is None else budget
        spent = 0
        while left > 0 and self.waiting:
            work = 0
            if self._collapse.running or self._worth_sweeping():
                work = self._sweep(left)
            if work == 0:
                work = self._examine(min(left, _AT_ONCE))
                self._looks += work
            spent += work
            left -= work
        if not self.waiting:
            self._looks = self._swept = 0
        return spent

    def _worth_sweeping(self) -> bool:
        """Whether examining costs as much as it would to sweep, about a look for each column."""
        new = max(self._queue_length - self._swept, 0)
        looks = self._looks + _LOOKS_EACH * new
        if looks < _LEAST_WORK:
            return False
        box = self._collapse.box_with(self._waiting_cells())
        return looks > (box[1] - box[0]) * (box[3] - box[2])

    def _sweep(self, budget: int) -> int:
        """Sweep where columns wait; returns the work done, 0 if it cannot be done so."""
        collapse, waiting = self._collapse, self._waiting_cells()
        box = collapse.box_with(waiting)
        if self._uneven or not collapse.suits(box):
            if collapse.running:
                self._push(collapse.take_touched(), around=False, sunk=True)
            self._looks = 0  # not to be asked again at once
            return 0
        cost = max(1, (box[1] - box[0]) * (box[3] - box[2]) * collapse.directions // _PAIRS_OF_WORK)
        # The first sweep shows where anything moves at all.
        sweeps = max(1, min(budget // cost, _MOST_SWEEPS)) if collapse.running else 1
        self._ring.queued[waiting] = 0
        self._ring.ends[:] = 0
        if collapse.sweep(box, waiting, self.held, sweeps):
            # What is left too steep is little, and is seen to column by column.
            self._push(collapse.take_touched(), around=False, sunk=True)
            self._looks, self._swept = 0, self._queue_length
        return sweeps * cost

    def _waiting_cells(self) -> NDArray[np.int64]:
        first, end = self._ring.ends.tolist()
        queue = self._ring.queue
        if first <= end:
            return queue[first:end].copy()
        return np.concatenate([queue[first:], queue[:end]])

    def _examine(self, budget: int) -> int:
        held = self.held.reshape(-1)
        return int(examine(self._columns.arrays, self._rule, held, self._ring, budget))

    def steepest_excess(self) -> float:
        """Largest excess of any slope that can slip, as a tangent, held columns left out.

        Over tan(angle) of the soil on top, where that is loose; over that of the firm soil, where
        that is higher than it stands. Neighbours farther than the map is wide do not exist; -inf if
        no two columns are free.
        """
        worst = -math.inf
        columns, held = self._columns, self.held.astype(bool)
        rows, cols = columns.height.shape
        tables = columns.tables
        slope = tables.slope[columns.top_soil, columns.top_moisture]
        firm_slope = tables.slope[columns.soil, columns.moisture]
        fails = which_are_too_high(columns.arrays, self._rule, self.held.reshape(-1))
        fails = fails.reshape(rows, cols)
        if self._rule.steeper.size:
            slope = slope * self._rule.steeper.reshape(slope.shape)
            firm_slope = firm_slope * self._rule.steeper.reshape(slope.shape)
        base = columns.floor + columns.firm * columns.metres_per_mm3
        for (di, dj), distance in zip(self._rule.offsets, self._rule.distance, strict=True):
            if abs(di) >= rows or abs(dj) >= cols:
                continue
            a = (slice(max(0, -di), rows - max(0, di)), slice(max(0, -dj), cols - max(0, dj)))
            b = (slice(max(0, di), rows - max(0, -di)), slice(max(0, dj), cols - max(0, -dj)))
            free = ~(held[a] | held[b])
            if free.any():
                over = columns.height[a] - columns.height[b] - slope[a] * distance
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
