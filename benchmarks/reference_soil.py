"""The soil as the reference worked it (sections 3.1, 3.1.2, 3.3.1), to measure ours against.

Heights are floats on a grid. A landing adds to the four nearest grid points; what is too steep
there moves to the neighbour within r that lies lowest under the slope allowed, and from there on,
one landing after the other. Digging compares points across the bucket with the map and then looks
through the whole map. A wall that stands too steep is found by looking at every grid point of the
map again and again until none moves.

It is written to be as fast as this way of working allows, not as the reference's own program was:
compiled, the circle of neighbours counted once, recursion as a loop, no copy of the map for a
picture. It keeps no account, holds no soil off a tool, and names no changed columns.
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
"""Points between a left and right key point of the bucket (reference, section 3.3.1)."""

Floats = NDArray[np.float64]

# The kernels are not cached: a cache belongs to one name of a module, and the benchmark and the
# tests import this one under two.


class ReferenceSoil:
    """A height map that is dug, filled and slips.

    Attributes:
        grid: where each grid point stands.
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
            grid: where each grid point stands.
            heights: surface [m], shape (rows, cols); copied.
            angle: critical slope angle [rad].
            radius: r of the circle of neighbours [cells].
            tolerance: excess a collapse leaves standing, as a height in parts of a cell.
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
        """Soil above height 0 [m^3], holes counted negative."""
        return float(self.height.sum()) * self.grid.cell**2

    def deposit(self, x: Floats, y: Floats, volume: Floats) -> None:
        """Let dirt land, one piece after the other, each until it rests (CreatePile, 3.1.2).

        Args:
            x, y: landing points [m], map frame, shape (n,).
            volume: of each [m^3], shape (n,).

        Raises:
            SoilError: a point off the map or a volume below 0; nothing was changed.
        """
        if not (self.grid.contains(x, y).all() and (volume >= 0.0).all()):
            raise SoilError("dirt must land on the map and have a volume of at least 0")
        row, col = self.grid.row(x), self.grid.col(y)
        rise = volume / self.grid.cell**2
        _deposit(self.height, self.offsets, self._allowed, row, col, rise)

    def dig(self, left: Floats, right: Floats) -> float:
        """Lower the map to a bucket's key points and to points between them (3.3.1).

        Args:
            left, right: key points (x, y, z) [m] at the bucket's two ends, map frame, shape (k, 3).

        Returns:
            The volume dug [m^3].
        """
        grid = self.grid
        ends = np.stack([left, right])
        ends[..., 0], ends[..., 1] = grid.row(ends[..., 0]), grid.col(ends[..., 1])
        dug = _dig(self.height, self._low, ends[0], ends[1], POINTS_BETWEEN)
        return float(dug) * grid.cell**2

    def collapse(self) -> int:
        """Look through the whole map until no slope is steeper than allowed.

        Returns:
            How many times it was looked through.
        """
        passes = 1
        while _relax_cells(
            self.height, self.offsets, self._allowed, self._tolerance, self._stack, self._stacked
        ):
            passes += 1
        return passes

    def max_slope_excess(self) -> float:
        """Largest height [m] by which any two neighbours exceed the slope allowed; 0 if none do."""
        return float(_steepest(self.height, self.offsets, self._allowed))


def _circle(radius: float) -> NDArray[np.int64]:
    """Offsets (row, col) within `radius`, row by row, the centre left out; shape (n, 2)."""
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
    """(excess, row, col) of the neighbour that `top` at (row, col) exceeds most; 0 if none."""
    rows, cols = height.shape
    reach = -offsets[0, 0]  # the circle begins with its first row
    inside = reach <= row < rows - reach and reach <= col < cols - reach
    most = 0.0
    to_row, to_col = np.int64(-1), np.int64(-1)
    for k in range(offsets.shape[0]):
        r, c = row + offsets[k, 0], col + offsets[k, 1]
        if inside or (0 <= r < rows and 0 <= c < cols):
            excess = top - height[r, c] - allowed[k]
            if excess > most:
                most, to_row, to_col = excess, r, c
    return most, to_row, to_col


@njit
def _deposit(height, offsets, allowed, row, col, rise):  # type: ignore[no-untyped-def]
    """Share each `rise` [m] among four grid points, and let it run down from each."""
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
    """Add height at a grid point; what is too steep moves on to the lowest neighbour, and on.

    Only what was added moves. Each top lies at least one allowed step below the last: it ends.
    """
    while added > 0.0:
        top = height[row, col] + added
        excess, to_row, to_col = _lowest_neighbour(height, offsets, allowed, row, col, top)
        onward = min(excess, added)
        height[row, col] = top - onward
        row, col, added = to_row, to_col, onward


@njit
def _dig(height, low, left, right, between):  # type: ignore[no-untyped-def]
    """Lower the four grid points around each point to it; returns the height dug [m]."""
    rows, cols = height.shape
    low[:] = np.inf
    for k in range(left.shape[0]):
        for q in range(1, between + 1):
            part = q / (between + 1.0)
            row = left[k, 0] + part * (right[k, 0] - left[k, 0])
            col = left[k, 1] + part * (right[k, 1] - left[k, 1])
            z = left[k, 2] + part * (right[k, 2] - left[k, 2])
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
    """Look at every grid point once; what is too steep moves, and where it goes is looked at next.

    Half an excess moves: then neither of the two stands too steep over the other. Returns how
    often soil moved.
    """
    rows, cols = height.shape
    moves = 0
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
            moves += 1
            there = to_row * cols + to_col
            if stacked[there] == 0:  # else its turn comes anyway
                stacked[there] = 1
                stack[depth] = there
                depth += 1
    return moves


@njit
def _steepest(height, offsets, allowed):  # type: ignore[no-untyped-def]
    worst = 0.0
    for row in range(height.shape[0]):
        for col in range(height.shape[1]):
            top = height[row, col]
            excess, _, _ = _lowest_neighbour(height, offsets, allowed, row, col, top)
            worst = max(worst, excess)
    return worst
