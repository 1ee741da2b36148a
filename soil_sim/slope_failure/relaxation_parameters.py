"""Parameters that all kernels of `soil_sim.slope_failure` share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns.state import ColumnArrays, Columns
from soil_sim.slope_failure.cell_queue import CellQueue
from soil_sim.slope_failure.neighbourhood import columns_between, gauss_circle_offsets
from soil_sim.slope_failure.noise import RelaxationNoise
from soil_sim.slope_failure.stability import StabilityLimits, stability_limits

__all__ = ["RelaxationParameters", "SlopeArrays", "relaxation_parameters"]

_MIN_EXCESS_MM3 = 4
"""Smallest volume of a column that can be divided [mm^3]."""


class RelaxationParameters(NamedTuple):
    """When the soil of a column slides, and where to.

    Attributes:
        rows, cols: size of the map [cells].
        offsets: (row, col) of the neighbours [cells], shape (n, 2), int64, nearest first.
        between: columns between a column and each neighbour, see `columns_between`, as offsets of
            flat indices, shape (n, m, 2), int64.
        distance: distance to each neighbour [m], shape (n,), float64.
        reach: largest offset [cells].
        tolerance: excess of height that is not relaxed [m].
        repose_tan: tangent of the angle of repose, shape (kinds, MOISTURE_LEVELS), float64.
        stability: critical heights of firm soil.
        repose_tan_scale: tangent of the angle of repose of each column over that of its soil, flat,
            float64; empty if it is 1 everywhere.
        min_repose_tan: smallest tangent of the angle of repose of any column at any moisture.
        jitter: randomness of where soil slides, 0 to 1.
        random_state: state of the random numbers, shape (1,), uint64.
    """

    rows: int
    cols: int
    offsets: NDArray[np.int64]
    between: NDArray[np.int64]
    distance: NDArray[np.float64]
    reach: int
    tolerance: float
    repose_tan: NDArray[np.float64]
    stability: StabilityLimits
    repose_tan_scale: NDArray[np.float64]
    min_repose_tan: float
    jitter: float
    random_state: NDArray[np.uint64]


class SlopeArrays(NamedTuple):
    """What the kernels that move soil of single columns work on.

    Attributes:
        columns: the terrain.
        params: when soil slides, and where to.
        occupied: marks of `columns.occupancy`, flat, uint8.
        queue: the columns to relax.
    """

    columns: ColumnArrays
    params: RelaxationParameters
    occupied: NDArray[np.uint8]
    queue: CellQueue


def relaxation_parameters(
    columns: Columns, radius: float, tolerance: float, noise: RelaxationNoise
) -> RelaxationParameters:
    """Return the parameters for a terrain.

    Args:
        columns: the terrain.
        radius: radius of the neighbourhood [cells].
        tolerance: excess of height that is not relaxed [cells]; at least that of a few mm^3.
        noise: random variation.
    """
    grid, repose_tan = columns.grid, columns.tables.repose_tan
    offsets = gauss_circle_offsets(radius)
    min_scale = noise.repose_tan_scale.min() if noise.repose_tan_scale.size else 1.0
    return RelaxationParameters(
        rows=grid.rows,
        cols=grid.cols,
        offsets=offsets,
        between=columns_between(offsets) @ np.array([grid.cols, 1]),
        distance=np.hypot(offsets[:, 0], offsets[:, 1]) * grid.cell,
        reach=int(np.abs(offsets).max()),
        tolerance=max(tolerance * grid.cell, _MIN_EXCESS_MM3 * columns.metres_per_mm3),
        repose_tan=repose_tan,
        stability=stability_limits(
            columns.tables,
            offsets,
            grid.shape,
            grid.cell,
            float(columns.height.max()) - columns.floor,
        ),
        repose_tan_scale=noise.repose_tan_scale,
        min_repose_tan=float(repose_tan.min() * min_scale),
        jitter=noise.jitter,
        random_state=np.array([noise.seed * 2 + 1], dtype=np.uint64),
    )
