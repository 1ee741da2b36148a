"""The terrain's state: how much soil stands in every column.

A column holds *firm* soil (undisturbed, bank volume) and *loose* soil on top of it. Both are kept
as whole mm^3 of bank volume, so that the account of the terrain is an integer; loose soil takes
`1 + swell` times its bank volume of room, which shows in the height alone::

    height = floor + (firm + loose * (1 + swell)) / cell area

The floor lies `dig_depth` below the lowest point of the map and cannot be dug.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError

__all__ = ["ColumnArrays", "Columns", "raise_column", "settle_height", "take_from_column"]

_LARGEST_COLUMN_MM3 = 2**52
"""Above this a column's volume would not survive the float64 field of a message."""

_LARGEST_MAP_MM3 = 2**62
"""Above this the terrain's volume, and what lands on it, would not be safe in an int64."""


class Columns:
    """Firm and loose soil of every column, and the height they reach.

    Attributes:
        grid: where each column stands.
        floor: height of the undiggable floor [m].
        swell: growth of soil when loosened, a fraction of its bank volume.
        firm: undisturbed soil [mm^3 bank], shape (rows, cols), int64.
        loose: disturbed soil [mm^3 bank], shape (rows, cols), int64.
        height: surface [m], shape (rows, cols), float64; follows firm and loose.
    """

    def __init__(
        self, grid: Grid, heights: NDArray[np.floating], *, dig_depth: float, swell: float
    ) -> None:
        """All soil firm, its surface at `heights` [m], shape (rows, cols)."""
        if heights.shape != grid.shape or not np.isfinite(heights).all():
            raise SoilError(
                f"heights must be finite and of shape {grid.shape}, not {heights.shape}"
            )
        self.grid = grid
        self.swell = swell
        self.floor = float(heights.min()) - dig_depth
        bulk = (np.asarray(heights, dtype=np.float64) - self.floor) / self.metres_per_mm3
        if bulk.max() > _LARGEST_COLUMN_MM3:
            raise SoilError("a column holds more than 2**52 mm^3; use smaller cells or dig_depth")
        if bulk.sum() > _LARGEST_MAP_MM3:
            raise SoilError(
                f"the map holds {bulk.sum() / 1e9:.3g} m^3 of soil and the account of it goes to "
                f"{_LARGEST_MAP_MM3 / 1e9:.3g} m^3; use a smaller dig_depth, cell or map"
            )
        self.firm: NDArray[np.int64] = np.rint(bulk).astype(np.int64)
        self.loose: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.height: NDArray[np.float64] = np.asarray(
            self.floor + self.firm * self.metres_per_mm3, dtype=np.float64
        )
        # A flag and a list, so that a tick costs what it touched and not what the map holds.
        self._flags: NDArray[np.uint8] = np.zeros(self.height.size, dtype=np.uint8)
        self._touched: NDArray[np.int64] = np.zeros(self.height.size + 1, dtype=np.int64)
        self._known = np.stack([self.firm.reshape(-1), self.loose.reshape(-1)])

    @property
    def arrays(self) -> ColumnArrays:
        """Flat views for kernels; what they write is written here."""
        return ColumnArrays(
            self.firm.reshape(-1),
            self.loose.reshape(-1),
            self.height.reshape(-1),
            self._flags,
            self._touched,
            self.metres_per_mm3,
            self.swell,
            self.floor,
        )

    @property
    def metres_per_mm3(self) -> float:
        """Rise of a column's surface for one mm^3 of bulk volume [m]."""
        return 1e-3 / self.grid.cell_area_mm2

    @property
    def total_mm3(self) -> int:
        """Bank volume of all columns above the floor [mm^3], counted anew."""
        return int(self.firm.sum()) + int(self.loose.sum())

    @property
    def loose_depth(self) -> NDArray[np.float64]:
        """Depth of loose soil [m], shape (rows, cols)."""
        depth = self.loose * ((1.0 + self.swell) * self.metres_per_mm3)
        return np.asarray(depth, dtype=np.float64)

    def volume(self, rows: NDArray[np.integer], cols: NDArray[np.integer]) -> NDArray[np.int64]:
        """Bank volume of the given columns [mm^3]."""
        volume: NDArray[np.int64] = self.firm[rows, cols] + self.loose[rows, cols]
        return volume

    def take_changed(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(rows, cols) of the columns changed since the last call, in row-major order.

        Changed is a column whose firm or loose volume is another than then: not one that gave what
        it got.
        """
        touched = np.sort(self._touched[1 : 1 + self._touched[0]])
        self._flags[touched] = 0
        self._touched[0] = 0
        now = np.stack([self.firm.reshape(-1)[touched], self.loose.reshape(-1)[touched]])
        changed = touched[(now != self._known[:, touched]).any(axis=0)]
        self._known[:, touched] = now
        rows, cols = np.divmod(changed, self.grid.cols)
        return rows.astype(np.intp), cols.astype(np.intp)


class ColumnArrays(NamedTuple):
    """What kernels need of the terrain, flat: arrays and scalars of `Columns` under one name.

    Attributes:
        firm, loose: bank volume [mm^3], int64.
        height: surface [m], float64.
        flags: 1 where a column was touched, uint8.
        touched: their number, then their indices, int64.
        metres_per_mm3, swell, floor: as in `Columns`.
    """

    firm: NDArray[np.int64]
    loose: NDArray[np.int64]
    height: NDArray[np.float64]
    flags: NDArray[np.uint8]
    touched: NDArray[np.int64]
    metres_per_mm3: float
    swell: float
    floor: float


@njit(cache=True, inline="always")
def settle_height(columns, i):  # type: ignore[no-untyped-def]
    """Let the surface of the column with flat index i follow its volumes, and note the column."""
    room = columns.firm[i] + columns.loose[i] * (1.0 + columns.swell)
    columns.height[i] = columns.floor + room * columns.metres_per_mm3
    if columns.flags[i] == 0:
        columns.flags[i] = 1
        columns.touched[0] += 1
        columns.touched[columns.touched[0]] = i


@njit(cache=True, inline="always")
def raise_column(columns, i, bank):  # type: ignore[no-untyped-def]
    """Add `bank` mm^3 of loose soil to the column with flat index i."""
    columns.loose[i] += bank
    settle_height(columns, i)


@njit(cache=True, inline="always")
def take_from_column(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Lower the column with flat index i by `bulk` mm^3 of room, loose soil first.

    Returns:
        The bank volume taken [mm^3], a whole number; never more than the column holds.
    """
    growth = 1.0 + columns.swell
    from_loose = min(np.int64(bulk / growth + 0.5), columns.loose[i])
    rest = bulk - from_loose * growth
    from_firm = np.int64(0)
    if from_loose == columns.loose[i] and rest > 0.5:
        from_firm = min(np.int64(rest + 0.5), columns.firm[i])
    if from_loose + from_firm > 0:
        columns.loose[i] -= from_loose
        columns.firm[i] -= from_firm
        settle_height(columns, i)
    return from_loose + from_firm
