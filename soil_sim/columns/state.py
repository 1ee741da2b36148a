"""Volumes, kinds and moistures of the soil of every column.

A column holds *firm* soil (undisturbed, bank volume) and *loose* soil on top of it. Both are kept
as whole mm^3 of bank volume, so that the volume of the terrain is an exact integer. Loose soil
occupies more space, its *bulk* volume, also kept as whole mm^3: (1 + swell) times its bank volume
when it is loosened, less after compaction. The bulk volume determines the height only::

    height = floor + (firm - packing + bulk) / cell area

Firm soil that tracks press down is *packed*: it is denser by the shrinkage of its kind, which is
the same in all packed soil of a kind. A deeper rut is of a thicker packed layer, which begins at
the top of the firm soil. `packing` is the volume that the column lost by it; no soil moves.

The kind and moisture of the firm soil of a column never change. The loose soil of a column has the
kind of the larger part of it: when soil of other kinds comes to be more than half, the kind is that
of the soil added last. Its moisture is the mean by volume of the soil that was added. The floor
lies `soil_depth` below the lowest point of the map and cannot be dug.

Moistures are whole per cents. A mean between two of them is rounded stochastically, up with a
probability equal to its fraction (`soil_sim.columns.operations.stochastic_round`): rounded to the
nearest, any number of thin layers would never wet deep soil, and their water would be lost.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import BoxedTable, box_table
from soil_sim.columns.grid_frame import GridFrame, grid_frame
from soil_sim.errors import SoilError
from soil_sim.soils.soil_types import SoilTables

__all__ = ["ColumnArrays", "Columns", "SurfaceMaterial"]

_MAX_COLUMN_MM3 = 2**52
"""Largest volume of a column: float64 fields of messages represent it exactly [mm^3]."""

_MAX_MAP_MM3 = 2**62
"""Largest volume of the terrain: with the soil deposited on it, it fits into an int64 [mm^3]."""


_STATE_LAYERS = (
    *("firm", "loose", "bulk", "height", "soil", "loose_soil", "minority_volume"),
    *("moisture", "loose_moisture", "packing", "rut_volume"),
)
"""Layers of `ColumnArrays` that are the state of the terrain."""


class SurfaceMaterial(IntEnum):
    """Appearance of the surface of a column."""

    UNDISTURBED = 0
    EXCAVATED = 1
    """Firm soil that digging exposed, or that tracks pressed down."""
    LOOSE = 2
    """Loose soil that was deposited here."""


class ColumnArrays(NamedTuple):
    """Arrays and scalars of `Columns` for kernels; layers are flat, in row-major order.

    Attributes:
        firm, loose, bulk: volumes [mm^3], int64.
        height: surface [m], float64.
        soil, loose_soil: ids of the kinds of firm and loose soil, uint8.
        minority_volume: loose soil of another kind than `loose_soil` [mm^3 bank], int64.
        moisture, loose_moisture: of firm and loose soil [%], uint8.
        packing: reduction of the volume of the firm soil by pressing [mm^3], int64.
        rut_volume: volume by which pressing lowered the surface [mm^3], int64.
        is_touched: 1 where a column was touched since `Columns.pop_touched`, uint8.
        touched: number of the touched columns, followed by their indices, int64.
        bulking_factor: bulk over bank volume of freshly loosened soil, by kind, float64.
        shrinkage: reduction of the volume of firm soil that is packed, over its bank volume, by
            kind, float64.
        metres_per_mm3: rise of the surface for one mm^3 of bulk volume [m].
        floor: height of the undiggable floor [m].
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
    packing: NDArray[np.int64]
    rut_volume: NDArray[np.int64]
    is_touched: NDArray[np.uint8]
    touched: NDArray[np.int64]
    bulking_factor: NDArray[np.float64]
    shrinkage: NDArray[np.float64]
    metres_per_mm3: float
    floor: float


