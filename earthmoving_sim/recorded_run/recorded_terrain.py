"""Reconstruct the terrain before and after a recorded run from its first map and its updates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.recorded_run.topic_decoders import (
    MAP_UPDATES_TOPIC,
    TERRAIN_MAP_TOPIC,
    RecordedRunError,
)
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.map_updates import apply_map_updates
from msg_bridge.contract.messages import RowChunk, SoilHeader
from msg_bridge.contract.rows import Rows
from soil_sim.terrain import HeightMap

__all__ = ["RecordedTerrain"]

_ROW_NUMBER_MODULUS = 2**32
"""`seq` in rows is modulo 2^32; header counts are not."""


class RecordedTerrain:
    """The terrain of one run; its messages may be added in any order.

    Attributes:
        first: the terrain before the run, None until a map of the run was added.
    """

    def __init__(self, header: SoilHeader) -> None:
        """Begin without a map.

        Args:
            header: the soil's header of the last tick to reconstruct.
        """
        self.first: TerrainMap | None = None
        self._run_id = header.run_id
        self._last_row = header.map_updates.last
        self._last_applied_row = 0
        self._pending_rows: dict[int, Rows] = {}  # by the number of their first row
        self._elevation: NDArray[np.float64] = np.zeros((0, 0))  # [m]
        self._loose_depth: NDArray[np.float64] = np.zeros((0, 0))  # [m]

    def add_map(self, terrain: TerrainMap) -> None:
        """Add a terrain map; only the first one of the run is used.

        Raises:
            RecordedRunError: the first map is not of the terrain before the run.
        """
        if self.first is not None or terrain.keyframe.run_id != self._run_id:
            return
        if terrain.keyframe.revision:
            raise RecordedRunError(
                f"the first map on {TERRAIN_MAP_TOPIC} is revision {terrain.keyframe.revision} of"
                " the terrain, not the terrain before the run; record from the start of the run"
            )
        self.first = terrain
        self._elevation = terrain.keyframe.elevation.copy()
        self._loose_depth = terrain.loose_depth.copy()
        self._apply()

    def add_rows(self, chunk: RowChunk) -> None:
        """Add map updates; those of other runs or later ticks, and repeats, are ignored.

        Raises:
            RecordedRunError: an updated cell lies outside of the map.
        """
        if chunk.run_id != self._run_id:
            return
        half = _ROW_NUMBER_MODULUS // 2
        next_row = self._last_applied_row + 1
        ahead = (int(chunk.rows["seq"][0]) - next_row + half) % _ROW_NUMBER_MODULUS - half
        first = next_row + ahead
        if first <= self._last_row:
            self._pending_rows[first] = chunk.rows
            self._apply()

    def result(self) -> tuple[HeightMap, NDArray[np.float64], NDArray[np.float64]]:
        """Return the terrain before, then elevation and depth of loose soil after the last tick.

        Elevation and depth are in [m], shape (rows, cols).

        Raises:
            RecordedRunError: there was no map of the run, or updates are missing.
        """
        if self.first is None:
            raise RecordedRunError(
                f"there is no map of the last run on {TERRAIN_MAP_TOPIC}; record from the start of"
                " the run"
            )
        if self._last_applied_row < self._last_row:
            raise RecordedRunError(
                f"row {self._last_applied_row + 1} of {self._last_row} is missing on"
                f" {MAP_UPDATES_TOPIC}; reduce the load so that the recorder keeps up"
            )
        keyframe = self.first.keyframe
        return HeightMap(keyframe.grid, keyframe.elevation), self._elevation, self._loose_depth

    def _apply(self) -> None:
        """Apply all consecutive rows; each has the complete state of its cell."""
        while self.first is not None and (rows := self._take_next_rows()) is not None:
            layers = {"z": self._elevation, "loose_depth": self._loose_depth}
            try:
                apply_map_updates(rows, layers)
            except ExchangeError as error:
                raise RecordedRunError(f"a message on {MAP_UPDATES_TOPIC}: {error}") from error
            self._last_applied_row += rows.size

    def _take_next_rows(self) -> Rows | None:
        """Remove and return the pending rows after the last applied one; None if there are none."""
        for first in sorted(self._pending_rows):
            if first > self._last_applied_row + 1:
                break
            rows = self._pending_rows.pop(first)
            new = rows[self._last_applied_row + 1 - first :]
            if new.size:
                return new
        return None
