"""Columns that tracks stand on: no soil slides into them from the sides of a rut.

A machine at rest sends no rows of its tracks, so its columns stay marked until it drives again, or
takes no part in a tick.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from soil_sim.columns.occupancy import FREE, TRACK_ABOVE

__all__ = ["TrackOccupancy"]

_NO_CELLS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


class TrackOccupancy:
    """Marks of the columns under the tracks of each machine."""

    def __init__(self, occupied: NDArray[np.uint8]) -> None:
        """
        Args:
            occupied: layer of `columns.occupancy` in which to mark the columns, shape (rows, cols).
        """
        self._occupied = occupied.reshape(-1)
        self._cells: dict[int, NDArray[np.int64]] = {}  # flat indices by machine id

    def end_tick(self, cells: Mapping[int, NDArray[np.int64] | None]) -> NDArray[np.int64]:
        """Mark the columns under tracks, and free those that tracks have left.

        Columns that a tool is in keep the mark of the tool.

        Args:
            cells: flat indices of the columns by machine id, of each machine in the tick; None if
                its tracks are at rest.

        Returns:
            Flat indices of the columns that were freed, sorted.
        """
        if not self._cells and not any(each is not None for each in cells.values()):
            return _NO_CELLS  # as without tracks
        before = self._cells
        self._cells = {}
        for machine_id, each in cells.items():
            under = before.get(machine_id, _NO_CELLS) if each is None else each
            if under.size:
                self._cells[machine_id] = under
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
