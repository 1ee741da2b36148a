"""Swept cut of a plate tool in ground with rock: what the tool sweeps, but rock only with work.

Soil yields to any part of a tool; rock yields only to the cutting edge and to the leading side,
which it resists as it resists picks. The work of the resistance to cutting in the tick removes as
much rock as it covers at their specific energy (`soil_sim.tool_force.specific_energy`). Where it
does not cover all that the tool swept, all columns lose the same fraction of their rock, and the
rest stays: it bears the tool (`soil_sim.tool_force.bearing_capacity`). Loose soil on rock and soil
beside it are removed like any other soil.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel
from soil_sim.excavation.rasterize import apply_height_changes, rasterize_sweep
from soil_sim.excavation.rasterize_triangle import raster_in_tick
from soil_sim.excavation.refined_columns import (
    MOMENT_X,
    MOMENT_Y,
    MOMENT_Z,
    REMOVED_HEIGHT,
)
from soil_sim.tool_force.specific_energy import rock_specific_energy

__all__ = ["cut_sweep_in_rock"]


@kernel
def cut_sweep_in_rock(  # type: ignore[no-untyped-def]
    points, has_plate, work, boxed_raster, tick, count, boxed_columns, strength
):
    """Lower subcolumns to the surface that a tool sweeps, those of rock as far as the work allows.

    Args:
        points: key points at both times and ends, shape (pairs, 2 times, 2 ends, 3), map frame [m].
        has_plate: whether a plate joins each pair to the next one, shape (pairs,).
        work: work of the resistance to cutting in the tick [J].
        boxed_raster: `RasterTables`, boxed; their refined columns are changed.
        tick: number of the tick.
        count: number of refined columns.
        boxed_columns: `ColumnArrays` of the terrain, boxed.
        strength: `strength_table` of its kinds of soil.

    Returns:
        Number of refined columns.
    """
    raster, columns = raster_in_tick(boxed_raster.table, tick), boxed_columns.table
    apply_height_changes(raster, count)
    known = raster.subcolumn_height[:count].copy()
    num_known = count
    count = rasterize_sweep(points, has_plate, raster, count)
    rock_heights = np.empty(count)
    energy = 0.0
    for slot in range(count):
        rock_heights[slot] = height = _swept_rock_height(slot, raster, columns, strength)
        if height > 0.0:
            kind = columns.soil[raster.cells[slot]]
            volume = height * raster.grid.cell * raster.grid.cell
            energy += volume * rock_specific_energy(strength[kind].tensile_strength)
    if energy <= work:
        return count
    remaining = 1.0 - work / energy
    for slot in range(count):
        if rock_heights[slot] > 0.0:
            swept = raster.removed_moments[slot, REMOVED_HEIGHT] / raster.subcolumn_height.shape[1]
            removed_fraction = 1.0 - remaining * rock_heights[slot] / swept
            _restore(slot, removed_fraction, known, num_known, raster)
    return count


@helper
def _swept_rock_height(slot, raster, columns, strength):  # type: ignore[no-untyped-def]
    """Return the height of rock that a sweep took of a column, a mean over its subcolumns [m]."""
    i = raster.cells[slot]
    if strength[columns.soil[i]].tensile_strength <= 0.0:
        return 0.0
    swept = raster.removed_moments[slot, REMOVED_HEIGHT] / raster.subcolumn_height.shape[1]
    return max(swept - columns.bulk[i] * columns.metres_per_mm3, 0.0)  # loose soil is on top


@helper
def _restore(slot, fraction, known, num_known, raster):  # type: ignore[no-untyped-def]
    """Give back to the subcolumns of a column all but a fraction of what they lost in a sweep."""
    grid, moments = raster.grid, raster.removed_moments
    per_side, cell = grid.subcolumns_per_side, raster.cells[slot]
    fine = grid.cell / per_side
    shift = 0.5 * per_side - 0.5
    row, col = cell // grid.cols, cell % grid.cols
    moments[slot, :] = 0.0
    for q in range(raster.subcolumn_height.shape[1]):
        before = known[slot, q] if slot < num_known else raster.initial_height[slot]
        removed = fraction * (before - raster.subcolumn_height[slot, q])
        if removed <= 0.0:
            raster.subcolumn_height[slot, q] = before
            continue
        after = before - removed
        raster.subcolumn_height[slot, q] = after
        moments[slot, REMOVED_HEIGHT] += removed
        moments[slot, MOMENT_X] += removed * (
            grid.x_first + (shift - (row * per_side + q // per_side)) * fine
        )
        moments[slot, MOMENT_Y] += removed * (
            grid.y_first + (shift - (col * per_side + q % per_side)) * fine
        )
        moments[slot, MOMENT_Z] += removed * (after + 0.5 * removed)
