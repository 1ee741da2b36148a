"""Soil properties and terrain data that force kernels read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import GRAVITY, MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import helper
from soil_sim.columns.operations import packed_depth
from soil_sim.columns.state import ColumnArrays
from soil_sim.soils.soil_types import SoilType

__all__ = [
    "STRENGTH_DTYPE",
    "ForceColumns",
    "ForceGround",
    "GridLayout",
    "column_index_at",
    "loose_cover",
    "packed_share",
    "strength_table",
]


class GridLayout(NamedTuple):
    """Layout of the grid of columns.

    Attributes:
        rows: number of rows.
        cols: number of columns.
        cell: side length of a cell [m].
        x_first: x of row 0 [m].
        y_first: y of column 0 [m].
    """

    rows: int
    cols: int
    cell: float
    x_first: float
    y_first: float

    @classmethod
    def from_grid(cls, grid: Grid) -> GridLayout:
        """Return the layout of a grid."""
        return cls(grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first)


class ForceColumns(NamedTuple):
    """The arrays of `ColumnArrays` that force kernels read.

    It has no others, because the compile time of a kernel grows with each array argument.
    """

    loose: NDArray[np.int64]
    bulk: NDArray[np.int64]
    height: NDArray[np.float64]
    soil: NDArray[np.uint8]
    loose_soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    packing: NDArray[np.int64]
    rut_volume: NDArray[np.int64]
    shrinkage: NDArray[np.float64]
    metres_per_mm3: float
    floor: float

    @classmethod
    def from_columns(cls, columns: ColumnArrays) -> ForceColumns:
        """Return a view that shares the arrays of the terrain."""
        return cls(*(getattr(columns, name) for name in cls._fields))


class ForceGround(NamedTuple):
    """The ground that tools move through, for force kernels.

    Attributes:
        columns: the terrain.
        grid_layout: its grid.
        strength: `strength_table` of the kinds of soil.
    """

    columns: ForceColumns
    grid_layout: GridLayout
    strength: NDArray[np.void]


STRENGTH_DTYPE = np.dtype(
    [
        ("gamma", np.float64),  # unit weight of firm soil [N/m³]
        ("phi", np.float64),  # angle of internal friction [rad]
        ("delta", np.float64),  # angle of soil-tool friction [rad]
        ("packed_strength", np.float64),  # cohesion of packed over that of bank soil [-]
        ("tensile_strength", np.float64),  # of rock [Pa], 0 for soil
        ("n_c", np.float64),  # bearing capacity factors [-]
        ("n_q", np.float64),
        ("n_gamma", np.float64),
        ("cohesion", np.float64, (MOISTURE_LEVELS,)),  # [Pa], by moisture [%]
        ("adhesion", np.float64, (MOISTURE_LEVELS,)),  # [Pa], by moisture [%]
    ]
)
"""Strength properties of one kind of soil."""


def strength_table(kinds: Sequence[SoilType]) -> NDArray[np.void]:
    """Return the strength of kinds of soil, shape (kinds,), `STRENGTH_DTYPE`.

    Args:
        kinds: the kinds of soil, in the order of their ids.
    """
    moisture_factor = np.array(
        [[kind.moisture_strength_factor(m) for m in range(MOISTURE_LEVELS)] for kind in kinds]
    )
    phi = np.array([math.radians(kind.internal_friction) for kind in kinds])
    tan = np.tan(np.maximum(phi, 1e-6))  # without friction N_c tends to 2 + pi
    n_q = np.exp(math.pi * tan) * np.tan(math.pi / 4 + np.arctan(tan) / 2) ** 2
    table = np.zeros(len(kinds), STRENGTH_DTYPE)
    table["gamma"] = [kind.density * GRAVITY for kind in kinds]
    table["phi"] = phi
    table["delta"] = [math.radians(kind.tool_friction) for kind in kinds]
    table["packed_strength"] = [kind.packed_strength for kind in kinds]
    table["tensile_strength"] = [kind.tensile_strength for kind in kinds]
    table["n_c"], table["n_q"] = (n_q - 1.0) / tan, n_q
    table["n_gamma"] = 2.0 * (n_q + 1.0) * tan
    table["cohesion"] = np.array([[kind.cohesion] for kind in kinds]) * moisture_factor
    table["adhesion"] = np.array([[kind.adhesion] for kind in kinds]) * moisture_factor
    return table


@helper
def loose_cover(columns, i):  # type: ignore[no-untyped-def]
    """Return the depth of the soil of column i that resists as loose soil [m].

    Loose soil that was pressed to its bank density resists as firm soil.
    """
    if columns.bulk[i] == columns.loose[i] and columns.rut_volume[i] > 0:
        return 0.0
    return columns.bulk[i] * columns.metres_per_mm3


@helper
def packed_share(columns, i, top, depth):  # type: ignore[no-untyped-def]
    """Return the share of a layer of firm soil of column i that is packed.

    Args:
        columns: `ForceColumns` of the terrain.
        i: flat index of the column.
        top: depth of the layer below the surface of the firm soil [m].
        depth: its thickness [m].
    """
    if columns.packing[i] == 0 or depth <= 0.0:
        return 0.0
    return min(max((packed_depth(columns, i) - top) / depth, 0.0), 1.0)


@helper
def column_index_at(x, y, grid_layout):  # type: ignore[no-untyped-def]
    """Return the flat index of the column at a point [m], or -1 outside of the map."""
    rows, cols, cell, x_first, y_first = grid_layout
    row = int(math.floor((x_first - x) / cell + 0.5))
    col = int(math.floor((y_first - y) / cell + 0.5))
    if 0 <= row < rows and 0 <= col < cols:
        return row * cols + col
    return -1
