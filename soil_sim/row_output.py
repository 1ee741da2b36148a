"""What the soil says in rows: what it gave up, what became of landed soil, how columns look now.

Rows are not numbered yet (`seq` 0); the exchange does that.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    CONVERSION,
    MAP_UPDATE,
    MAX_ROW_VOLUME,
    ConversionKind,
    Rows,
    empty_rows,
)
from msg_bridge.kernels import kernel
from soil_sim.columns.changes import ColumnChanges
from soil_sim.columns.state import Columns
from soil_sim.excavation.swept_cut import RemovedSoil

__all__ = ["convert_deposit_requests", "excavation_rows", "map_update_rows"]

_DEPOSIT, _OUTSIDE, _REFUSE = (
    int(ConversionKind.DEPOSIT),
    int(ConversionKind.OUTSIDE),
    int(ConversionKind.REJECT),
)


def convert_deposit_requests(deposit_requests: Rows, tick: int, grid: Grid, kinds: int) -> Rows:
    """The answer to each landed row: on the map, beyond it, or not to be believed.

    Of a particle that a source names twice, only the first row is believed.

    Args:
        landed: LANDED rows of all sources.
        tick: number of the tick.
        grid: of the terrain.
        kinds: number of kinds of soil there are.

    Returns:
        CONVERSION rows, one for each of them in their order.
    """
    if deposit_requests.size == 0:  # as in most ticks
        return empty_rows(CONVERSION)
    named = (
        deposit_requests["machine_id"].astype(np.uint64) << np.uint64(32)
        | deposit_requests["particle_id"]
    )
    first = np.zeros(deposit_requests.size, dtype=np.bool_)
    first[np.unique(named, return_index=True)[1]] = True
    answers: Rows = _convert_requests(
        deposit_requests,
        first,
        tick,
        kinds,
        grid.rows,
        grid.cols,
        grid.cell,
        grid.x_first,
        grid.y_first,
    )
    return answers


def excavation_rows(removed: RemovedSoil, tick: int, machine_id: int, grid: Grid) -> Rows:
    """EXCAVATE rows of what a source removed; volumes beyond a row's field are split.

    Args:
        removed: soil removed from columns.
        tick: number of the tick.
        source: whose tools did it.
        grid: of the terrain.
    """
    if removed.size == 0:
        return empty_rows(CONVERSION)
    rows: Rows = _excavation_rows(removed, tick, machine_id, grid.cols)
    return rows


def map_update_rows(changed: ColumnChanges, columns: Columns, revision: int) -> Rows:
    """CHANGED rows of the columns that a tick changed, as they are now.

    Args:
        changed: which.
        columns: the terrain.
        revision: of the terrain after the tick.
    """
    if changed.cells.size == 0:
        return empty_rows(MAP_UPDATE)
    grid = columns.grid
    rows: Rows = _map_update_rows(
        changed.cells, columns.arrays, revision, grid.cols, grid.cell, grid.x_first, grid.y_first
    )
    return rows


@kernel
def _convert_requests(deposit_requests, first, tick, kinds, rows, cols, cell, x_first, y_first):  # type: ignore[no-untyped-def]
    """CONVERSION rows of landed ones; those of `first` are the first of their particle."""
    answers = np.zeros(deposit_requests.size, CONVERSION)
    for n in range(deposit_requests.size):
        said, answer = deposit_requests[n], answers[n]
        answer.x, answer.y, answer.z = said.x, said.y, said.z
        answer.volume_mm3, answer.particle_id = said.volume_mm3, said.particle_id
        answer.machine_id, answer.soil, answer.moisture = said.machine_id, said.soil, said.moisture
        answer.tick = tick
        x, y = np.float64(said.x), np.float64(said.y)
        finite = np.isfinite(x) and np.isfinite(y) and np.isfinite(said.z)
        known = said.volume_mm3 > 0 and said.soil < kinds and said.moisture < MOISTURE_LEVELS
        if not (first[n] and finite and known):
            answer.kind = _REFUSE
        elif abs(x) <= 0.5 * (rows * cell) and abs(y) <= 0.5 * (cols * cell):
            answer.kind = _DEPOSIT
            # Half a cell beyond the outer grid points still belongs to the outer columns.
            answer.row = np.int64(min(max(np.rint((x_first - x) / cell), 0.0), rows - 1.0))
            answer.col = np.int64(min(max(np.rint((y_first - y) / cell), 0.0), cols - 1.0))
        else:
            answer.kind = _OUTSIDE
    return answers


@kernel
def _excavation_rows(removed, tick, machine_id, cols):  # type: ignore[no-untyped-def]
    """CONVERSION rows of removed soil, as many for each column as its volume needs."""
    pieces = 0
    for n in range(removed.shape[0]):
        pieces += -(-np.int64(removed[n, 1]) // MAX_ROW_VOLUME)
    rows = np.zeros(pieces, CONVERSION)  # of the kind EXCAVATE, which is 0
    k = 0
    for n in range(removed.shape[0]):
        cell, left = np.int64(removed[n, 0]), np.int64(removed[n, 1])
        while left > 0:
            row = rows[k]
            row.x, row.y, row.z = removed[n, 2], removed[n, 3], removed[n, 4]
            row.soil, row.moisture = np.uint8(removed[n, 5]), np.uint8(removed[n, 6])
            row.row, row.col = cell // cols, cell % cols
            row.tick, row.machine_id = tick, machine_id
            row.volume_mm3 = min(left, MAX_ROW_VOLUME)
            left -= MAX_ROW_VOLUME
            k += 1
    return rows


@kernel
def _map_update_rows(cells, columns, revision, cols, cell, x_first, y_first):  # type: ignore[no-untyped-def]
    """CHANGED rows of columns, by their flat indices."""
    rows = np.zeros(cells.size, MAP_UPDATE)
    for n in range(cells.size):
        i, row = cells[n], rows[n]
        row.row, row.col = i // cols, i % cols
        row.x, row.y = x_first - (i // cols) * cell, y_first - (i % cols) * cell
        row.z = columns.height[i]
        row.loose_depth = columns.bulk[i] * columns.metres_per_mm3
        row.volume_mm3 = columns.firm[i] + columns.loose[i]
        if columns.loose[i] > 0:
            row.soil, row.moisture = columns.loose_soil[i], columns.loose_moisture[i]
        else:
            row.soil, row.moisture = columns.soil[i], columns.moisture[i]
        row.revision = revision
    return rows
