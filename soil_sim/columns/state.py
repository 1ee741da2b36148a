"""The terrain's state: how much soil stands in every column, of which kind, and how moist.

A column holds *firm* soil (undisturbed, bank volume) and *loose* soil on top of it. Both are kept
as whole mm^3 of bank volume, so that the account of the terrain is an integer. Loose soil takes
more room than that, its *bulk*, kept as whole mm^3 too: 1 + swell times its bank volume when it is
loosened, less once it is packed. It shows in the height alone::

    height = floor + (firm + bulk) / cell area

The firm soil of a column is of one kind and moisture for ever. Its loose soil is of the kind that
most of it is; when others come to be more than half, it is of the kind that came last. Its moisture
mixes by volume with that of what comes. The floor lies `soil_depth` below the lowest point of the
map and cannot be dug.

Moistures are whole per cents. A mean between two of them becomes the upper one as often as it is
near it (`stochastic_round`): rounded to the nearest, thin layers would never wet deep soil, however
many came, and their water would be gone.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import helper, kernel
from soil_sim.errors import SoilError
from soil_sim.soils.soil_types import SoilTables

__all__ = [
    "ColumnArrays",
    "Columns",
    "SurfaceMaterial",
    "add_loose",
    "compact_column",
    "mix_moisture",
    "remove_from_column",
    "remove_loose",
    "stochastic_round",
    "update_height",
]

_MAX_COLUMN_MM3 = 2**52
"""Above this a column's volume would not survive the float64 field of a message."""

_MAX_MAP_MM3 = 2**62
"""Above this the terrain's volume, and what lands on it, would not be safe in an int64."""


class SurfaceMaterial(IntEnum):
    """What a column's surface looks like."""

    UNDISTURBED = 0
    EXCAVATED = 1
    """Firm soil that was laid bare."""
    LOOSE = 2
    """Loose soil that came to lie here."""


