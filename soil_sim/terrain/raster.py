"""What every file format hands over, before a spacing and a scale make a map of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soil_sim.terrain.georeference import Georeference

__all__ = ["TerrainRaster"]


@dataclass(frozen=True, eq=False)
class TerrainRaster:
    """Heights, or a layer's values, as a file holds them.

    Attributes:
        heights: in matrix order and the file's vertical unit, shape (rows, cols); NaN where the
            file marks a gap and its reader was asked to keep gaps.
        cell: spacing the file states [m], None where it states none in metres.
        georeference: where the file says the ground lies, None where it does not.
    """

    heights: NDArray[np.float64]
    cell: float | None = None
    georeference: Georeference | None = None