class Columns:
    """Firm and loose soil of every column, and the height they reach.

    Attributes:
        grid: positions of the columns.
        frame: the same for kernels.
        floor: height of the undiggable floor [m].
        tables: properties of the kinds of soil.
        firm: undisturbed soil [mm^3 bank], shape (rows, cols), int64.
        loose: disturbed soil [mm^3 bank], shape (rows, cols), int64.
        bulk: bulk volume of the loose soil [mm^3], shape (rows, cols), int64; never less than its
            bank volume.
        soil: kind of the firm soil by id, shape (rows, cols), uint8.
        loose_soil: kind of the loose soil by id, shape (rows, cols), uint8; without meaning where
            there is no loose soil.
        moisture, loose_moisture: of firm and loose soil [% of saturation], shape (rows, cols),
            uint8.
        packing: reduction of the volume of the firm soil by pressing [mm^3], shape (rows, cols),
            int64; the soil that is packed is at its top, and its kind's shrinkage denser than bank
            soil.
        rut_volume: volume by which pressing lowered the surface [mm^3], shape (rows, cols), int64;
            soil that is added or removed since then reduces it.
        material: `SurfaceMaterial` of each column, shape (rows, cols), uint8.
        height: surface [m], shape (rows, cols), float64; computed from firm, packing and bulk.
        arrays: flat views of these layers for kernels. Write into the layers in place: a layer that
            is replaced by another array no longer belongs to the views.
        boxed_arrays: the same, boxed.
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
        """Create a terrain of firm soil.

        Args:
            grid: positions of the columns.
            heights: surface [m], shape (rows, cols).
            soil_depth: depth of the floor below the lowest height [m].
            tables: properties of the kinds of soil.
            soil: kind of each column by id, shape (rows, cols); 0 everywhere if not given.
            moisture: moisture of each column [%], shape (rows, cols); 0 everywhere if not given.

        Raises:
            SoilError: layers of a wrong shape or with invalid values, or a map too large.
        """
        if heights.shape != grid.shape or not np.isfinite(heights).all():
            raise SoilError(
                f"heights of shape {heights.shape} are given; they must be finite and of shape"
                f" {grid.shape}"
            )
        self.grid = grid
        self.frame: GridFrame = grid_frame(grid)
        self.tables = tables
        self.soil = _validated_layer("soil", soil, grid, tables.bulking_factor.size - 1)
        self.moisture = _validated_layer("moisture", moisture, grid, MOISTURE_LEVELS - 1)
        self.floor = float(heights.min()) - soil_depth
        bulk = (np.asarray(heights, dtype=np.float64) - self.floor) / self.metres_per_mm3
        if bulk.max() > _MAX_COLUMN_MM3:
            raise SoilError("a column holds more than 2**52 mm^3; use a smaller cell or soil_depth")
        if bulk.sum() > _MAX_MAP_MM3:
            raise SoilError(
                f"the map holds {bulk.sum() / 1e9:.3g} m^3 of soil, more than the limit of "
                f"{_MAX_MAP_MM3 / 1e9:.3g} m^3; use a smaller soil_depth, cell or map"
            )
        self.firm: NDArray[np.int64] = np.rint(bulk).astype(np.int64)
        self.loose: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.bulk: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.loose_soil = self.soil.copy()
        self.loose_moisture = self.moisture.copy()
        self.material = np.full(grid.shape, SurfaceMaterial.UNDISTURBED, dtype=np.uint8)
        self._minority_volume: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        # Zeros take no memory until they are written, and few sites are driven over everywhere.
        self.packing: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.rut_volume: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self.height: NDArray[np.float64] = np.asarray(
            self.floor + self.firm * self.metres_per_mm3, dtype=np.float64
        )
        # Flags and a list: the cost of a tick depends on the columns it touches, not on the map.
        self._is_touched: NDArray[np.uint8] = np.zeros(self.height.size, dtype=np.uint8)
        self._touched: NDArray[np.int64] = np.zeros(self.height.size + 1, dtype=np.int64)
        self.arrays = ColumnArrays(
            firm=self.firm.reshape(-1),
            loose=self.loose.reshape(-1),
            bulk=self.bulk.reshape(-1),
            height=self.height.reshape(-1),
            soil=self.soil.reshape(-1),
            loose_soil=self.loose_soil.reshape(-1),
            minority_volume=self._minority_volume.reshape(-1),
            moisture=self.moisture.reshape(-1),
            loose_moisture=self.loose_moisture.reshape(-1),
            packing=self.packing.reshape(-1),
            rut_volume=self.rut_volume.reshape(-1),
            is_touched=self._is_touched,
            touched=self._touched,
            bulking_factor=self.tables.bulking_factor,
            shrinkage=self.tables.shrinkage,
            metres_per_mm3=self.metres_per_mm3,
            floor=self.floor,
        )
        self.boxed_arrays: BoxedTable = box_table(self.arrays)

    @property
    def metres_per_mm3(self) -> float:
        """Rise of the surface of a column for one mm^3 of bulk volume [m]."""
        return 1e-3 / self.grid.cell_area_mm2

    @property
    def total_mm3(self) -> int:
        """Bank volume of all columns above the floor [mm^3], summed over the map."""
        return int(self.firm.sum()) + int(self.loose.sum())

    @property
    def firm_height(self) -> NDArray[np.float64]:
        """Height of the surface of the firm soil [m], shape (rows, cols), float64."""
        return np.asarray(self.floor + (self.firm - self.packing) * self.metres_per_mm3)

    @property
    def rut_depth(self) -> NDArray[np.float32]:
        """Depth by which pressing lowered the surface [m], shape (rows, cols), float32."""
        return np.asarray(self.rut_volume * self.metres_per_mm3, dtype=np.float32)

    @property
    def loose_depth(self) -> NDArray[np.float64]:
        """Depth of loose soil [m], shape (rows, cols), float64."""
        return np.asarray(self.bulk * self.metres_per_mm3, dtype=np.float64)

    @property
    def top_soil(self) -> NDArray[np.uint8]:
        """Kind of the soil at the surface by id, shape (rows, cols), uint8."""
        top: NDArray[np.uint8] = np.where(self.loose > 0, self.loose_soil, self.soil)
        return top

    @property
    def top_moisture(self) -> NDArray[np.uint8]:
        """Moisture of the soil at the surface [%], shape (rows, cols), uint8."""
        top: NDArray[np.uint8] = np.where(self.loose > 0, self.loose_moisture, self.moisture)
        return top

    def continue_from(self, other: Columns) -> None:
        """Take volumes, kinds, moistures and materials from columns of the same grid and floor.

        All columns count as touched.
        """
        for name, layer in self.arrays._asdict().items():
            if name in _STATE_LAYERS:
                layer[:] = getattr(other.arrays, name)
        self.material[:] = other.material
        self._is_touched[:] = 1
        self._touched[0] = self.height.size
        self._touched[1:] = np.arange(self.height.size)

    def pop_touched(self) -> NDArray[np.int64]:
        """Return the flat indices of the columns touched since the last call, unsorted."""
        touched = self._touched[1 : 1 + self._touched[0]].copy()
        if touched.size:
            self._is_touched[touched] = 0
            self._touched[0] = 0
        return touched


def _validated_layer(
    name: str, values: NDArray[np.integer] | None, grid: Grid, max_value: int
) -> NDArray[np.uint8]:
    """Return a layer of integers from 0 to `max_value` over the grid; zeros if not given."""
    if values is None:
        return np.zeros(grid.shape, dtype=np.uint8)
    if values.shape != grid.shape or values.min() < 0 or values.max() > max_value:
        raise SoilError(
            f"the layer {name} has shape {values.shape} and values {values.min()} to"
            f" {values.max()}; give shape {grid.shape} and values 0 to {max_value}"
        )
    return values.astype(np.uint8)
