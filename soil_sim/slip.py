"""Slip: soil steeper than its angle of repose moves down (reference, section 3.1.2).

Every grid point within radius r (a Gauss circle) of a column is a neighbour it may slip to. The
neighbour with the largest excess of height over `tan(angle) * distance` receives half of that
excess, until no neighbour has any; columns disturbed by this are examined in turn, first in,
first out. The map's edge is a closed wall. Columns a tool stands in are held and take no part.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from soil_sim.columns import Columns, settle_height

__all__ = ["Slip", "gauss_circle"]


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


class Slip:
    """The columns waiting to be examined, and the rule by which they slip.

    Attributes:
        held: columns that neither give nor take soil, shape (rows, cols), uint8.
    """

    def __init__(
        self, columns: Columns, *, angle: float, radius: float = 4.0, tolerance: float = 0.002
    ) -> None:
        """
        Args:
            columns: the terrain this acts on.
            angle: angle of repose [rad].
            radius: of the neighbourhood [cells].
            tolerance: excess left standing, as a height in parts of a cell.
        """
        self._columns = columns
        self._offsets = gauss_circle(radius)
        distance = np.hypot(self._offsets[:, 0], self._offsets[:, 1]) * columns.grid.cell
        self._limit = math.tan(angle) * distance
        self._tolerance = tolerance * columns.grid.cell
        size = columns.grid.rows * columns.grid.cols
        self._queue = np.zeros(size + 1, dtype=np.int64)
        self._queued = np.zeros(size, dtype=np.uint8)
        self._ends = np.zeros(2, dtype=np.int64)  # head and tail of the ring
        self.held: NDArray[np.uint8] = np.zeros(columns.grid.shape, dtype=np.uint8)

    @property
    def waiting(self) -> int:
        """Columns still to be examined."""
        return int((self._ends[1] - self._ends[0]) % self._queue.size)

    def disturb(self, cells: NDArray[np.integer], *, around: bool = False) -> None:
        """Note columns (flat indices) that gained soil; with `around`, that lost it.

        A column that lost soil gives cause to its neighbours, not to itself.
        """
        _disturb(
            np.asarray(cells, dtype=np.int64),
            around,
            self._columns.grid.rows,
            self._columns.grid.cols,
            self._offsets,
            self._queue,
            self._queued,
            self._ends,
        )

    def disturb_all(self) -> None:
        """Examine the whole map."""
        self.disturb(np.arange(self._columns.height.size))

    def relax(self, budget: int | None = None) -> int:
        """Let soil slip until all is at rest or `budget` columns have been examined.

        Returns:
            The number of columns examined.
        """
        return int(
            _relax(
                self._columns.arrays,
                self.held.reshape(-1),
                self._columns.grid.rows,
                self._columns.grid.cols,
                self._offsets,
                self._limit,
                self._tolerance,
                self._queue,
                self._queued,
                self._ends,
                2**62 if budget is None else budget,
            )
        )

    def steepest_excess(self) -> float:
        """Largest excess of any slope over tan(angle), held columns left out; below 0 if none.

        Neighbours farther than the map is wide do not exist; -inf if no two columns are free.
        """
        worst = -math.inf
        height, held = self._columns.height, self.held.astype(bool)
        rows, cols = height.shape
        for (di, dj), limit in zip(self._offsets, self._limit, strict=True):
            if abs(di) >= rows or abs(dj) >= cols:
                continue
            a = (slice(max(0, -di), rows - max(0, di)), slice(max(0, -dj), cols - max(0, dj)))
            b = (slice(max(0, di), rows - max(0, -di)), slice(max(0, dj), cols - max(0, -dj)))
            free = ~(held[a] | held[b])
            if free.any():
                excess = (height[a] - height[b])[free].max() - limit
                worst = max(worst, excess / math.hypot(di, dj) / self._columns.grid.cell)
        return worst


@njit(cache=True, inline="always")
def _push(i, queue, queued, ends):  # type: ignore[no-untyped-def]
    if queued[i] == 0:
        queued[i] = 1
        queue[ends[1]] = i
        ends[1] = (ends[1] + 1) % queue.size


@njit(cache=True)
def _disturb(cells, around, rows, cols, offsets, queue, queued, ends):  # type: ignore[no-untyped-def]
    for i in cells:
        _push(i, queue, queued, ends)
        if around:
            row, col = i // cols, i % cols
            for k in range(offsets.shape[0]):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if 0 <= r < rows and 0 <= c < cols:
                    _push(r * cols + c, queue, queued, ends)


@njit(cache=True)
def _relax(  # type: ignore[no-untyped-def]
    columns, held, rows, cols, offsets, limit, tolerance, queue, queued, ends, budget
):
    """Examine queued columns, at most `budget`; returns how many were."""
    firm, loose, height = columns.firm, columns.loose, columns.height
    growth = 1.0 + columns.swell
    metres_per_mm3 = columns.metres_per_mm3
    count = offsets.shape[0]
    flat = offsets[:, 0] * cols + offsets[:, 1]
    reach = np.int64(np.abs(offsets).max())
    examined = 0
    forward = True
    while ends[0] != ends[1] and examined < budget:
        i = queue[ends[0]]
        ends[0] = (ends[0] + 1) % queue.size
        queued[i] = 0
        examined += 1
        if held[i]:
            continue
        row, col = i // cols, i % cols
        interior = reach <= row < rows - reach and reach <= col < cols - reach
        gave = False
        while True:
            best = tolerance
            target = np.int64(-1)
            # Ties go to alternate ends of the list, or a heap would drift to one side.
            forward = not forward
            for n in range(count):
                k = n if forward else count - 1 - n
                if not interior:
                    r, c = row + offsets[k, 0], col + offsets[k, 1]
                    if r < 0 or r >= rows or c < 0 or c >= cols:
                        continue
                j = i + flat[k]
                excess = height[i] - height[j] - limit[k]
                if excess > best and held[j] == 0:
                    best = excess
                    target = j
            if target < 0:
                break
            # Loose soil goes first; firm soil that fails is loosened and swells where it lands.
            move = min(np.int64(0.5 * best / metres_per_mm3 / growth), loose[i])
            rest = best - 2.0 * move * growth * metres_per_mm3
            fail = np.int64(0)
            if move == loose[i]:
                fail = min(np.int64(rest / metres_per_mm3 / (1.0 + growth)), firm[i])
            if move + fail <= 0:
                break
            loose[i] -= move
            firm[i] -= fail
            loose[target] += move + fail
            settle_height(columns, i)
            settle_height(columns, target)
            gave = True
            _push(target, queue, queued, ends)
        if gave:
            for k in range(count):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if r < 0 or r >= rows or c < 0 or c >= cols:
                    continue
                j = i + flat[k]
                if height[j] - height[i] - limit[k] > tolerance:
                    _push(j, queue, queued, ends)
    return examined
