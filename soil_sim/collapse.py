"""Collapse: large failures, relaxed all at once.

Examining one column after the other is best for a little soil that slips, and slow where a wall
comes down: each column is examined again and again. Here a whole window of the map is swept
instead. In every direction that a neighbour can lie in, columns are taken in pairs, no column in
two pairs at a time, and the higher one gives the lower one what it has too much; direction by
direction, until nothing moves.

That is done on a copy of the heights in float32, and is only a plan of who loses and who gains
height. What those who lose really hold is then taken from them, in whole mm^3 of bank volume, and
shared out among those of the same failure who gain, exactly. So the account is as exact as ever;
what swelling and rounding leave too steep is seen to by examining the columns that were touched.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from soil_sim.columns import Columns, add_loose, take_from_column

__all__ = ["Box", "Collapse"]

Box = tuple[int, int, int, int]
"""A window of the map: first row, row after the last, first column, column after the last."""

_MARGIN = 6
"""Columns around those that are disturbed which are swept, too."""

_WALL = np.float32(1e6)
"""Height of what neither gives nor takes [m]."""

_FIRST_STEP, _LAST_STEP, _RAMP = 0.5, 0.75, 8
"""Part of an excess that is given: half at first, more once the worst is over, after so many
sweeps. More is faster, but a tall heap would spread too wide before it slows."""


class Collapse:
    """Sweeps of a window over several calls, and what they touched.

    Attributes:
        running: whether a collapse has begun and is not at rest.
        touched: columns that lost or gained in it, flat indices.
    """

    def __init__(self, columns: Columns, offsets: NDArray[np.int64], *, tolerance: float) -> None:
        """
        Args:
            columns: the terrain this acts on.
            offsets: (row, col) of all neighbours [cells], shape (n, 2).
            tolerance: excess of height left standing [m].
        """
        self._columns = columns
        # Of a direction and its opposite one is enough, and of (2, 0) and (1, 0) the shorter.
        half = [
            (int(di), int(dj))
            for di, dj in offsets
            if math.gcd(abs(int(di)), abs(int(dj))) == 1 and (di > 0 or (di == 0 and dj > 0))
        ]
        self._steps = np.array(half, dtype=np.int64)
        self._reach = int(np.abs(offsets).max())
        self._distance = (np.hypot(*self._steps.T) * columns.grid.cell).astype(np.float32)
        self._tolerance = np.float32(tolerance)
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
        window = _slices(box)
        columns = self._columns
        kind, moisture = columns.soil[window], columns.top_moisture[window]
        if (kind != kind.flat[0]).any() or (columns.top_soil[window] != kind.flat[0]).any():
            return False
        if (columns.moisture[window] != moisture).any():  # loose soil wetter than what it lies on
            return False
        slope = columns.tables.slope[kind.flat[0]]
        return bool(
            (
                slope[int(moisture.min()) : int(moisture.max()) + 1] == slope[int(moisture.flat[0])]
            ).all()
        )

    def sweep(self, box: Box, held: NDArray[np.uint8], most: int) -> bool:
        """Sweep a window at most `most` times; goes on where the last call ended.

        Args:
            box: of `box_with`.
            held: columns that neither give nor take, shape (rows, cols).
            most: number of sweeps.

        Returns:
            Whether all of it is at rest; `take_touched` then tells what to examine.
        """
        if self._box is None:
            self._sweeps = 0
        window = _slices(box)
        columns = self._columns
        before = columns.height[window]
        lowest = float(before.min())
        plan = (before - lowest).astype(np.float32)
        slope = columns.tables.slope[
            columns.top_soil[box[0], box[2]], columns.top_moisture[box[0], box[2]]
        ]
        limits = (slope * self._distance).astype(np.float32)
        done = 0
        moved = True
        floor = self._floor(window, plan, lowest)
        # One that is held is a wall: as high as none, it takes nothing, and has nothing to give.
        fixed = held[window] != 0
        plan[fixed] = floor[fixed] = _WALL
        start = plan.copy()
        while moved and done < most:
            part = _FIRST_STEP + (_LAST_STEP - _FIRST_STEP) * min(self._sweeps / _RAMP, 1.0)
            moved = bool(
                _sweep(
                    plan,
                    floor,
                    self._steps,
                    limits,
                    self._tolerance,
                    np.float32(part),
                    self._sweeps % 2 == 1,
                )
            )
            self._sweeps += 1
            done += 1
        change = (plan - start).astype(np.float64)
        cells = self._book(box, change)
        self._touched.append(cells)
        # What has not moved is at rest, but for what lies around that which has.
        self._box = self._clipped(self._bounds(cells)) if moved and cells.size else None
        return self._box is None

    def take_touched(self) -> NDArray[np.int64]:
        """Flat indices of all columns to be examined now: those that lost or gained.

        A collapse that is still running is ended, and all columns of its window are among them.
        """
        parts = [np.zeros(0, dtype=np.int64), *self._touched]
        if self._box is not None:
            rows, cols = np.arange(*self._box[:2]), np.arange(*self._box[2:])
            parts.append((rows[:, None] * self._columns.grid.cols + cols).reshape(-1))
        self._touched.clear()
        self._box = None
        return np.unique(np.concatenate(parts))

    def _floor(
        self, window: tuple[slice, slice], plan: NDArray[np.float32], lowest: float
    ) -> NDArray[np.float32]:
        """The height below which a column cannot give: its firm soil, as far as that stands."""
        columns = self._columns
        base = columns.floor + columns.firm[window] * columns.metres_per_mm3 - lowest
        stands = columns.tables.stands[columns.soil[window], columns.moisture[window]]
        least = _least_around(plan, self._reach)
        floor: NDArray[np.float32] = np.minimum(base, least + stands).astype(np.float32)
        return floor

    def _book(self, box: Box, change: NDArray[np.float64]) -> NDArray[np.int64]:
        """Do what was planned with whole mm^3, failure by failure; returns the columns touched."""
        rows, cols = np.nonzero(change)
        if rows.size == 0:
            return np.zeros(0, dtype=np.int64)
        failure = _failures(change != 0.0, self._reach)[rows, cols]
        order = np.argsort(failure, kind="stable")
        cells = (rows + box[0]) * self._columns.grid.cols + cols + box[2]
        ends = np.concatenate([[0], np.flatnonzero(np.diff(failure[order])) + 1, [cells.size]])
        _share_out(self._columns.arrays, cells[order], change[rows, cols][order], ends)
        return np.asarray(cells, dtype=np.int64)

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


def _least_around(heights: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Least height within `reach` rows and columns of each column."""
    least = heights.copy()
    for axis in (0, 1):
        source = least.copy()
        for step in range(1, reach + 1):
            if step >= heights.shape[axis]:
                break
            low, high = [slice(None)] * 2, [slice(None)] * 2
            low[axis], high[axis] = slice(None, -step), slice(step, None)
            a, b = tuple(low), tuple(high)
            least[a] = np.minimum(least[a], source[b])
            least[b] = np.minimum(least[b], source[a])
    return least


