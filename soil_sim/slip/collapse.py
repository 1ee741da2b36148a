"""Collapse: large failures, relaxed all at once.

Examining one column after the other is best for a little soil that slips, and slow where a wall
comes down: each column is examined again and again. Here a whole window of the map is swept
instead. In every direction that a neighbour can lie in, columns are taken in pairs, no column in
two pairs at a time, and the higher one gives the lower one what it has too much; direction by
direction, until nothing moves.

That is done on a copy of the heights in float32, and is only a plan of who loses and who gains
height, which is then booked in whole mm^3 (`soil_sim.slip.book`). So the account is as exact as
ever; what swelling and rounding leave too steep is seen to by examining the columns touched.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns import Columns
from soil_sim.jit import helper, kernel
from soil_sim.slip.book import book
from soil_sim.slip.face import firm_that_stands
from soil_sim.slip.rule import SlipRule

__all__ = ["Box", "Collapse"]

Box = tuple[int, int, int, int]
"""A window of the map: first row, row after the last, first column, column after the last."""

_MARGIN = 6
"""Columns around those that are disturbed which are swept, too."""

_WALL = np.float32(1e6)
"""Height of what neither gives nor takes [m]."""

_FIRST_STEP, _LAST_STEP, _RAMP = 0.5, 0.9, 8
"""Part of an excess that is given: half at first, more once the worst is over, after so many
sweeps. More is faster, but a tall heap would spread too wide before it slows."""


class Collapse:
    """Sweeps of a window over several calls, and what they touched.

    Attributes:
        running: whether a collapse has begun and is not at rest.
        touched: columns that waited, lost or gained, flat indices.
    """

    def __init__(self, columns: Columns, rule: SlipRule) -> None:
        """
        Args:
            columns: the terrain this acts on.
            rule: by which its soil slips.
        """
        self._columns, self._rule = columns, rule
        # Of a direction and its opposite one is enough, and of (2, 0) and (1, 0) the shorter.
        half = [
            (int(di), int(dj))
            for di, dj in rule.offsets
            if math.gcd(abs(int(di)), abs(int(dj))) == 1 and (di > 0 or (di == 0 and dj > 0))
        ]
        self._steps = np.array(half, dtype=np.int64)
        self._reach = rule.reach
        self._distance = (np.hypot(*self._steps.T) * columns.grid.cell).astype(np.float32)
        # (1, 0) is (4, 0) four times over: together they may be too steep by no more than it all.
        times = self._reach // np.abs(self._steps).max(axis=1)
        self._tolerances = (rule.tolerance / times).astype(np.float32)
        self._box: Box | None = None
        self._sweeps = 0
        self._touched: list[NDArray[np.int64]] = []

    @property
    def running(self) -> bool:
        """Whether a collapse has begun and has not come to rest."""
        return self._box is not None

    @property
    def waiting(self) -> int:
        """Columns in the window that is still being swept."""
        if self._box is None:
            return 0
        return (self._box[1] - self._box[0]) * (self._box[3] - self._box[2])

    @property
    def directions(self) -> int:
        """Directions in which pairs are relaxed in a sweep."""
        return int(self._steps.shape[0])

    def box_with(self, cells: NDArray[np.int64]) -> Box:
        """The window that disturbed columns (flat indices), those around them and a running
        collapse lie in."""
        own = self._box
        if cells.size == 0:
            assert own is not None, "somewhere there is something to sweep"
            return own
        box = self._clipped(self._bounds(cells))
        return box if own is None else _joined(box, own)

    def suits(self, box: Box) -> bool:
        """Whether a window is all of one kind of soil at one angle, as sweeping needs it."""
        columns = self._columns
        return bool(_alike(columns.arrays, columns.tables.slope, columns.grid.cols, *box))

    def sweep(
        self, box: Box, waiting: NDArray[np.int64], held: NDArray[np.uint8], most: int
    ) -> bool:
        """Sweep a window at most `most` times; goes on where the last call ended.

        Args:
            box: of `box_with`.
            waiting: columns (flat indices) to be examined if not by sweeping: only that sees a
                step down beyond a neighbour that stands.
            held: columns that neither give nor take, shape (rows, cols).
            most: number of sweeps.

        Returns:
            Whether all of it is at rest; `take_touched` then tells what to examine.
        """
        if self._box is None:
            self._sweeps = 0
        columns = self._columns
        start, floor = self._planned(box, held)
        tall = start.shape[0] > start.shape[1]
        if tall:  # long rows are quicker; the directions are the same
            start, floor = np.ascontiguousarray(start.T), np.ascontiguousarray(floor.T)
        plan = start.copy()
        slope = columns.tables.slope[
            columns.top_soil[box[0], box[2]], columns.top_moisture[box[0], box[2]]
        ]
        limits = (slope * self._distance).astype(np.float32)
        done = 0
        moved = True
        while moved and done < most:
            part = _FIRST_STEP + (_LAST_STEP - _FIRST_STEP) * min(self._sweeps / _RAMP, 1.0)
            moved = bool(
                _sweep(
                    plan.reshape(-1),
                    floor.reshape(-1),
                    plan.shape[1],
                    self._steps,
                    limits,
                    self._tolerances,
                    np.float32(part),
                    self._sweeps % 2 == 1,
                )
            )
            self._sweeps += 1
            done += 1
        change = (plan - start).astype(np.float64)
        change = np.ascontiguousarray(change.T) if tall else change
        cells = book(columns, (box[0], box[2]), change, self._reach)
        self._touched += [cells, waiting]
        # What has not moved is at rest, but for what lies around that which has.
        self._box = self._clipped(self._bounds(cells)) if moved and cells.size else None
        return self._box is None

    def take_touched(self) -> NDArray[np.int64]:
        """Flat indices of all columns to be examined now: near those that waited, lost or gained.

        A collapse that is still running is ended, and all columns of its window are among them.
        """
        parts = self._touched.copy()
        if self._box is not None:
            rows, cols = np.arange(*self._box[:2]), np.arange(*self._box[2:])
            parts.append((rows[:, None] * self._columns.grid.cols + cols).reshape(-1))
        self._touched.clear()
        self._box = None
        cells = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
        if cells.size == 0:
            return cells
        top, _, left, _ = box = self._clipped(self._bounds(cells))
        rows, cols = np.divmod(cells, self._columns.grid.cols)
        far = np.ones((box[1] - box[0], box[3] - box[2]), dtype=np.uint8)
        far[rows - top, cols - left] = 0
        near_rows, near_cols = np.nonzero(_least_around(far, self._reach) == 0)
        return (near_rows + top) * self._columns.grid.cols + near_cols + left

    def _planned(
        self, box: Box, held: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Heights in a window over its lowest, and those below which a column cannot give [m].

        That is its firm soil, as far as it stands.
        """
        columns, window = self._columns, _slices(box)
        heights = columns.height[window]
        lowest = float(heights.min())
        plan = (heights - lowest).astype(np.float32)
        floor = np.empty_like(plan)
        _firm_floor(columns.arrays, self._rule, held.reshape(-1), box, lowest, floor)
        # One that is held is a wall: as high as none, it takes nothing, and has nothing to give.
        fixed = held[window] != 0
        plan[fixed] = floor[fixed] = _WALL
        return plan, floor

    def _bounds(self, cells: NDArray[np.int64]) -> Box:
        rows, cols = np.divmod(cells, self._columns.grid.cols)
        return (int(rows.min()), int(rows.max()) + 1, int(cols.min()), int(cols.max()) + 1)

    def _clipped(self, box: Box) -> Box:
        margin, (rows, cols) = _MARGIN + self._reach, self._columns.grid.shape
        return (
            max(box[0] - margin, 0),
            min(box[1] + margin, rows),
            max(box[2] - margin, 0),
            min(box[3] + margin, cols),
        )


