"""Collapse: large failures, relaxed all at once.

Examining one column after the other is best for a little soil that slips, and slow where a wall
comes down: each column is examined again and again. Here a whole window of the map is swept
instead. In every direction that a neighbour can lie in, columns are taken in pairs, no column in
two pairs at a time, and the higher one gives the lower one what it has too much; direction by
direction, until nothing moves.

That is done on a copy of the heights in float32, and is only a plan of who loses and who gains
height, which is then booked in whole mm^3 (`soil_sim.slope_failure.redistribute`). So the account is as exact as
ever; what swelling and rounding leave too steep is seen to by examining the columns touched.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import Columns
from soil_sim.slope_failure.redistribute import redistribute
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.stability import stable_firm_height

__all__ = ["WindowBounds", "WindowRelaxation"]

WindowBounds = tuple[int, int, int, int]
"""A window of the map: first row, row after the last, first column, column after the last."""

_MARGIN_CELLS = 6
"""Columns around those that are disturbed which are swept, too."""

_WALL_HEIGHT = np.float32(1e6)
"""Height of what neither gives nor takes [m]."""

_INITIAL_FRACTION, _FINAL_FRACTION, _RAMP_PASSES = 0.5, 0.9, 8
"""Part of an excess that is given: half at first, more once the worst is over, after so many
sweeps. More is faster, but a tall heap would spread too wide before it slows."""


class WindowRelaxation:
    """Sweeps of a window over several calls, and what they touched.

    Attributes:
        running: whether a collapse has begun and is not at rest.
        touched: columns that waited, lost or gained, flat indices.
    """

    def __init__(self, columns: Columns, params: RelaxationParameters) -> None:
        """
        Args:
            columns: the terrain this acts on.
            rule: by which its soil slips.
        """
        self._columns, self._params = columns, params
        # Of a direction and its opposite one is enough, and of (2, 0) and (1, 0) the shorter.
        half = [
            (int(di), int(dj))
            for di, dj in params.offsets
            if math.gcd(abs(int(di)), abs(int(dj))) == 1 and (di > 0 or (di == 0 and dj > 0))
        ]
        self._directions = np.array(half, dtype=np.int64)
        self._reach = params.reach
        self._distance = (np.hypot(*self._directions.T) * columns.grid.cell).astype(np.float32)
        # (1, 0) is (4, 0) four times over: together they may be too steep by no more than it all.
        times = self._reach // np.abs(self._directions).max(axis=1)
        self._tolerances = (params.tolerance / times).astype(np.float32)
        self._active_bounds: WindowBounds | None = None
        self._num_passes = 0
        self._touched: list[NDArray[np.int64]] = []

    @property
    def is_running(self) -> bool:
        """Whether a collapse has begun and has not come to rest."""
        return self._active_bounds is not None

    @property
    def num_pending(self) -> int:
        """Columns in the window that is still being swept."""
        if self._active_bounds is None:
            return 0
        return (self._active_bounds[1] - self._active_bounds[0]) * (
            self._active_bounds[3] - self._active_bounds[2]
        )

    @property
    def num_directions(self) -> int:
        """Directions in which pairs are relaxed in a sweep."""
        return int(self._directions.shape[0])

    def bounds_including(self, cells: NDArray[np.int64]) -> WindowBounds:
        """The window that disturbed columns (flat indices), those around them and a running
        collapse lie in."""
        own = self._active_bounds
        if cells.size == 0:
            assert own is not None, "somewhere there is something to sweep"
            return own
        bounds = self._clipped(self._bounds(cells))
        return bounds if own is None else _union(bounds, own)

    def is_supported(self, bounds: WindowBounds) -> bool:
        """Whether a window is all of one kind of soil at one angle, as sweeping needs it."""
        columns = self._columns
        return bool(
            _is_uniform(columns.arrays, columns.tables.repose_tan, columns.grid.cols, *bounds)
        )

    def relax(
        self,
        bounds: WindowBounds,
        waiting: NDArray[np.int64],
        occupied: NDArray[np.uint8],
        max_passes: int,
    ) -> bool:
        """Sweep a window at most `most` times; goes on where the last call ended.

        Args:
            box: of `bounds_including`.
            waiting: columns (flat indices) to be examined if not by sweeping: only that sees a
                step down beyond a neighbour that stands.
            held: columns that neither give nor take, shape (rows, cols).
            most: number of sweeps.

        Returns:
            Whether all of it is at rest; `pop_touched` then tells what to examine.
        """
        if self._active_bounds is None:
            self._num_passes = 0
        columns = self._columns
        start, floor = self._copy_heights(bounds, occupied)
        tall = start.shape[0] > start.shape[1]
        if tall:  # long rows are quicker; the directions are the same
            start, floor = np.ascontiguousarray(start.T), np.ascontiguousarray(floor.T)
        plan = start.copy()
        repose_tan = columns.tables.repose_tan[
            columns.top_soil[bounds[0], bounds[2]], columns.top_moisture[bounds[0], bounds[2]]
        ]
        limits = (repose_tan * self._distance).astype(np.float32)
        done = 0
        moved = True
        while moved and done < max_passes:
            part = _INITIAL_FRACTION + (_FINAL_FRACTION - _INITIAL_FRACTION) * min(
                self._num_passes / _RAMP_PASSES, 1.0
            )
            moved = bool(
                _relax_pass(
                    plan.reshape(-1),
                    floor.reshape(-1),
                    plan.shape[1],
                    self._directions,
                    limits,
                    self._tolerances,
                    np.float32(part),
                    self._num_passes % 2 == 1,
                )
            )
            self._num_passes += 1
            done += 1
        change = (plan - start).astype(np.float64)
        change = np.ascontiguousarray(change.T) if tall else change
        cells = redistribute(columns, (bounds[0], bounds[2]), change, self._reach)
        self._touched += [cells, waiting]
        # What has not moved is at rest, but for what lies around that which has.
        self._active_bounds = self._clipped(self._bounds(cells)) if moved and cells.size else None
        return self._active_bounds is None

    def pop_touched(self) -> NDArray[np.int64]:
        """Flat indices of all columns to be examined now: near those that waited, lost or gained.

        A collapse that is still running is ended, and all columns of its window are among them.
        """
        parts = self._touched.copy()
        if self._active_bounds is not None:
            rows, cols = np.arange(*self._active_bounds[:2]), np.arange(*self._active_bounds[2:])
            parts.append((rows[:, None] * self._columns.grid.cols + cols).reshape(-1))
        self._touched.clear()
        self._active_bounds = None
        cells = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
        if cells.size == 0:
            return cells
        top, _, left, _ = bounds = self._clipped(self._bounds(cells))
        rows, cols = np.divmod(cells, self._columns.grid.cols)
        far = np.ones((bounds[1] - bounds[0], bounds[3] - bounds[2]), dtype=np.uint8)
        far[rows - top, cols - left] = 0
        near_rows, near_cols = np.nonzero(_window_min(far, self._reach) == 0)
        return (near_rows + top) * self._columns.grid.cols + near_cols + left

    def _copy_heights(
        self, bounds: WindowBounds, occupied: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Heights in a window over its lowest, and those below which a column cannot give [m].

        That is its firm soil, as far as it stands.
        """
        columns, window = self._columns, _slices(bounds)
        heights = columns.height[window]
        lowest = float(heights.min())
        plan = (heights - lowest).astype(np.float32)
        floor = np.empty_like(plan)
        _firm_floor(columns.arrays, self._params, occupied.reshape(-1), bounds, lowest, floor)
        # One that is held is a wall: as high as none, it takes nothing, and has nothing to give.
        fixed = occupied[window] != 0
        plan[fixed] = floor[fixed] = _WALL_HEIGHT
        return plan, floor

    def _bounds(self, cells: NDArray[np.int64]) -> WindowBounds:
        rows, cols = np.divmod(cells, self._columns.grid.cols)
        return (int(rows.min()), int(rows.max()) + 1, int(cols.min()), int(cols.max()) + 1)

    def _clipped(self, bounds: WindowBounds) -> WindowBounds:
        margin, (rows, cols) = _MARGIN_CELLS + self._reach, self._columns.grid.shape
        return (
            max(bounds[0] - margin, 0),
            min(bounds[1] + margin, rows),
            max(bounds[2] - margin, 0),
            min(bounds[3] + margin, cols),
        )