@njit(cache=True, error_model="numpy")
def _relax_rows(a, b, low_a, low_b, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax pairs of two rows, a[x] with b[x]; returns whether anything moved.

    Without branches and with few arrays, so that it is compiled to vector instructions.
    """
    none = np.float32(0.0)
    moved = np.int32(0)
    for x in range(a.size):
        drop = a[x] - b[x]
        spare = a[x] - low_a[x] if drop > none else b[x] - low_b[x]
        excess = abs(drop) - limit
        give = part * excess
        give = spare if spare < give else give
        give = give if excess > tolerance else none
        give = give if give > none else none
        moved |= np.int32(give > none)
        give = give if drop > none else -give
        a[x] -= give
        b[x] += give
    return moved


@njit(cache=True, error_model="numpy")
def _relax_row(a, low, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax pairs of neighbours in a row, a[0] with a[1], a[2] with a[3] ...; whether any moved."""
    none = np.float32(0.0)
    moved = np.int32(0)
    for n in range(a.size // 2):
        x = 2 * n
        drop = a[x] - a[x + 1]
        spare = a[x] - low[x] if drop > none else a[x + 1] - low[x + 1]
        excess = abs(drop) - limit
        give = part * excess
        give = spare if spare < give else give
        give = give if excess > tolerance else none
        give = give if give > none else none
        moved |= np.int32(give > none)
        give = give if drop > none else -give
        a[x] -= give
        a[x + 1] += give
    return moved


@njit(cache=True)
def _sweep(plan, floor, steps, limits, tolerance, part, backward):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window once, in every direction; returns whether anything moved."""
    rows, cols = plan.shape
    moved = np.int32(0)
    count = steps.shape[0]
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = steps[k]
        if di >= rows or abs(dj) >= cols:
            continue
        first, last = max(0, -dj), min(cols, cols - dj)
        # No column is in two pairs at a time: half of the pairs, then the other half.
        for half in range(2):
            for i in range(rows - di):
                if di == 0:
                    moved |= _relax_row(plan[i, half:], floor[i, half:], limits[k], tolerance, part)
                elif (i // di) % 2 == half:
                    moved |= _relax_rows(
                        plan[i, first:last], plan[i + di, first + dj : last + dj],
                        floor[i, first:last], floor[i + di, first + dj : last + dj],
                        limits[k], tolerance, part,
                    )  # fmt: skip
    return moved


@njit(cache=True)
def _failures(moved, reach):  # type: ignore[no-untyped-def]
    """Number of the failure that each column that moved belongs to, from 1.

    Two columns are of one failure if they are within reach of one another, or of a third that is.
    """
    rows, cols = moved.shape
    number = np.zeros((rows, cols), dtype=np.int64)
    stack = np.empty((moved.sum(), 2), dtype=np.int64)
    count = 0
    for i in range(rows):
        for j in range(cols):
            if not moved[i, j] or number[i, j]:
                continue
            count += 1
            number[i, j] = count
            stack[0] = i, j
            size = 1
            while size:
                size -= 1
                a, b = stack[size]
                for p in range(max(a - reach, 0), min(a + reach + 1, rows)):
                    for q in range(max(b - reach, 0), min(b + reach + 1, cols)):
                        if moved[p, q] and number[p, q] == 0:
                            number[p, q] = count
                            stack[size] = p, q
                            size += 1
    return number


@njit(cache=True)
def _share_out(columns, cells, change, ends):  # type: ignore[no-untyped-def]
    """Take height [m] from the columns that lose and share what that was among those that gain.

    Exact to the mm^3, each failure for itself: failure n is cells[ends[n] : ends[n + 1]].
    """
    for n in range(ends.size - 1):
        bank = np.int64(0)
        water = whole = 0.0
        kind = columns.soil[cells[ends[n]]]
        last = -1
        for m in range(ends[n], ends[n + 1]):
            i = cells[m]
            if change[m] > 0.0:
                whole += change[m]
                last = m
                continue
            moisture = columns.loose_moisture[i] if columns.loose[i] > 0 else columns.moisture[i]
            loose, firm = take_from_column(columns, i, -change[m] / columns.metres_per_mm3)
            bank += loose + firm
            water += 1.0 * (loose + firm) * moisture
        if bank == 0:
            continue
        wet = np.uint8(water / bank + 0.5)
        growth = columns.growth[kind]
        if last < 0:  # rounding left no column that gains: it stays where it was
            bulk = np.int64(bank * growth + 0.5)
            add_loose(columns, cells[ends[n]], bank, bulk, kind, wet)
            continue
        given, part = np.int64(0), 0.0
        for m in range(ends[n], ends[n + 1]):
            if change[m] <= 0.0:
                continue
            part += change[m]
            through = bank if m == last else np.int64(bank * min(part / whole, 1.0))
            share = through - given
            if share > 0:
                bulk = np.int64(share * growth + 0.5)
                add_loose(columns, cells[m], share, bulk, kind, wet)
            given = max(given, through)
