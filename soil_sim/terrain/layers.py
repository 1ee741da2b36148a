"""Layers of a terrain: soil id and moisture of each cell.

A layer lies on the grid of the terrain and is uint8: soil ids, or moisture in per cent of
saturation, 0 to 100. `layer_files` reads and writes files of one layer; `files` reads and writes an
`.npz` with heights and layers. `soil_sim.soils` defines the kind of soil of each id.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.height_map import as_height_array
from soil_sim.terrain.numpy_files import LAYER_NAMES

__all__ = [
    "LAYER_KINDS",
    "Layers",
    "check_layer",
    "check_layer_shape",
    "layers_from_arrays",
    "moisture_percent",
    "soil_ids",
]

LAYER_KINDS = LAYER_NAMES
"""Values of the argument `kind`."""


@dataclass(frozen=True, eq=False)
class Layers:
    """Layers of one terrain, each None or uint8 of shape (rows, cols).

    Attributes:
        soil: soil id of each cell.
        moisture: moisture of each cell [% of saturation], 0 to 100.

    Raises:
        TerrainError: a layer is not uint8, or a moisture is above 100 %.
    """

    soil: NDArray[np.uint8] | None = None
    moisture: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for kind in LAYER_KINDS:
            layer = getattr(self, kind)
            if layer is not None:
                check_layer(layer, kind)

    def to_npz_arrays(self, grid: Grid) -> dict[str, NDArray[Any]]:
        """Return the arrays to store in an `.npz`, by name.

        Raises:
            TerrainError: the shape of a layer is not that of the grid.
        """
        arrays = {}
        for kind in LAYER_KINDS:
            layer = getattr(self, kind)
            if layer is not None:
                check_layer_shape(layer.shape, grid, kind)
                arrays[kind] = layer
        return arrays


def layers_from_arrays(arrays: dict[str, NDArray[np.float64]], shape: tuple[int, int]) -> Layers:
    """Return the layers of the arrays in an `.npz`.

    Args:
        arrays: soil ids and moisture [% of saturation], by name.
        shape: (rows, cols) of the heights in the same file.

    Raises:
        TerrainError: an array has another shape, or a cell without a value or with an invalid one.
    """
    for kind, values in arrays.items():
        if values.shape != shape:
            raise TerrainError(
                f"its {kind} has shape {values.shape}, its heights {shape}; give both the same",
                TerrainErrorCode.SHAPE,
            )
    soil, moisture = arrays.get("soil"), arrays.get("moisture")
    return Layers(
        None if soil is None else soil_ids(soil),
        None if moisture is None else moisture_percent(moisture),
    )


def soil_ids(values: ArrayLike) -> NDArray[np.uint8]:
    """Return numbers of shape (rows, cols) as soil ids, uint8.

    Raises:
        TerrainError: a cell has no value, or one that is not a whole number from 0 to 255.
    """
    array = as_height_array(values, "soil ids")
    _check_no_nodata(array, "soil")
    _reject_values(
        (array != np.rint(array)) | (array < 0.0) | (array > 255.0),
        array,
        "are not soil ids",
        "give whole numbers from 0 to 255",
    )
    return array.astype(np.uint8)


def moisture_percent(values: ArrayLike) -> NDArray[np.uint8]:
    """Return moistures of shape (rows, cols), rounded to whole per cents, uint8.

    Args:
        values: moisture [% of saturation], 0 to 100.

    Raises:
        TerrainError: a cell has no value, or one out of range; or no value is above 1 and some are
            not whole numbers, as in a map of fractions 0..1 of saturation.
    """
    array = as_height_array(values, "moistures")
    _check_no_nodata(array, "moisture")
    _reject_values(
        (array < 0.0) | (array > 100.0),
        array,
        "are not a moisture from 0 to 100 %",
        "correct them",
    )
    if array.max() <= 1.0 and (array != np.rint(array)).any():
        raise TerrainError(
            f"its moisture goes to {array.max():g} only and is not in whole numbers, as fractions"
            " of saturation are; give per cent of saturation, 0 to 100",
            TerrainErrorCode.LAYER_VALUE,
        )
    return np.rint(array).astype(np.uint8)


def check_layer(layer: NDArray[Any], kind: str) -> None:
    """Check the type and range of a layer.

    Raises:
        TerrainError: the layer is not uint8, or a moisture is above 100 %.
    """
    if not (isinstance(layer, np.ndarray) and layer.dtype == np.uint8):
        raise TerrainError(
            f"{kind} is not an array of uint8; convert it with soil_ids or moisture_percent",
            TerrainErrorCode.UNSUPPORTED,
        )
    if kind == "moisture" and layer.size and layer.max() > 100:
        raise TerrainError(
            f"moisture goes up to {layer.max()} %; give at most 100 %", TerrainErrorCode.LAYER_VALUE
        )


def check_layer_shape(shape: tuple[int, ...], grid: Grid, kind: str, hint: str = "") -> None:
    """Check that a layer has the shape of the grid.

    Raises:
        TerrainError: the shapes differ; the message ends with `hint`.
    """
    if shape != grid.shape:
        raise TerrainError(
            f"its {kind} has shape {shape} (rows, cols), the terrain {grid.shape}; give a layer of"
            f" {grid.rows} x {grid.cols} cells{hint}",
            TerrainErrorCode.SHAPE,
        )


def _check_no_nodata(array: NDArray[np.float64], kind: str) -> None:
    num_missing = int(np.isnan(array).sum())
    if num_missing:
        raise TerrainError(
            f"{num_missing} of {array.size} cells have no {kind} (nodata or NaN); fill them",
            TerrainErrorCode.LAYER_VALUE,
        )


def _reject_values(
    is_bad: NDArray[np.bool_], array: NDArray[np.float64], problem: str, advice: str
) -> None:
    """Raise a TerrainError that names the first bad cell, if there is one."""
    if is_bad.any():
        row, col = np.argwhere(is_bad)[0]
        raise TerrainError(
            f"{is_bad.sum()} of {is_bad.size} values {problem}, the first {array[row, col]:g} at"
            f" row {row}, col {col}; {advice}",
            TerrainErrorCode.LAYER_VALUE,
        )