def _slices(bounds: WindowBounds) -> tuple[slice, slice]:
    return slice(bounds[0], bounds[1]), slice(bounds[2], bounds[3])


def _union(a: WindowBounds, b: WindowBounds) -> WindowBounds:
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])


def _window_min(values: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
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


@kernel
def _firm_floor(columns, params, occupied, bounds, lowest, floor):  # type: ignore[no-untyped-def]
    """Heights over `lowest` [m] to which the firm soil of a window stands, into `floor`."""
    row, _, col, _ = bounds
    kind = columns.soil[row * params.cols + col]  # the window is all of one
    near = params.stability.neighbour_height
    coheres = False
    for moisture in range(near.shape[1]):
        coheres |= near[kind, moisture, 0] > 0.0
    for r in range(floor.shape[0]):
        for c in range(floor.shape[1]):
            i = (row + r) * params.cols + col + c
            stands = stable_firm_height(columns, params, occupied, i) if coheres else columns.floor
            floor[r, c] = stands - lowest


@helper(forceinline=True)
def _transfer(drop, spare_a, spare_b, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """What one of a pair gives the other [m], from a to b; without a branch."""
    none = np.float32(0.0)
    spare = spare_a if drop > none else spare_b
    excess = abs(drop) - limit
    give = part * excess
    give = spare if spare < give else give
    give = give if excess > tolerance else none
    give = give if give > none else none
    return give if drop > none else -give


@helper(forceinline=True)
def _relax_pairs(plan, floor, a, b, stride, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax `count` pairs, a with b, a + stride with b + stride ...; returns whether any moved.

    Unsigned indices into flat arrays, so that it is compiled to vector instructions.
    """
    moved = np.int32(0)
    for n in range(count):
        x, y = a + n * stride, b + n * stride
        high, low = plan[x], plan[y]
        give = _transfer(high - low, high - floor[x], low - floor[y], limit, tolerance, part)
        moved |= np.int32(give != np.float32(0.0))
        plan[x] = high - give
        plan[y] = low + give
    return moved


@helper
def _relax_rows(plan, floor, a, b, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax the pairs of two rows, that begin at a and b."""
    return _relax_pairs(plan, floor, a, b, np.uint64(1), count, limit, tolerance, part)


@helper
def _relax_row(plan, floor, a, count, limit, tolerance, part):  # type: ignore[no-untyped-def]
    """Relax the pairs of neighbours in a row, a with a + 1, a + 2 with a + 3 ..."""
    b, two = a + np.uint64(1), np.uint64(2)
    return _relax_pairs(plan, floor, a, b, two, count, limit, tolerance, part)


@kernel
def _relax_pass(plan, floor, cols, steps, limits, tolerances, part, backward):  # type: ignore[no-untyped-def]
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
        params = (limits[k], tolerances[k], part)
        # No column is in two pairs at a time: half of the pairs, then the other half.
        for half in range(2):
            for i in range(rows - di):
                a = np.uint64(i * cols + first)
                if di == 0:
                    pairs = np.uint64((cols - half) // 2)
                    moved |= _relax_row(plan, floor, a + np.uint64(half), pairs, *params)
                elif (i // di) % 2 == half:
                    b = np.uint64((i + di) * cols + first + dj)
                    moved |= _relax_rows(plan, floor, a, b, np.uint64(last - first), *params)
    return moved


@kernel
def _is_uniform(columns, repose_tan, cols, row, row_end, col, col_end):  # type: ignore[no-untyped-def]
    """Whether all columns of a window are of one soil, and loose and firm soil as steep."""
    kind, moisture = columns.soil[row * cols + col], columns.moisture[row * cols + col]
    tangent = repose_tan[kind, moisture]
    for r in range(row, row_end):
        for i in range(r * cols + col, r * cols + col_end):
            if columns.soil[i] != kind or repose_tan[kind, columns.moisture[i]] != tangent:
                return False
            if columns.loose[i] > 0 and (
                columns.loose_soil[i] != kind
                or repose_tan[kind, columns.loose_moisture[i]] != tangent
            ):
                return False
    return True
