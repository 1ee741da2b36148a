"""The soil model of the 2014 reference (sections 3.1, 3.1.2, 3.3.1), as a baseline for benchmarks.

Heights are floats on a grid. A deposit adds to the four nearest grid points; material above the
allowed slope moves to the neighbour within radius r with the largest excess height, and on from
there, one deposit after the other. Digging compares points between the bucket's key points with
the map and then visits the whole map. A face that is too steep is found by visiting every grid
point of the map until no material moves.

The implementation is as fast as the method allows, faster than the reference's own program:
compiled, neighbours enumerated once, recursion replaced by a loop, no copy of the map for display.
It has no volume accounts, does not keep soil out of tools, and does not report changed columns.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError

__all__ = ["POINTS_BETWEEN", "ReferenceSoil"]

POINTS_BETWEEN = 8
"""Number of points between a left and a right key point of the bucket (section 3.3.1)."""

Floats = NDArray[np.float64]


class ReferenceSoil:
    """A height map with digging, deposition and slope failure.

    Attributes:
        grid: positions of the grid points.
        height: surface [m], shape (rows, cols).
        offsets: (row, col) of the neighbours within r, shape (n, 2).
    """

    def __init__(
        self,
        grid: Grid,
        heights: NDArray[np.floating],
        *,
        angle: float = math.radians(30.0),
        radius: float = 4.0,
        tolerance: float = 0.002,
    ) -> None:
        """
        Args:
            grid: positions of the grid points.
            heights: surface [m], shape (rows, cols); copied.
            angle: critical slope angle [rad].
            radius: radius r of the neighbourhood [cells].
            tolerance: excess height that a collapse leaves, as a fraction of the cell size.

        Raises:
            SoilError: the heights are not finite or have another shape.
        """
        if heights.shape != grid.shape or not np.isfinite(heights).all():
            raise SoilError(
                f"heights must be finite and of shape {grid.shape}, not {heights.shape}"
            )
        self.grid = grid
        self.height: Floats = np.array(heights, dtype=np.float64, order="C")
        self.offsets = _circle(radius)
        distance = np.hypot(self.offsets[:, 0], self.offsets[:, 1]) * grid.cell
        self._allowed: Floats = math.tan(angle) * distance
        self._tolerance = tolerance * grid.cell
        self._low: Floats = np.empty(grid.shape)
        self._stack: NDArray[np.int64] = np.empty(self.height.size, dtype=np.int64)
        self._stacked: NDArray[np.uint8] = np.zeros(self.height.size, dtype=np.uint8)

    @property
    def volume(self) -> float:
        """Volume above height 0 [m^3]; below 0 it counts negative."""
        return float(self.height.sum()) * self.grid.cell**2

    def deposit(self, x: Floats, y: Floats, volume: Floats) -> None:
        """Deposit volumes one after the other, each until it is at rest (CreatePile, 3.1.2).

        Args:
            x, y: positions [m], map frame, shape (n,).
            volume: volume of each deposit [m^3], shape (n,).

        Raises:
            SoilError: a position is off the map or a volume is negative; nothing was changed.
        """
        if not (self.grid.contains(x, y).all() and (volume >= 0.0).all()):
            raise SoilError("deposits must be on the map and have a volume of at least 0")
        row, col = self.grid.row(x), self.grid.col(y)
        rise = volume / self.grid.cell**2
        _deposit(self.height, self.offsets, self._allowed, row, col, rise)

    def dig(self, left: Floats, right: Floats) -> float:
        """Lower the map to points between the key points of a bucket (3.3.1).

        Args:
            left, right: key points (x, y, z) [m] of the two sides, map frame, shape (k, 3).

        Returns:
            The excavated volume [m^3].
        """
        grid = self.grid
        ends = np.stack([left, right])
        ends[..., 0], ends[..., 1] = grid.row(ends[..., 0]), grid.col(ends[..., 1])
        dug = _dig(self.height, self._low, ends[0], ends[1], POINTS_BETWEEN)
        return float(dug) * grid.cell**2

    def collapse(self) -> int:
        """Relax the whole map until no slope is steeper than allowed.

        Returns:
            The number of passes over the map.
        """
        passes = 1
        while _relax_cells(
            self.height, self.offsets, self._allowed, self._tolerance, self._stack, self._stacked
        ):
            passes += 1
        return passes

    def max_slope_excess(self) -> float:
        """Return the largest excess height [m] over the allowed slope of any two neighbours."""
        return float(_max_excess(self.height, self.offsets, self._allowed))


def _circle(radius: float) -> NDArray[np.int64]:
    """Return the offsets (row, col) within `radius` in row order, without (0, 0); shape (n, 2)."""
    reach = math.floor(radius)
    points = [
        (di, dj)
        for di in range(-reach, reach + 1)
        for dj in range(-reach, reach + 1)
        if 0 < di * di + dj * dj <= radius * radius + 1e-9
    ]
    return np.array(points, dtype=np.int64)


@njit(inline="always")
def _lowest_neighbour(height, offsets, allowed, row, col, top):  # type: ignore[no-untyped-def]
    """Return (excess, row, col) of the neighbour with the largest excess height.

    The excess is 0 if no slope from height `top` at (row, col) is steeper than allowed.
    """
    rows, cols = height.shape
    reach = -offsets[0, 0]  # the offsets are in row order
    inside = reach <= row < rows - reach and reach <= col < cols - reach
    max_excess = 0.0
    to_row, to_col = np.int64(-1), np.int64(-1)
    for k in range(offsets.shape[0]):
        r, c = row + offsets[k, 0], col + offsets[k, 1]
        if inside or (0 <= r < rows and 0 <= c < cols):
            excess = top - height[r, c] - allowed[k]
            if excess > max_excess:
                max_excess, to_row, to_col = excess, r, c
    return max_excess, to_row, to_col


@njit
def _deposit(height, offsets, allowed, row, col, rise):  # type: ignore[no-untyped-def]
    """Distribute each `rise` [m] bilinearly to four grid points, and relax each part."""
    rows, cols = height.shape
    for n in range(row.size):
        u = min(max(row[n], 0.0), rows - 1.0)
        v = min(max(col[n], 0.0), cols - 1.0)
        i, j = min(np.int64(u), rows - 2), min(np.int64(v), cols - 2)
        u -= i
        v -= j
        _run_down(height, offsets, allowed, i, j, rise[n] * (1.0 - u) * (1.0 - v))
        _run_down(height, offsets, allowed, i, j + 1, rise[n] * (1.0 - u) * v)
        _run_down(height, offsets, allowed, i + 1, j, rise[n] * u * (1.0 - v))
        _run_down(height, offsets, allowed, i + 1, j + 1, rise[n] * u * v)


@njit
def _run_down(height, offsets, allowed, row, col, added):  # type: ignore[no-untyped-def]
    """Add height at a grid point; the part above the allowed slope moves on down the slope.

    Only the added material moves. Each top is at least one allowed height difference below the
    last, so the loop ends.
    """
    while added > 0.0:
        top = height[row, col] + added
        excess, to_row, to_col = _lowest_neighbour(height, offsets, allowed, row, col, top)
        moved = min(excess, added)
        height[row, col] = top - moved
        row, col, added = to_row, to_col, moved


@njit
def _dig(height, low, left, right, between):  # type: ignore[no-untyped-def]
    """Lower the four grid points around each point to it; return the sum of the cuts [m]."""
    rows, cols = height.shape
    low[:] = np.inf
    for k in range(left.shape[0]):
        for q in range(1, between + 1):
            fraction = q / (between + 1.0)
            row = left[k, 0] + fraction * (right[k, 0] - left[k, 0])
            col = left[k, 1] + fraction * (right[k, 1] - left[k, 1])
            z = left[k, 2] + fraction * (right[k, 2] - left[k, 2])
            i, j = np.int64(math.floor(row)), np.int64(math.floor(col))
            if 0 <= i < rows - 1 and 0 <= j < cols - 1:
                for a in (i, i + 1):
                    for b in (j, j + 1):
                        low[a, b] = min(low[a, b], z)
    dug = 0.0
    for r in range(rows):
        for c in range(cols):
            if low[r, c] < height[r, c]:
                dug += height[r, c] - low[r, c]
                height[r, c] = low[r, c]
    return dug


@njit
def _relax_cells(height, offsets, allowed, tolerance, stack, stacked):  # type: ignore[no-untyped-def]
    """Visit every grid point once; material above the allowed slope moves, receivers come next.

    Half of the excess moves, after which neither point exceeds the slope to the other. Returns the
    number of moves.
    """
    rows, cols = height.shape
    num_moves = 0
    for first in range(rows * cols):
        depth = 1
        stack[0] = first
        stacked[first] = 1
        while depth > 0:
            row, col = stack[depth - 1] // cols, stack[depth - 1] % cols
            top = height[row, col]
            excess, to_row, to_col = _lowest_neighbour(height, offsets, allowed, row, col, top)
            if excess <= tolerance:
                depth -= 1
                stacked[stack[depth]] = 0
                continue
            height[row, col] -= 0.5 * excess
            height[to_row, to_col] += 0.5 * excess
            num_moves += 1
            receiver = to_row * cols + to_col
            if stacked[receiver] == 0:
                stacked[receiver] = 1
                stack[depth] = receiver
                depth += 1
    return num_moves


@njit
def _max_excess(height, offsets, allowed):  # type: ignore[no-untyped-def]
    """Return the largest excess height [m] of the map; 0 if no slope is too steep."""
    max_excess = 0.0
    for row in range(height.shape[0]):
        for col in range(height.shape[1]):
            top = height[row, col]
            excess, _, _ = _lowest_neighbour(height, offsets, allowed, row, col, top)
            max_excess = max(max_excess, excess)
    return max_excess
