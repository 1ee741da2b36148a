"""How much steeper than allowed the slopes of a terrain are: 0 after a complete relaxation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns.state import Columns
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.stability import unstable_columns

__all__ = ["max_slope_excess"]


def max_slope_excess(
    columns: Columns, params: RelaxationParameters, occupied: NDArray[np.uint8]
) -> float:
    """Return the largest excess of the slopes that can fail, as a tangent.

    Loose soil exceeds the tangent of its angle of repose, firm soil that of its own where it is
    unstable. Occupied columns are excluded, as are neighbours beyond the width of the map; -inf if
    no two columns are left.

    Args:
        columns: the terrain.
        params: when its soil slides.
        occupied: marks of `columns.occupancy`, shape (rows, cols).
    """
    rows, cols = columns.height.shape
    repose_tan = columns.tables.repose_tan[columns.top_soil, columns.top_moisture]
    firm_repose_tan = columns.tables.repose_tan[columns.soil, columns.moisture]
    if params.repose_tan_scale.size:
        scale = params.repose_tan_scale.reshape(rows, cols)
        repose_tan, firm_repose_tan = repose_tan * scale, firm_repose_tan * scale
    is_unstable = unstable_columns(columns.arrays, params, occupied.reshape(-1)).reshape(rows, cols)
    is_occupied = occupied.astype(bool)
    largest = -math.inf
    for (di, dj), distance in zip(params.offsets, params.distance, strict=True):
        if abs(di) >= rows or abs(dj) >= cols:
            continue
        a = (slice(max(0, -di), rows - max(0, di)), slice(max(0, -dj), cols - max(0, dj)))
        b = (slice(max(0, di), rows - max(0, -di)), slice(max(0, dj), cols - max(0, -dj)))
        is_free = ~(is_occupied[a] | is_occupied[b])
        if not is_free.any():
            continue
        # Only loose soil, as deep as it is, and unstable firm soil can slide.
        surface = columns.height[a] - columns.height[b] - repose_tan[a] * distance
        face = columns.firm_height[a] - columns.height[b] - firm_repose_tan[a] * distance
        firm = np.where(is_unstable[a], face, -math.inf)
        loose = np.minimum(surface, columns.loose_depth[a])
        excess = np.maximum(np.where(columns.loose[a] > 0, loose, firm), firm)
        largest = max(largest, float(excess[is_free].max() / distance))
    return largest
