"""Particles by place: a counting sort into cells, and who is near those that move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import kernel

__all__ = ["counting_sort_rows", "rows_in_box", "spatial_order"]


def spatial_order(state: ParticleState) -> NDArray[np.intp]:
    """Rows sorted by place, so that neighbours in space are neighbours in memory."""
    cell = 2.2 * float(state.radius.max())
    return np.asarray(
        counting_sort_rows(np.arange(state.count), state.position, cell)[0], dtype=np.intp
    )


@kernel
def rows_in_box(position, moving, margin):  # type: ignore[no-untyped-def]
    """Rows of all particles in the box of those that move, with a margin [m] around it."""
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for i in moving:
        for axis in range(3):
            low[axis] = min(low[axis], position[i, axis] - margin)
            high[axis] = max(high[axis], position[i, axis] + margin)
    rows = np.empty(position.shape[0], np.int64)
    count = 0
    for i in range(position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        rows[count] = i
        count += (
            (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
            & (z >= low[2]) & (z <= high[2])
        )  # fmt: skip
    return rows[:count]


@kernel
def counting_sort_rows(rows, position, cell):  # type: ignore[no-untyped-def]
    """Counting sort of `rows` by cell, y slowest and z fastest, one empty layer all around.

    Only the bulk (3 standard deviations about the mean) gets cells of its own; what lies beyond
    is put into the outermost ones. That keeps their number near that of the particles, and never
    parts two neighbours, as it brings cell indices only closer together.

    Returns:
        order (row at each place), start (first place of each cell), cells (cell at each place),
        sizes (cells along x, y, z).
    """
    n = rows.size
    low, shape = np.zeros(3), np.zeros(3, np.int64)
    for axis in range(3):
        total, lowest, highest = 0.0, 1e300, -1e300
        for i in rows:
            p = position[i, axis]
            total += p
            lowest, highest = min(lowest, p), max(highest, p)
        mean, spread = total / n, 0.0
        for i in rows:
            spread += (position[i, axis] - mean) ** 2
        spread = 3.0 * np.sqrt(spread / n)
        low[axis] = max(lowest, mean - spread)
        width = min(highest, mean + spread) - low[axis]
        shape[axis] = int(min(width / cell, 1e6)) + 3
    while shape[0] * shape[1] * shape[2] > 10 * n + 1000:
        for axis in range(3):
            shape[axis] = max(3, shape[axis] * 4 // 5)
    nx, ny, nz = shape[0], shape[1], shape[2]
    inverse = 1.0 / cell
    index = np.empty(n, np.int32)
    start = np.zeros(nx * ny * nz + 1, np.int32)
    for k in range(n):
        i = rows[k]
        # Clamped as floats first: a far stray must not overflow the integer.
        x = int(min(max((position[i, 0] - low[0]) * inverse + 1.0, 1.0), nx - 2.0))
        y = int(min(max((position[i, 1] - low[1]) * inverse + 1.0, 1.0), ny - 2.0))
        z = int(min(max((position[i, 2] - low[2]) * inverse + 1.0, 1.0), nz - 2.0))
        x, y, z = min(max(x, 1), nx - 2), min(max(y, 1), ny - 2), min(max(z, 1), nz - 2)
        c = (y * nx + x) * nz + z
        index[k] = c
        start[c + 1] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    place = start[:-1].copy()
    order, cells = np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(n):
        c = index[k]
        order[place[c]] = rows[k]
        cells[place[c]] = c
        place[c] += 1
    return order, start, cells, (nx, ny, nz)
