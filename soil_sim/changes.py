"""What a tick changed: which columns, by how much, and what their surface looks like now.

Changed is a column whose firm or loose volume, or the room it takes, or what its surface is of, is
another than a tick ago: not one that gave what it got. Where loose soil came to lie there is dirt,
except on ground that was as steep as it can be, from which it only passes (reference, section
3.1.2, step 4). Where firm soil went and none lies on it, it was laid bare.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns import Columns, Material
from soil_sim.jit import helper, kernel

__all__ = ["Changed", "Changes"]

_THIN = 0.005
"""Depth of loose soil that leaves firm soil visible [m]."""

_FILM = 0.0005
"""Depth of loose soil that is a stain, not soil that came to lie [m]."""

_AT_LIMIT = 0.99
"""Part of the steepest slope from which ground counts as being as steep as it can be."""

_DUG, _DIRT = int(Material.DUG), int(Material.DIRT)


class Changed(NamedTuple):
    """Columns that a tick changed.

    Attributes:
        cells: flat indices of those that changed, in row-major order.
        touched: those, then those that gave what they got.
        grown: by how much the bank volume of each of `touched` grew [mm^3].
    """

    cells: NDArray[np.int64]
    touched: NDArray[np.int64]
    grown: NDArray[np.int64]


class Changes:
    """Compares a terrain with what it was when last asked."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        # What is known of a column lies together, as it is asked for.
        self._known = np.stack([layer.reshape(-1) for layer in self._layers()], axis=-1)

    def take(self) -> Changed:
        """What changed since the last call; the `material` of these columns follows."""
        columns = self._columns
        touched = columns.take_touched()
        if touched.size == 0:
            return Changed(touched, touched, touched)
        touched.sort()
        grown = np.empty_like(touched)
        count = _compare(
            columns.arrays,
            columns.tables.slope,
            columns.grid.rows,
            columns.grid.cols,
            columns.grid.cell,
            touched,
            grown,
            self._known,
            columns.material.reshape(-1),
        )
        return Changed(touched[:count], touched, grown)

    def _layers(self) -> tuple[NDArray[np.int64], ...]:
        columns = self._columns
        surface = columns.top_soil.astype(np.int64) << 8 | columns.top_moisture
        return columns.firm, columns.loose, columns.bulk, surface


@kernel()
def _compare(columns, slope, rows, cols, cell, touched, grown, known, material):  # type: ignore[no-untyped-def]
    """Move those that changed to the front of `touched`; returns how many there are."""
    firm, loose, bulk = columns.firm, columns.loose, columns.bulk
    count = 0
    for n in range(touched.size):
        i = touched[n]
        same = firm[i] == known[i, 0] and loose[i] == known[i, 1] and bulk[i] == known[i, 2]
        if not (same and _surface(columns, i) == known[i, 3]):
            touched[n], touched[count] = touched[count], i
            count += 1
    for n in range(count):
        i = touched[n]
        bare = firm[i] < known[i, 0] and bulk[i] * columns.metres_per_mm3 < _THIN
        if bare:  # what came, too: ground that was dug keeps no thin cover
            material[i] = _DUG
            continue
        came = loose[i] > known[i, 1] and bulk[i] * columns.metres_per_mm3 > _FILM
        if came and not _was_steep(columns, slope, rows, cols, cell, known, i):
            material[i] = _DIRT
    for n in range(touched.size):
        i = touched[n]
        grown[n] = firm[i] + loose[i] - known[i, 0] - known[i, 1]
    for n in range(count):
        i = touched[n]
        known[i, 0], known[i, 1], known[i, 2] = firm[i], loose[i], bulk[i]
        known[i, 3] = _surface(columns, i)
    return count


@helper(inline="always")
def _surface(columns, i):  # type: ignore[no-untyped-def]
    """Id and moisture of what the surface of a column is of, in one number."""
    if columns.loose[i] > 0:
        return np.int64(columns.loose_soil[i]) << 8 | np.int64(columns.loose_moisture[i])
    return np.int64(columns.soil[i]) << 8 | np.int64(columns.moisture[i])


@helper()
def _was_steep(columns, slope, rows, cols, cell, known, i):  # type: ignore[no-untyped-def]
    """Whether a column was at its angle of repose against one of its four neighbours."""
    tangent = slope[columns.soil[i], columns.moisture[i]]
    if columns.loose[i] > 0:
        tangent = slope[columns.loose_soil[i], columns.loose_moisture[i]]
    most = _AT_LIMIT * tangent * cell / columns.metres_per_mm3
    room = known[i, 0] + known[i, 2]
    row, col = i // cols, i % cols
    for r, c in ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)):
        if 0 <= r < rows and 0 <= c < cols:
            j = r * cols + c
            if room - known[j, 0] - known[j, 2] > most:
                return True
    return False
