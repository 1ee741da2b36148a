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

__all__ = ["Removed", "SweptCut", "strips_of"]

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
        self._per_side = max(1, int(np.ceil(columns.grid.cell / resolution - 1e-9)))
        self._slot_of = np.full(columns.height.size, -1, dtype=np.int64)
        self._cells = np.zeros(0, dtype=np.int64)
        self._seen = np.zeros(0, dtype=np.int64)
        self._sub = np.zeros((0, self._per_side**2))
        self._mean = np.zeros(0)
        self._top = np.zeros(0)  # the surface when the tool came
        self._count = 0
        self._tick = 0

    def sweep(self, strips: NDArray[np.float64]) -> Removed:
        """Cut one tick of tool motion; `release` ends the tick.

        Args:
            strips: of `strips_of`, shape (n, 2, 4, 3) [m].

        Returns:
            What was removed, per column.
        """
        c = self._columns
        self._reserve(self._columns_under(strips))
        self._count = _paint(
            strips,
            c.height.reshape(-1),
            c.grid.rows,
            c.grid.cols,
            c.grid.x_first,
            c.grid.y_first,
            c.grid.cell,
            c.floor,
            self._per_side,
            self._slot_of,
            self._cells,
            self._seen,
            self._sub,
            self._mean,
            self._top,
            self._count,
            self._tick,
            self._removed,
        )
        removed: Removed = _take(
            c.arrays,
            self._cells,
            self._removed,
            self._count,
            self._per_side**2,
            self._sub,
            self._mean,
        )
        return removed

    def _columns_under(self, strips: NDArray[np.float64]) -> int:
        """Upper bound of the number of columns the strips can touch."""
        if strips.size == 0:
            return 0
        span = np.ptp(strips.reshape(-1, 3)[:, :2], axis=0) / self._columns.grid.cell + 2.0
        return int(min(np.prod(span), self._columns.height.size))

    def _reserve(self, more: int) -> None:
        need = self._count + more
        if need > self._cells.size:
            size = max(need, 2 * self._cells.size, 256)
            self._cells = np.resize(self._cells, size)
            self._seen = np.resize(self._seen, size)
            self._mean = np.resize(self._mean, size)
            self._top = np.resize(self._top, size)
            sub = np.zeros((size, self._per_side**2))
            sub[: self._count] = self._sub[: self._count]
            self._sub = sub
        self._removed = np.zeros((self._cells.size, 4))

    def release(self) -> NDArray[np.int64]:
        """End the tick: hold the columns a tool touched in it, make the others whole again.

        Returns:
            Flat indices of the columns the tools have left.
        """
        gone = np.nonzero(self._seen[: self._count] != self._tick)[0]
        cells = self._cells[gone]
        keep = np.nonzero(self._seen[: self._count] == self._tick)[0]
        self._slot_of[cells] = -1
        self.held.reshape(-1)[cells] = 0
        self._count = keep.size
        for array in (self._cells, self._seen, self._mean, self._top, self._sub):
            array[: keep.size] = array[keep]
        self._slot_of[self._cells[: keep.size]] = np.arange(keep.size)
        self.held.reshape(-1)[self._cells[: keep.size]] = 1
        self._tick += 1
        return np.sort(cells)


@njit(cache=True)
def _paint(  # type: ignore[no-untyped-def]
    strips,
    height,
    rows,
    cols,
    x_first,
    y_first,
    cell,
    floor,
    per_side,
    slot_of,
    cells,
    seen,
    sub,
    mean,
    top,
    count,
    tick,
    removed,
):
    """Lower subcolumns to the strips' surfaces at poses through the tick.

    removed[slot] gathers the lost height of subcolumns and its first moments. Returns the count of
    refined columns.
    """
    fine = cell / per_side
    # Soil that slipped or landed since lifts or lowers all subcolumns of its column alike.
    for slot in range(count):
        shift = height[cells[slot]] - mean[slot]
        if shift != 0.0:
            mean[slot] = height[cells[slot]]
            for q in range(per_side * per_side):
                sub[slot, q] += shift
    corner = np.empty((4, 3))
    for n in range(strips.shape[0]):
        way = 0.0
        for p in range(4):
            for axis in range(3):
                way = max(way, abs(strips[n, 1, p, axis] - strips[n, 0, p, axis]))
        poses = min(max(np.int64(np.ceil(way / (0.5 * fine))), 1), 4096)
        for s in range(1, poses + 1):
            t = s / poses
            for p in range(4):
                for axis in range(3):
                    corner[p, axis] = (1 - t) * strips[n, 0, p, axis] + t * strips[n, 1, p, axis]
            for half in range(2):
                # (left k, right k, left k+1) and (right k, right k+1, left k+1)
                a = corner[half]
                b = corner[2 * half + 1]
                c = corner[2]
                # In units of subcolumns, the corner of the map's first one at 0.
                ua, va = (x_first - a[0]) / fine, (y_first - a[1]) / fine
                ub, vb = (x_first - b[0]) / fine, (y_first - b[1]) / fine
                uc, vc = (x_first - c[0]) / fine, (y_first - c[1]) / fine
                area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
                if abs(area) < 1e-12:
                    continue
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
                        z = max(a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]), floor)
                        i = fi // per_side
                        j = fj // per_side
                        k = i * cols + j
                        slot = slot_of[k]
                        if slot < 0:
                            if z >= height[k]:
                                continue
                            slot = count
                            count += 1
                            slot_of[k] = slot
                            cells[slot] = k
                            mean[slot] = height[k]
                            top[slot] = height[k]
                            for q in range(per_side * per_side):
                                sub[slot, q] = height[k]
                        q = (fi - i * per_side) * per_side + fj - j * per_side
                        if z <= top[slot]:
                            seen[slot] = tick
                        lost = sub[slot, q] - z
                        if lost > 0.0:
                            sub[slot, q] = z
                            removed[slot, 0] += lost
                            removed[slot, 1] += lost * (x_first - u * fine)
                            removed[slot, 2] += lost * (y_first - v * fine)
                            removed[slot, 3] += lost * (z + 0.5 * lost)
    return count


@njit(cache=True)
def _take(columns, cells, removed, count, parts, sub, mean):  # type: ignore[no-untyped-def]
    """Take the painted removal out of the columns, as whole mm^3 of bank volume."""
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
