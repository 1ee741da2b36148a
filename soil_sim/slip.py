"""Slip: soil steeper than its angle of repose moves down (reference, section 3.1.2).

Every grid point within radius r (a Gauss circle) of a column is a neighbour it may slip to. The
neighbour with the largest excess of height over `tan(angle) * distance` receives half of that
excess, until no neighbour has any; columns disturbed by this are examined in turn, first in,
first out. The map's edge is a closed wall. Columns a tool stands in are held and take no part.

The angle is that of the higher column's soil, at its moisture: of the loose soil on top, and of the
firm soil under it. Firm soil does not slip as long as it stands above the neighbour by no more than
the height that its cohesion carries; beyond that it fails, is loose, and lies at its angle of
repose. Only neighbours within r are looked at: of a slope that is less than upright and much longer
than r, cohesion carries more than it would.

A tall heap that comes down at one point is let down a layer at a time, thinner than a column is
wide; halved at once it would run out flat.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from soil_sim.collapse import Collapse
from soil_sim.columns import Columns, add_loose, settle_height, take_loose

__all__ = ["Slip", "SlipNoise", "gauss_circle"]

_FEWEST_MM3 = 4

_MANY = 2000
"""Columns waiting from which sweeping is less work than examining."""

_AT_ONCE = 2000
"""Columns examined before it is asked again whether sweeping is less work."""

_PAIRS_OF_WORK = 60
"""Pairs relaxed in the time that a column is examined in."""

_MOST_SWEEPS = 8
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
        shape: by what part the pull of a neighbour varies at random, 0 to 1: soil does not always
            take the steepest way.
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
        self._offsets = gauss_circle(radius)
        self._distance = np.hypot(self._offsets[:, 0], self._offsets[:, 1]) * columns.grid.cell
        # Finer than a few mm^3 on a column nothing can be levelled.
        finest = _FEWEST_MM3 * columns.metres_per_mm3
        self._tolerance = max(tolerance * columns.grid.cell, finest)
        size = columns.grid.rows * columns.grid.cols
        self._queue = np.zeros(size + 1, dtype=np.int64)
        self._queued = np.zeros(size, dtype=np.uint8)
        self._ends = np.zeros(2, dtype=np.int64)  # head and tail of the ring
        self.held: NDArray[np.uint8] = np.zeros(columns.grid.shape, dtype=np.uint8)
        self._collapse = Collapse(columns, self._offsets, tolerance=self._tolerance)
        self._noise = noise or SlipNoise(np.zeros(0), 0.0, 0)
        self._random = np.array([self._noise.seed * 2 + 1], dtype=np.uint64)
        self._swept = 0  # columns that the last collapse left to be examined

    @property
    def waiting(self) -> int:
        """Columns still to be examined or swept."""
        return self._queue_length + self._collapse.waiting

    @property
    def _queue_length(self) -> int:
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
        """Let soil slip until all is at rest or work for `budget` examinations has been done.

        A little soil is seen to column by column; where more columns wait than is worth that, the
        whole of where they lie is swept (`soil_sim.collapse`).

        Returns:
            The number of columns examined, sweeps counted as the work they are.
        """
        left = 2**62 if budget is None else budget
        spent = 0
        while left > 0 and self.waiting:
            work = 0
            if self._collapse.running or self._queue_length > max(_MANY, 2 * self._swept):
                work = self._sweep(left)
            if work == 0:
                # Asked again now and then: what begins small may be a large failure.
                work = self._examine(min(left, _AT_ONCE))
            spent += work
            left -= work
        if not self.waiting:
            self._swept = 0
        return spent

    def _sweep(self, budget: int) -> int:
        """Sweep where columns wait; returns the work done, 0 if it cannot be done so."""
        collapse, waiting = self._collapse, self._waiting_cells()
        box = collapse.box_with(waiting)
        if self._noise.uneven or not collapse.suits(box):
            if collapse.running:
                self.disturb(collapse.take_touched())
            return 0
        cost = max(1, (box[1] - box[0]) * (box[3] - box[2]) * collapse.directions // _PAIRS_OF_WORK)
        # The first sweep shows where anything moves at all.
        sweeps = max(1, min(budget // cost, _MOST_SWEEPS)) if collapse.running else 1
        self._queued[waiting] = 0
        self._ends[:] = 0
        if collapse.sweep(box, self.held, sweeps):
            # What is left too steep is little, and is seen to column by column.
            self.disturb(collapse.take_touched())
            self._swept = self._queue_length
        return sweeps * cost

    def _waiting_cells(self) -> NDArray[np.int64]:
        head, tail = self._ends.tolist()
        if head <= tail:
            return self._queue[head:tail].copy()
        return np.concatenate([self._queue[head:], self._queue[:tail]])

    def _examine(self, budget: int) -> int:
        return int(
            _relax(
                self._columns.arrays,
                self._columns.tables,
                self.held.reshape(-1),
                self._columns.grid.rows,
                self._columns.grid.cols,
                self._offsets,
                self._distance,
                self._tolerance,
                self._queue,
                self._queued,
                self._ends,
                budget,
                self._noise.steeper,
                self._noise.shape,
                self._random,
            )
        )

    def steepest_excess(self) -> float:
        """Largest excess of any slope that can slip, as a tangent, held columns left out.

        Over tan(angle) of the soil on top, where that is loose; over what cohesion carries, where
        it is firm. Neighbours farther than the map is wide do not exist; -inf if no two columns
        are free.
        """
        worst = -math.inf
        columns, held = self._columns, self.held.astype(bool)
        rows, cols = columns.height.shape
        tables = columns.tables
        slope = tables.slope[columns.top_soil, columns.top_moisture]
        firm_slope = tables.slope[columns.soil, columns.moisture]
        stands = tables.stands[columns.soil, columns.moisture]
        if self._noise.steeper.size:
            slope = slope * self._noise.steeper.reshape(slope.shape)
            firm_slope = firm_slope * self._noise.steeper.reshape(slope.shape)
        base = columns.floor + columns.firm * columns.metres_per_mm3
        for (di, dj), distance in zip(self._offsets, self._distance, strict=True):
            if abs(di) >= rows or abs(dj) >= cols:
                continue
            a = (slice(max(0, -di), rows - max(0, di)), slice(max(0, -dj), cols - max(0, dj)))
            b = (slice(max(0, di), rows - max(0, -di)), slice(max(0, dj), cols - max(0, -dj)))
            free = ~(held[a] | held[b])
            if free.any():
                over = columns.height[a] - columns.height[b] - slope[a] * distance
                # Of a slope that is too steep only the loose soil on it can slip, or firm soil
                # that stands higher than it can.
                face = base[a] - columns.height[b]
                firm = np.where(face > stands[a], face - firm_slope[a] * distance, -math.inf)
                lies = np.where(
                    columns.loose[a] > 0, np.minimum(over, columns.loose_depth[a]), firm
                )
                excess = np.maximum(lies, firm)[free].max()
                worst = max(worst, excess / distance)
        return worst


@njit(cache=True, inline="always")
def _uniform(random):  # type: ignore[no-untyped-def]
    """The next random number from 0 to 1 (xorshift64*, Vigna 2016); the state is changed."""
    x = random[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    random[0] = x
    return ((x * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


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
    columns,
    tables,
    held,
    rows,
    cols,
    offsets,
    distance,
    tolerance,
    queue,
    queued,
    ends,
    budget,
    steeper,
    uneven,
    random,
):
    """Examine queued columns, at most `budget`; returns how many were."""
    firm, loose, height = columns.firm, columns.loose, columns.height
    slope, stands = tables.slope, tables.stands
    metres_per_mm3, floor = columns.metres_per_mm3, columns.floor
    count = offsets.shape[0]
    flat = offsets[:, 0] * cols + offsets[:, 1]
    reach = np.int64(np.abs(offsets).max())
    gentlest = slope.min()
    most_at_once = 0.25 * distance.min()
    if steeper.size:
        gentlest *= steeper.min()
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
            kind, moisture = columns.soil[i], columns.moisture[i]
            firm_tangent = tangent = slope[kind, moisture]
            if loose[i] > 0:
                tangent = slope[columns.loose_soil[i], columns.loose_moisture[i]]
            if steeper.size:
                tangent *= steeper[i]
                firm_tangent *= steeper[i]
            base = floor + firm[i] * metres_per_mm3
            carried = stands[kind, moisture]
            gentle = min(tangent, firm_tangent)
            firm_excess = 0.0
            best, most, least = 0.0, 0.0, tolerance
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
                drop = height[i] - height[j]
                if drop - gentle * distance[k] <= least or held[j] != 0:
                    continue
                # What can go: loose soil as far as there is any, and firm if it stands too high.
                excess = min(drop - tangent * distance[k], height[i] - base)
                fails = base - height[j] - firm_tangent * distance[k]
                if fails > tolerance and base - height[j] > carried:
                    excess = max(drop - tangent * distance[k], fails) if loose[i] > 0 else fails
                else:
                    fails = 0.0
                if excess <= least:
                    continue
                if uneven > 0.0:
                    liking = excess * (1.0 + uneven * (2.0 * _uniform(random) - 1.0))
                    if liking <= most:
                        continue
                    most = liking
                else:
                    least = excess
                best, firm_excess = excess, fails
                target = j
            if target < 0 or not _slip(columns, i, target, best, firm_excess, most_at_once):
                break
            gave = True
            _push(target, queue, queued, ends)
        if gave:
            for k in range(count):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if r < 0 or r >= rows or c < 0 or c >= cols:
                    continue
                j = i + flat[k]
                rise = height[j] - height[i] - tolerance
                # Most are not steeper than the gentlest angle of any soil: its own need no look.
                if rise > gentlest * distance[k]:
                    limit = slope[columns.soil[j], columns.moisture[j]]
                    if loose[j] > 0:
                        upper = slope[columns.loose_soil[j], columns.loose_moisture[j]]
                        limit = min(upper, limit)
                    limit *= distance[k]
                    if steeper.size:
                        limit *= steeper[j]
                    if rise > limit:
                        _push(j, queue, queued, ends)
    return examined


@njit(cache=True, forceinline=True)
def _slip(columns, i, j, excess, firm_excess, most_at_once):  # type: ignore[no-untyped-def]
    """Move half of an excess of height [m] from column i to j; returns whether anything went.

    Loose soil goes first and is loosened anew if it was packed; of firm soil goes half of what it
    has too much itself, and swells where it lands. No more than `most_at_once` [m] moves.
    """
    metres_per_mm3 = columns.metres_per_mm3
    went = False
    rest = min(excess, 2.0 * most_at_once)
    if columns.loose[i] > 0:
        kind = columns.loose_soil[i]
        growth = columns.growth[kind]
        packed = columns.bulk[i] / columns.loose[i]
        # i falls by packed, j rises by growth, for each mm^3 of bank volume.
        move = min(np.int64(rest / metres_per_mm3 / (packed + growth)), columns.loose[i])
        if move > 0:
            moisture = columns.loose_moisture[i]
            take_loose(columns, i, move)
            add_loose(columns, j, move, np.int64(move * growth + 0.5), kind, moisture)
            rest -= move * (packed + growth) * metres_per_mm3
            went = True
    if firm_excess > 0.0 and columns.loose[i] == 0:
        kind = columns.soil[i]
        growth = columns.growth[kind]
        rest = min(rest, firm_excess)
        fail = min(np.int64(rest / metres_per_mm3 / (1.0 + growth)), columns.firm[i])
        if fail > 0:
            columns.firm[i] -= fail
            settle_height(columns, i)
            bulk = np.int64(fail * growth + 0.5)
            add_loose(columns, j, fail, bulk, kind, columns.moisture[i])
            went = True
    return went