def _slices(box: Box) -> tuple[slice, slice]:
    return slice(box[0], box[1]), slice(box[2], box[3])


def _joined(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])


def _least_around(values: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Least value within `reach` rows and columns of each column."""
    least = values.copy()
    for axis in (0, 1):
        source = least.copy()
        for step in range(1, reach + 1):
            if step >= values.shape[axis]:
                break
            low, high = [slice(None)] * 2, [slice(None)] * 2
            low[axis], high[axis] = slice(None, -step), slice(step, None)
            a, b = tuple(low), tuple(high)
            least[a] = np.minimum(least[a], source[b])
            least[b] = np.minimum(least[b], source[a])
    return least


@kernel()
def _firm_floor(columns, rule, held, box, lowest, floor):  # type: ignore[no-untyped-def]
    """Heights over `lowest` [m] to which the firm soil of a window stands, into `floor`."""
    row, _, col, _ = box
    kind = columns.soil[row * rule.cols + col]  # the window is all of one
    near = rule.faces.near
    coheres = False
    for moisture in range(near.shape[1]):
        coheres |= near[kind, moisture, 0] > 0.0
    for r in range(floor.shape[0]):
        for c in range(floor.shape[1]):
            i = (row + r) * rule.cols + col + c
            stands = firm_that_stands(columns, rule, held, i) if coheres else columns.floor
            floor[r, c] = stands - lowest


@helper(error_model="numpy", forceinline=True)
def _gift(drop, spare_a, spare_b, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """What one of a pair gives the other [m], from a to b; without a branch."""
    none = np.float32(0.0)
    spare = spare_a if drop > none else spare_b
    excess = abs(drop) - limit
    give = part * excess
    give = spare if spare < give else give
    give = give if excess > tolerance else none
    give = give if give > none else none
    return give if drop > none else -give


@helper(error_model="numpy", forceinline=True)
def _relax_pairs(plan, floor, a, b, stride, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax `count` pairs, a with b, a + stride with b + stride ...; returns whether any moved.

    Unsigned indices into flat arrays, so that it is compiled to vector instructions.
    """
    moved = np.int32(0)
    for n in range(count):
        x, y = a + n * stride, b + n * stride
        high, low = plan[x], plan[y]
        give = _gift(high - low, high - floor[x], low - floor[y], limit, tolerance, part)
        moved |= np.int32(give != np.float32(0.0))
        plan[x] = high - give
        plan[y] = low + give
    return moved


@helper(error_model="numpy")
def _relax_rows(plan, floor, a, b, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax the pairs of two rows, that begin at a and b."""
    return _relax_pairs(plan, floor, a, b, np.uint64(1), count, limit, tolerance, part)


@helper(error_model="numpy")
def _relax_row(plan, floor, a, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax the pairs of neighbours in a row, a with a + 1, a + 2 with a + 3 ..."""
    b, two = a + np.uint64(1), np.uint64(2)
    return _relax_pairs(plan, floor, a, b, two, count, limit, tolerance, part)


@kernel()
def _sweep(plan, floor, cols, steps, limits, tolerances, part, backward):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window once, in every direction; returns whether anything moved."""
    rows = plan.size // cols
    moved = np.int32(0)
    count = steps.shape[0]
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = steps[k]
        if di >= rows or abs(dj) >= cols:
            continue
        first, last = max(0, -dj), min(cols, cols - dj)
        rule = (limits[k], tolerances[k], part)
        # No column is in two pairs at a time: half of the pairs, then the other half.
        for half in range(2):
            for i in range(rows - di):
                a = np.uint64(i * cols + first)
                if di == 0:
                    pairs = np.uint64((cols - half) // 2)
                    moved |= _relax_row(plan, floor, a + np.uint64(half), pairs, *rule)
                elif (i // di) % 2 == half:
                    b = np.uint64((i + di) * cols + first + dj)
                    moved |= _relax_rows(plan, floor, a, b, np.uint64(last - first), *rule)
    return moved


@kernel()
def _alike(columns, slope, cols, row, row_end, col, col_end):  # type: ignore[no-untyped-def]
    """Whether all columns of a window are of one soil, and loose and firm soil as steep."""
    kind, moisture = columns.soil[row * cols + col], columns.moisture[row * cols + col]
    tangent = slope[kind, moisture]
    for r in range(row, row_end):
        for i in range(r * cols + col, r * cols + col_end):
            if columns.soil[i] != kind or slope[kind, columns.moisture[i]] != tangent:
                return False
            if columns.loose[i] > 0 and (
                columns.loose_soil[i] != kind or slope[kind, columns.loose_moisture[i]] != tangent
            ):
                return False
    return True
