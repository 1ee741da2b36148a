"""Rows that the soil returns: removed soil, the result of deposit requests, changed columns.

Rows are not numbered yet (`seq` 0); the exchange does that.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.rows import (
    CONVERSION,
    MAP_UPDATE,
    MAX_ROW_VOLUME,
    ConversionKind,
    Rows,
    no_rows,
)
from msg_bridge.kernels import fixed_signature_kernel, helper
from soil_sim.columns.changes import ColumnChanges
from soil_sim.columns.grid_frame import GridFrame
from soil_sim.columns.state import Columns
from soil_sim.excavation.removed_soil import RemovedSoil

__all__ = ["convert_deposit_requests", "excavation_rows", "map_update_rows"]

_EXCAVATE, _DEPOSIT, _OUTSIDE, _REJECT = (
    int(ConversionKind.EXCAVATE),
    int(ConversionKind.DEPOSIT),
    int(ConversionKind.OUTSIDE),
    int(ConversionKind.REJECT),
)

_HASH_FACTOR = 2654435761
"""Factor of multiplicative hashing of ids of 32 bits (Knuth, The Art of Computer Programming, 3,
section 6.4)."""


def convert_deposit_requests(
    deposit_requests: Rows, tick: int, frame: GridFrame, num_soil_types: int
) -> Rows:
    """Return the result of each deposit request: deposited, outside the map, or rejected.

    If a machine requests the same particle more than once, only the first row is accepted.

    Args:
        deposit_requests: DEPOSIT_REQUEST rows of all machines.
        tick: number of the tick.
        frame: grid of the terrain.
        num_soil_types: number of kinds of soil.

    Returns:
        CONVERSION rows, one for each request, in the same order.
    """
    if deposit_requests.size == 0:  # as in most ticks
        return no_rows(CONVERSION)
    conversions: Rows = _convert_requests(deposit_requests, tick, num_soil_types, frame)
    return conversions


def excavation_rows(removed: RemovedSoil, tick: int, machine_id: int, cols: int) -> Rows:
    """Return CONVERSION rows of the soil a machine removed; too large volumes are split.

    Args:
        removed: removed soil, a record for each column.
        tick: number of the tick.
        machine_id: machine whose tools removed it.
        cols: number of columns of the grid.
    """
    if removed.size == 0:
        return no_rows(CONVERSION)
    rows: Rows = _excavation_rows(removed, tick, machine_id, cols)
    return rows


def map_update_rows(changes: ColumnChanges, columns: Columns, revision: int) -> Rows:
    """Return MAP_UPDATE rows with the current state of the columns that a tick changed.

    Args:
        changes: the changed columns.
        columns: the terrain.
        revision: revision of the terrain after the tick.
    """
    if changes.cells.size == 0:
        return no_rows(MAP_UPDATE)
    rows: Rows = _map_update_rows(changes.cells, columns.boxed_arrays, revision, columns.frame)
    return rows


@fixed_signature_kernel
def _convert_requests(requests, tick, num_soil_types, frame):  # type: ignore[no-untyped-def]
    """Return the rows of `convert_deposit_requests`."""
    conversions, is_first = np.zeros(requests.size, CONVERSION), _are_first(requests)
    for n in range(requests.size):
        request, row = requests[n], conversions[n]
        row.x, row.y, row.z = request.x, request.y, request.z
        row.volume_mm3, row.particle_id = request.volume_mm3, request.particle_id
        row.machine_id, row.soil, row.moisture = request.machine_id, request.soil, request.moisture
        row.tick = tick
        x, y = np.float64(request.x), np.float64(request.y)
        is_finite = np.isfinite(x) and np.isfinite(y) and np.isfinite(request.z)
        is_soil = request.soil < num_soil_types and request.moisture < MOISTURE_LEVELS
        if not (is_first[n] and is_finite and is_soil and request.volume_mm3 > 0):
            row.kind = _REJECT
        elif abs(x) <= 0.5 * (frame.rows * frame.cell) and abs(y) <= 0.5 * (
            frame.cols * frame.cell
        ):
            row.kind = _DEPOSIT
            # The half cell beyond the outer grid points belongs to the outer columns.
            i = min(max(np.rint((frame.x_first - x) / frame.cell), 0.0), frame.rows - 1.0)
            j = min(max(np.rint((frame.y_first - y) / frame.cell), 0.0), frame.cols - 1.0)
            row.row, row.col = np.int64(i), np.int64(j)
        else:
            row.kind = _OUTSIDE
    return conversions


@helper(allocates=True)
def _are_first(requests):  # type: ignore[no-untyped-def]
    """Return which rows are the first ones of their machine and particle, shape (n,), bool."""
    is_first = np.ones(requests.size, np.bool_)
    size, shift = 1, 32
    while size < 2 * requests.size:
        size, shift = 2 * size, shift - 1
    # A hash table: row of a particle at the number that its ids give, or at the next free one.
    rows = np.full(size, -1, np.int64)
    for n in range(requests.size):
        machine_id, particle_id = requests[n].machine_id, requests[n].particle_id
        key = (np.int64(particle_id) + np.int64(machine_id)) & 0xFFFFFFFF
        at = (key * _HASH_FACTOR & 0xFFFFFFFF) >> shift
        while rows[at] >= 0:
            other = requests[rows[at]]
            if other.particle_id == particle_id and other.machine_id == machine_id:
                is_first[n] = False
                break
            at = (at + 1) & (size - 1)
        if is_first[n]:
            rows[at] = n
    return is_first


@fixed_signature_kernel
def _excavation_rows(removed, tick, machine_id, cols):  # type: ignore[no-untyped-def]
    """Return CONVERSION rows of removed soil, as many for each column as its volume needs."""
    count = 0
    for n in range(removed.size):
        count += -(-removed[n].volume_mm3 // MAX_ROW_VOLUME)
    rows = np.zeros(count, CONVERSION)
    k = 0
    for n in range(removed.size):
        record, remaining = removed[n], removed[n].volume_mm3
        while remaining > 0:
            row = rows[k]
            row.kind, row.machine_id, row.tick = _EXCAVATE, machine_id, tick
            row.row, row.col = record.cell // cols, record.cell % cols
            row.x, row.y, row.z = record.x, record.y, record.z
            row.soil, row.moisture = record.soil, record.moisture
            row.volume_mm3 = min(remaining, MAX_ROW_VOLUME)
            remaining -= MAX_ROW_VOLUME
            k += 1
    return rows


@fixed_signature_kernel
def _map_update_rows(cells, boxed_columns, revision, frame):  # type: ignore[no-untyped-def]
    """Return MAP_UPDATE rows of columns, by their flat indices."""
    columns = boxed_columns.table
    rows = np.zeros(cells.size, MAP_UPDATE)
    for n in range(cells.size):
        i, row = cells[n], rows[n]
        row.row, row.col = i // frame.cols, i % frame.cols
        row.x = frame.x_first - (i // frame.cols) * frame.cell
        row.y = frame.y_first - (i % frame.cols) * frame.cell
        row.z = columns.height[i]
        row.loose_depth = columns.bulk[i] * columns.metres_per_mm3
        row.volume_mm3 = columns.firm[i] + columns.loose[i]
        if columns.loose[i] > 0:
            row.soil, row.moisture = columns.loose_soil[i], columns.loose_moisture[i]
        else:
            row.soil, row.moisture = columns.soil[i], columns.moisture[i]
        row.rut_depth = columns.rut_volume[i] * columns.metres_per_mm3
        row.revision = revision
    return rows
