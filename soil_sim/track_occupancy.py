"""Columns that tracks stand on: no soil slides into them from the sides of a rut.

A track at rest has no rows, so its columns stay marked until it moves again, or its machine takes
no part in a tick.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns.occupancy import FREE, TRACK_ABOVE

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
        before = self._cells
        moved = {(i, tool): cells for i, tools in pressed.items() for tool, cells in tools.items()}
        at_rest = {key: cells for key, cells in before.items() if key[0] in pressed}
        self._cells = {key: cells for key, cells in (at_rest | moved).items() if cells.size}
        for marked in before.values():
            self._replace(marked, TRACK_ABOVE, FREE)
        for marked in self._cells.values():
            self._replace(marked, FREE, TRACK_ABOVE)
        all_before = np.unique(np.concatenate([_NO_CELLS, *before.values()]))
        freed: NDArray[np.int64] = all_before[self._occupied[all_before] == FREE]
        return freed

    def _replace(self, cells: NDArray[np.int64], old: int, new: int) -> None:
        """Replace a mark of columns by another where they have it."""
        self._occupied[cells[self._occupied[cells] == old]] = new