class Columns:
    """Firm and loose soil of every column, and the height they reach.

    Attributes:
        grid: where each column stands.
        floor: height of the undiggable floor [m].
        tables: of the kinds of soil.
        firm: undisturbed soil [mm^3 bank], shape (rows, cols), int64.
        loose: disturbed soil [mm^3 bank], shape (rows, cols), int64.
        bulk: the room that takes [mm^3], likewise; never less than its bank volume.
        soil: id of the firm soil, shape (rows, cols), uint8.
        loose_soil: id of the loose soil, likewise; without meaning where there is none.
        moisture, loose_moisture: of firm and loose soil [% of saturation], likewise.
        material: `Material` of the surface, likewise.
        height: surface [m], shape (rows, cols), float64; follows firm and bulk.
        arrays: flat views of all these for kernels; what they write is written here. So layers are
            written into, never put another in place of.
    """

    def __init__(
        self,
        grid: Grid,
        heights: NDArray[np.floating],
        *,
        soil_depth: float,
        tables: SoilTables,
        soil: NDArray[np.integer] | None = None,
        moisture: NDArray[np.integer] | None = None,
    ) -> None:
        """All soil firm.

        Args:
            grid: where each column stands.
            heights: surface [m], shape (rows, cols).
            soil_depth: of the floor below the lowest height [m].
            tables: of the kinds of soil.
            soil: id of each column's soil, shape (rows, cols); 0 everywhere if not given.
            moisture: of each column [%], likewise.

        Raises:
            SoilError: layers of another shape or with values that cannot be, or a map too large.
        """
        if heights.shape != grid.shape or not np.isfinite(heights).all():
            raise SoilError(
                f"heights must be finite and of shape {grid.shape}, not {heights.shape}"
            )
        self.grid = grid
        self.tables = tables
        self.soil = _validated_layer("soil", soil, grid, tables.bulking_factor.size - 1)
        self.moisture = _validated_layer("moisture", moisture, grid, MOISTURE_LEVELS - 1)
        self.floor = float(heights.min()) - soil_depth
        bulk = (np.asarray(heights, dtype=np.float64) - self.floor) / self.metres_per_mm3
        if bulk.max() > _MAX_COLUMN_MM3:
            raise SoilError("a column holds more than 2**52 mm^3; use smaller cells or soil_depth")
        if bulk.sum() > _MAX_MAP_MM3:
            raise SoilError(
                f"the map holds {bulk.sum() / 1e9:.3g} m^3 of soil and the account of it goes to "
                f"{_MAX_MAP_MM3 / 1e9:.3g} m^3; use a smaller soil_depth, cell or map"
            )
        self.firm: NDArray[np.int64] = np.rint(bulk).astype(np.int64)
        self.loose: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.bulk: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.loose_soil = self.soil.copy()
        self.loose_moisture = self.moisture.copy()
        self.material = np.full(grid.shape, SurfaceMaterial.UNDISTURBED, dtype=np.uint8)
        self._minority_volume: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.height: NDArray[np.float64] = np.asarray(
            self.floor + self.firm * self.metres_per_mm3, dtype=np.float64
        )
        # A flag and a list, so that a tick costs what it touched and not what the map holds.
        self._is_touched: NDArray[np.uint8] = np.zeros(self.height.size, dtype=np.uint8)
        self._touched: NDArray[np.int64] = np.zeros(self.height.size + 1, dtype=np.int64)
        self.arrays = ColumnArrays(
            self.firm.reshape(-1),
            self.loose.reshape(-1),
            self.bulk.reshape(-1),
            self.height.reshape(-1),
            self.soil.reshape(-1),
            self.loose_soil.reshape(-1),
            self._minority_volume.reshape(-1),
            self.moisture.reshape(-1),
            self.loose_moisture.reshape(-1),
            self._is_touched,
            self._touched,
            self.tables.bulking_factor,
            self.metres_per_mm3,
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
        return np.asarray(self.bulk * self.metres_per_mm3, dtype=np.float64)

    @property
    def top_soil(self) -> NDArray[np.uint8]:
        """Id of the soil at the surface, shape (rows, cols)."""
        top: NDArray[np.uint8] = np.where(self.loose > 0, self.loose_soil, self.soil)
        return top

    @property
    def top_moisture(self) -> NDArray[np.uint8]:
        """Moisture of the soil at the surface [%], shape (rows, cols)."""
        top: NDArray[np.uint8] = np.where(self.loose > 0, self.loose_moisture, self.moisture)
        return top

    def pop_touched(self) -> NDArray[np.int64]:
        """Flat indices of the columns touched since the last call, in no order."""
        touched = self._touched[1 : 1 + self._touched[0]].copy()
        self._is_touched[touched] = 0
        self._touched[0] = 0
        return touched


class ColumnArrays(NamedTuple):
    """What kernels need of the terrain, flat: arrays and scalars of `Columns` under one name.

    Attributes:
        firm, loose, bulk: volumes [mm^3], int64.
        height: surface [m], float64.
        soil, loose_soil: ids, uint8.
        minority_volume: loose soil of another kind than the column's [mm^3 bank], int64.
        moisture, loose_moisture: of firm and loose soil [%], uint8.
        flags: 1 where a column was touched, uint8.
        touched: their number, then their indices, int64.
        growth: bulk over bank volume of loosened soil, by id.
        metres_per_mm3, floor: as in `Columns`.
    """

    firm: NDArray[np.int64]
    loose: NDArray[np.int64]
    bulk: NDArray[np.int64]
    height: NDArray[np.float64]
    soil: NDArray[np.uint8]
    loose_soil: NDArray[np.uint8]
    minority_volume: NDArray[np.int64]
    moisture: NDArray[np.uint8]
    loose_moisture: NDArray[np.uint8]
    is_touched: NDArray[np.uint8]
    touched: NDArray[np.int64]
    bulking_factor: NDArray[np.float64]
    metres_per_mm3: float
    floor: float


@helper(forceinline=True)
def update_height(columns, i):  # type: ignore[no-untyped-def]
    """Let the surface of the column with flat index i follow its volumes, and note the column."""
    room = columns.firm[i] + columns.bulk[i]
    columns.height[i] = columns.floor + room * columns.metres_per_mm3
    if columns.is_touched[i] == 0:
        columns.is_touched[i] = 1
        columns.touched[0] += 1
        columns.touched[columns.touched[0]] = i


@helper(forceinline=True)
def stochastic_round(x, key):  # type: ignore[no-untyped-def]
    """The whole per cent below or above a mean moisture [%], the latter as often as it is nearer.

    `lot`, a whole number that differs from case to case, decides; equal ones decide alike.
    """
    slack = 1e-9  # for what sums of large volumes round
    low = np.uint8(x + slack)
    bits = np.uint64(key)  # what follows makes of near numbers far ones (Steele et al., SplitMix)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    chance = ((bits ^ (bits >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
    return np.uint8(low + (chance + slack < x - low))


@kernel(forceinline=True)
def mix_moisture(bank, moisture, other_bank, other_moisture):  # type: ignore[no-untyped-def]
    """Moisture [%] of two volumes [mm^3 bank] of soil together, at least one of them above 0."""
    if other_bank == 0 or moisture == other_moisture:
        return np.uint8(moisture)
    if bank == 0:
        return np.uint8(other_moisture)
    both = bank + other_bank
    return stochastic_round((bank * moisture + other_bank * other_moisture) / both, both)


@kernel(forceinline=True)
def add_loose(columns, i, bank, bulk, soil, moisture):  # type: ignore[no-untyped-def]
    """Put `bank` mm^3 of loose soil that takes `bulk` mm^3 of room on the column with index i."""
    had = columns.loose[i]
    if had == 0:
        columns.loose_soil[i] = soil
        columns.loose_moisture[i] = moisture
        columns.minority_volume[i] = 0
    elif soil != columns.loose_soil[i]:
        columns.minority_volume[i] += bank
        if 2 * columns.minority_volume[i] > had + bank:
            columns.minority_volume[i] = had + bank - columns.minority_volume[i]
            columns.loose_soil[i] = soil
    if moisture != columns.loose_moisture[i]:
        mixed = mix_moisture(had, columns.loose_moisture[i], bank, moisture)
        columns.loose_moisture[i] = mixed
    columns.loose[i] = had + bank
    columns.bulk[i] += bulk
    update_height(columns, i)


@kernel(forceinline=True)
def remove_loose(columns, i, bank):  # type: ignore[no-untyped-def]
    """Take `bank` mm^3, at most all, of the loose soil of a column; returns the room it took."""
    had = columns.loose[i]
    bank = min(bank, had)
    if bank == had:
        bulk = columns.bulk[i]
        columns.minority_volume[i] = 0
    else:
        part = bank / had
        bulk = min(np.int64(columns.bulk[i] * part + 0.5), columns.bulk[i] - (had - bank))
        columns.minority_volume[i] -= np.int64(columns.minority_volume[i] * part)
    columns.loose[i] = had - bank
    columns.bulk[i] -= bulk
    update_height(columns, i)
    return bulk


@kernel(forceinline=True)
def remove_from_column(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Lower the column with flat index i by `bulk` mm^3 of room, loose soil first.

    Returns:
        The bank volume taken [mm^3], a whole number, of loose and of firm soil; never more than
        the column holds.
    """
    from_loose = np.int64(0)
    rest = bulk
    if columns.loose[i] > 0:
        share = bulk * (columns.loose[i] / columns.bulk[i])
        from_loose = min(np.int64(share + 0.5), columns.loose[i])
        if from_loose > 0:
            rest = bulk - remove_loose(columns, i, from_loose)
    from_firm = np.int64(0)
    if columns.loose[i] == 0 and rest > 0.5:
        from_firm = min(np.int64(rest + 0.5), columns.firm[i])
        if from_firm > 0:
            columns.firm[i] -= from_firm
            update_height(columns, i)
    return from_loose, from_firm


@kernel(forceinline=True)
def compact_column(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Press `bulk` mm^3 of room out of a column's loose soil, down to its bank volume.

    Returns:
        What was pressed out [mm^3].
    """
    pressed = min(np.int64(bulk), columns.bulk[i] - columns.loose[i])
    if pressed <= 0:
        return np.int64(0)
    columns.bulk[i] -= pressed
    update_height(columns, i)
    return pressed


def _validated_layer(
    name: str, values: NDArray[np.integer] | None, grid: Grid, max_value: int
) -> NDArray[np.uint8]:
    """A layer of whole numbers 0 to `most` over the grid; zeros if not given."""
    if values is None:
        return np.zeros(grid.shape, dtype=np.uint8)
    if values.shape != grid.shape or values.min() < 0 or values.max() > max_value:
        raise SoilError(
            f"the layer {name} is of shape {values.shape} with values {values.min()} to"
            f" {values.max()}; give shape {grid.shape} with values 0 to {max_value}"
        )
    return values.astype(np.uint8)
