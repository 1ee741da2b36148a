"""The terrain at the begin and the end of what is recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows

__all__ = ["TerrainHistory"]

_MAX_EARLY = 1_000_000
"""Number of rows above which updates before the first map are reduced."""


class TerrainHistory:
    """The terrain of a run: its first map, and later maps and updates on it.

    Updates may precede the first map: those that it lacks are added to it.

    Attributes:
        grid: the grid; None without a map.
        start_time, start_revision: stamp [s] and revision of the first map. A revision above 0: the
            terrain had changed before, in so many ticks.
        has_updates: whether there were updates.
        before, after: heights of the columns [m], shape (rows, cols).
        loose_depth: depth of loose soil at the end [m], shape (rows, cols).
        volume_change: bank volume at the end minus that at the begin [mm^3], shape (rows, cols).
    """

    def __init__(self) -> None:
        self.grid: Grid | None = None
        self.start_time, self.start_revision = 0.0, 0
        self.has_updates = False
        self._early: list[Rows] = []  # updates before the first map
        self._num_early = 0
        self.before: NDArray[np.float64] = np.zeros((0, 0))
        self.after = self.loose_depth = self.before
        self._start_volume: NDArray[np.int64] = np.zeros((0, 0), dtype=np.int64)
        self._volume = self._start_volume
        self._revision: NDArray[np.int64] = self._start_volume

    @property
    def volume_change(self) -> NDArray[np.int64]:
        """Bank volume at the end minus that at the begin [mm^3], shape (rows, cols)."""
        return self._volume - self._start_volume

    def add_map(self, terrain: TerrainMap, time: float) -> None:
        """Add a map; one of another grid than the first is ignored.

        Args:
            terrain: the map.
            time: its stamp [s].
        """
        frame = terrain.keyframe
        is_first = self.grid is None
        if self.grid is None:
            self.grid = frame.grid
            self.start_time, self.start_revision = time, frame.revision
            self.before = frame.elevation.copy()
            self._start_volume = frame.volume_mm3.copy()
            self._revision = np.full(frame.grid.shape, -1, dtype=np.int64)
            self.after, self.loose_depth = self.before.copy(), terrain.loose_depth.copy()
            self._volume = self._start_volume.copy()
        if frame.grid.shape != self.grid.shape:
            return
        is_newer = frame.revision >= self._revision
        self.after[is_newer] = frame.elevation[is_newer]
        self.loose_depth[is_newer] = terrain.loose_depth[is_newer]
        self._volume[is_newer] = frame.volume_mm3[is_newer]
        self._revision[is_newer] = frame.revision
        if is_first:
            early, self._early = self._early, []
            for rows in early:
                self.add_updates(rows)

    def add_updates(self, rows: Rows) -> None:
        """Add MAP_UPDATE rows, of which each is the state of a column."""
        if not rows.size:
            return
        self.has_updates = True
        if self.grid is None:
            self._keep(rows)
            return
        at = rows["row"].astype(np.intp), rows["col"].astype(np.intp)
        inside = (at[0] < self.grid.rows) & (at[1] < self.grid.cols)
        rows, at = rows[inside], (at[0][inside], at[1][inside])
        is_newer = rows["revision"] >= self._revision[at]
        rows, at = rows[is_newer], (at[0][is_newer], at[1][is_newer])
        self.after[at] = rows["z"]
        self.loose_depth[at] = rows["loose_depth"]
        self._volume[at] = rows["volume_mm3"].astype(np.int64)
        self._revision[at] = rows["revision"]

    def _keep(self, rows: Rows) -> None:
        """Keep updates until there is a map; of each column the newest one, if there are many."""
        self._early.append(rows)
        self._num_early += rows.size
        if self._num_early > _MAX_EARLY:
            every = np.concatenate(self._early)
            every = every[np.lexsort((every["revision"], every["col"], every["row"]))]
            is_last = np.ones(every.size, dtype=bool)
            is_last[:-1] = (np.diff(every["row"].astype(np.int64)) != 0) | (
                np.diff(every["col"].astype(np.int64)) != 0
            )
            self._early, self._num_early = [every[is_last]], 0
