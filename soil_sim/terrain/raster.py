"""Contents of a terrain file before spacing and vertical scale are applied."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soil_sim.terrain.georeference import Georeference

__all__ = ["TerrainRaster"]


@dataclass(frozen=True, eq=False)
class TerrainRaster:
    """Heights, or values of a layer, as stored in a file.

    Attributes:
        heights: values in matrix order, in the vertical unit of the file, shape (rows, cols); NaN
            for nodata, if the reader keeps it.
        cell: spacing stated in the file [m], None without one in metres.
        georeference: georeference stated in the file, None without one.
    """

    heights: NDArray[np.float64]
    cell: float | None = None
    georeference: Georeference | None = None
