"""Columns that tracks stand on: no soil slides into them from the sides of a rut.

A track at rest has no rows, so its columns stay marked until it moves again, or its machine takes
no part in a tick.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import fixed_signature_kernel
from soil_sim.columns.occupancy import FREE, TRACK_ABOVE
from soil_sim.compaction import sort_distinct

__all__ = ["TrackOccupancy"]

_NO_CELLS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


class TrackOccupancy:
    """Marks of the columns under each track."""

    def __init__(self, occupied: NDArray[np.uint8]) -> None:
        """
        Args:
            occupied: layer of `columns.occupancy` in which to mark the columns, shape (rows, cols).
        """
        self._occupied = occupied.reshape(-1)
        # Flat indices by machine id and tool id.
        self._cells: dict[tuple[int, int], NDArray[np.int64]] = {}
        self._marked = _NO_CELLS  # all of these

    def end_tick(self, pressed: Mapping[int, Mapping[int, NDArray[np.int64]]]) -> NDArray[np.int64]:
        """Mark the columns under tracks, and free those that tracks have left.

        Columns that a tool is in keep the mark of the tool; when it leaves a column under a track
        at rest, that column is free.

        Args:
            pressed: flat indices of the columns under each track that moved, by tool id, for the id
                of each machine in the tick.

        Returns:
            Flat indices of the columns that were freed, sorted.
        """
        if not any(pressed.values()) and all(key[0] in pressed for key in self._cells):
            return _NO_CELLS  # all tracks are at rest
        for key in [key for key in self._cells if key[0] not in pressed]:
            del self._cells[key]
        for machine_id, tools in pressed.items():
            for tool, cells in tools.items():
                self._cells[machine_id, tool] = cells
        freed = self._marked
        self._marked = np.concatenate([_NO_CELLS, *self._cells.values()])
        return freed[: _move_marks(self._occupied, freed, self._marked)]


@fixed_signature_kernel
def _move_marks(occupied, before, now):  # type: ignore[no-untyped-def]
    """Free the columns that tracks were on, and mark those that they are on.

    Args:
        occupied: marks of `columns.occupancy`, shape (columns,); changed.
        before: flat indices of the columns that they were on; those that were freed are moved to
            its front, sorted, each once.
        now: flat indices of the columns that they are on.

    Returns:
        The number of columns that were freed.
    """
    for k in before:
        if occupied[k] == TRACK_ABOVE:
            occupied[k] = FREE
    for k in now:
        if occupied[k] == FREE:
            occupied[k] = TRACK_ABOVE
    count = 0
    for k in before:
        if occupied[k] == FREE:
            before[count] = k
            count += 1
    return sort_distinct(before, 0, count)
