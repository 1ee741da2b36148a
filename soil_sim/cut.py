"""Swept cutting: a tool removes the soil its lower surface sweeps, weighted by area.

A column is often wider than the way a tool moves in a tick. While a tool stands in a column, the
column is therefore refined into subcolumns, each with its own height; the tool's surface is
painted into them at its poses through the tick, and the column loses the mean of what they lose.
When the tool has left, the column is whole again, at the mean of its subcolumns. So a cut takes
the same volume on a coarse grid as on a fine one, and however fast the tool moves.

While any part of the tool is in it, below where its surface was, a column is *held*: soil does
not slip into the room the tool fills.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.rows import Action, Rows
from soil_sim.columns import Columns, take_from_column
from soil_sim.refined import RefinedColumns

__all__ = ["Removed", "SweptCut", "strips_of"]

_MOST_POSES = 4096
"""Poses painted in one tick, at most; a tool that moves further than their spacing leaves gaps."""

Removed = NDArray[np.float64]
"""Soil removed from columns, shape (n, 5): flat index, volume [mm^3 bank], centroid x, y, z [m]."""


def strips_of(sweeps: Rows) -> NDArray[np.float64]:
    """The quadrilaterals between neighbouring key-point pairs of cutting tools.

    Args:
        sweeps: SWEEP rows of one tick; rows of a tool follow one another, left before right.

    Returns:
        Shape (strips, 2, 4, 3): start and end of the tick, then left k, right k, left k+1,
        right k+1 [m], map frame.
    """
    count = sweeps.size // 2
    start = np.stack([sweeps["x0"], sweeps["y0"], sweeps["z0"]], axis=-1)[: 2 * count]
    end = np.stack([sweeps["x1"], sweeps["y1"], sweeps["z1"]], axis=-1)[: 2 * count]
    pairs = np.stack([start, end], axis=0).astype(np.float64).reshape(2, count, 2, 3)
    first = sweeps[0 : 2 * count : 2]
    joined = (
        (first["source"][:-1] == first["source"][1:])
        & (first["tool"][:-1] == first["tool"][1:])
        & (first["pair"][:-1] + 1 == first["pair"][1:])
        & (first["action"][:-1] == Action.CUT)
        & (first["action"][1:] == Action.CUT)
    )
    quads = np.concatenate([pairs[:, :-1], pairs[:, 1:]], axis=2)
    return np.ascontiguousarray(quads[:, joined].transpose(1, 0, 2, 3))


class SweptCut:
    """Removes what tools sweep; remembers the columns they stand in.

    Attributes:
        held: columns a tool stands in, shape (rows, cols), uint8; shared with the slip.
    """

    def __init__(self, columns: Columns, held: NDArray[np.uint8], *, resolution: float) -> None:
        """
        Args:
            columns: the terrain this cuts.
            held: marked 1 where a tool stands.
            resolution: size of a subcolumn [m], at most; never more than the cell.
        """
        self._columns = columns
        self.held = held
        per_side = max(1, int(np.ceil(columns.grid.cell / resolution - 1e-9)))
        self._refined = RefinedColumns(columns.height.size, per_side)

    def sweep(self, strips: NDArray[np.float64]) -> Removed:
        """Cut one tick of tool motion; `release` ends the tick.

        Args:
            strips: of `strips_of`, shape (n, 2, 4, 3) [m].

        Returns:
            What was removed, per column.
        """
        grid, refined = self._columns.grid, self._refined
        refined.reserve(self._columns_under(strips))
        refined.count = _paint(
            strips,
            self._columns.arrays,
            grid.rows,
            grid.cols,
            grid.x_first,
            grid.y_first,
            grid.cell,
            refined.per_side,
            refined.arrays,
            refined.count,
            refined.tick,
        )
        removed: Removed = _take(
            self._columns.arrays, refined.arrays, refined.count, refined.per_side**2
        )
        return removed

    def release(self) -> NDArray[np.int64]:
        """End the tick: hold the columns a tool was in, make the others whole again.

        Returns:
            Flat indices of the columns the tools have left.
        """
        stay, gone = self._refined.release()
        held = self.held.reshape(-1)
        held[gone] = 0
        held[stay] = 1
        return gone

    def _columns_under(self, strips: NDArray[np.float64]) -> int:
        """Upper bound of the number of columns the strips can touch."""
        if strips.size == 0:
            return 0
        span = np.ptp(strips.reshape(-1, 3)[:, :2], axis=0) / self._columns.grid.cell + 2.0
        return int(min(np.prod(span), self._columns.height.size))


@njit(cache=True)
def _paint(  # type: ignore[no-untyped-def]
    strips, columns, rows, cols, x_first, y_first, cell, per_side, refined, count, tick
):
    """Lower subcolumns to the strips' surfaces at poses through the tick, and sum what they lose.

    Returns:
        The number of refined columns.
    """
    fine = cell / per_side
    # Soil that slipped or landed since lifts or lowers all subcolumns of its column alike.
    for slot in range(count):
        now = columns.height[refined.cells[slot]]
        shift = now - refined.mean[slot]
        if shift != 0.0:
            refined.mean[slot] = now
            for q in range(per_side * per_side):
                refined.sub[slot, q] += shift
    corner = np.empty((4, 3))
    for n in range(strips.shape[0]):
        way = 0.0
        for p in range(4):
            for axis in range(3):
                way = max(way, abs(strips[n, 1, p, axis] - strips[n, 0, p, axis]))
        poses = min(max(np.int64(np.ceil(way / (0.5 * fine))), 1), _MOST_POSES)
        for s in range(1, poses + 1):
            t = s / poses
            for p in range(4):
                for axis in range(3):
                    corner[p, axis] = (1 - t) * strips[n, 0, p, axis] + t * strips[n, 1, p, axis]
            # left k, right k, left k+1; then right k, right k+1, left k+1
            for a, b, c in ((0, 1, 2), (1, 3, 2)):
                count = _paint_triangle(
                    corner[a],
                    corner[b],
                    corner[c],
                    columns,
                    rows,
                    cols,
                    x_first,
                    y_first,
                    per_side,
                    fine,
                    refined,
                    count,
                    tick,
                )
    return count


@njit(cache=True)
def _paint_triangle(  # type: ignore[no-untyped-def]
    a, b, c, columns, rows, cols, x_first, y_first, per_side, fine, refined, count, tick
):
    """Lower the subcolumns whose centres lie under a triangle; returns the refined columns."""
    # In units of subcolumns; the centre of a column's first subcolumn is `shift` before its own.
    ua, va = (x_first - a[0]) / fine, (y_first - a[1]) / fine
    ub, vb = (x_first - b[0]) / fine, (y_first - b[1]) / fine
    uc, vc = (x_first - c[0]) / fine, (y_first - c[1]) / fine
    area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
    if abs(area) < 1e-12:
        return count
    shift = 0.5 * per_side - 0.5
    i0 = max(np.int64(np.ceil(min(ua, ub, uc) + shift)), 0)
    i1 = min(np.int64(np.floor(max(ua, ub, uc) + shift)), rows * per_side - 1)
    j0 = max(np.int64(np.ceil(min(va, vb, vc) + shift)), 0)
    j1 = min(np.int64(np.floor(max(va, vb, vc) + shift)), cols * per_side - 1)
    for fi in range(i0, i1 + 1):
        u = fi - shift
        for fj in range(j0, j1 + 1):
            v = fj - shift
            wb = ((u - ua) * (vc - va) - (uc - ua) * (v - va)) / area
            wc = ((ub - ua) * (v - va) - (u - ua) * (vb - va)) / area
            if wb < 0.0 or wc < 0.0 or wb + wc > 1.0:
                continue
            z = max(a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]), columns.floor)
            i, j = fi // per_side, fj // per_side
            k = i * cols + j
            slot = refined.slot_of[k]
            if slot < 0:
                top = columns.height[k]
                if z >= top:
                    continue
                slot = count
                count += 1
                refined.slot_of[k] = slot
                refined.cells[slot] = k
                refined.mean[slot] = top
                refined.top[slot] = top
                refined.sub[slot, :] = top
                refined.removed[slot, :] = 0.0
            if z <= refined.top[slot]:
                refined.seen[slot] = tick
            q = (fi - i * per_side) * per_side + fj - j * per_side
            lost = refined.sub[slot, q] - z
            if lost > 0.0:
                refined.sub[slot, q] = z
                refined.removed[slot, 0] += lost
                refined.removed[slot, 1] += lost * (x_first - u * fine)
                refined.removed[slot, 2] += lost * (y_first - v * fine)
                refined.removed[slot, 3] += lost * (z + 0.5 * lost)
    return count


@njit(cache=True)
def _take(columns, refined, count, parts):  # type: ignore[no-untyped-def]
    """Take the painted removal out of the columns, as whole mm^3 of bank volume."""
    cells, sub, mean, removed = refined.cells, refined.sub, refined.mean, refined.removed
    out = np.empty((count, 5))
    n = 0
    for slot in range(count):
        if removed[slot, 0] <= 0.0:
            continue
        i = cells[slot]
        bulk = removed[slot, 0] / parts / columns.metres_per_mm3
        bank = take_from_column(columns, i, bulk)
        # What rounding left standing is spread evenly, so the subcolumns' mean stays the height.
        rounding = columns.height[i] - (mean[slot] - removed[slot, 0] / parts)
        for q in range(parts):
            sub[slot, q] += rounding
        mean[slot] = columns.height[i]
        if bank > 0:
            out[n, 0] = i
            out[n, 1] = bank
            out[n, 2] = removed[slot, 1] / removed[slot, 0]
            out[n, 3] = removed[slot, 2] / removed[slot, 0]
            out[n, 4] = removed[slot, 3] / removed[slot, 0]
            n += 1
    return out[:n]
