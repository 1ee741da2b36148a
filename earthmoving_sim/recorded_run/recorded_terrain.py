"""The terrain before and after a recorded run, from its first map and all changed cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.recorded_run.topic_decoders import RecordedRunError
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import STREAM_TOPICS, TERRAIN_MAP_TOPIC
from soil_sim.terrain import HeightMap

__all__ = ["RecordedTerrain"]

_MAP_UPDATES_TOPIC = STREAM_TOPICS[Stream.MAP_UPDATE]

_ROW_NUMBER_MODULUS = 2**32
"""Row numbers begin anew after so many; the headers' do not."""


class RecordedTerrain:
    """The terrain of one run, as its messages come, in any order.

    Attributes:
        first: the terrain before, None until a map of the run has come.
    """

    def __init__(self, header: SoilHeader) -> None:
        """`header` is the soil's of the tick to stop after."""
        self.first: TerrainMap | None = None
        self._run_id = header.run_id
        self._last = header.map_updates.last
        self._num_applied = 0  # number of the last row that was applied
        self._pending_rows: dict[int, Rows] = {}  # by the number of the first
        self._elevation: NDArray[np.float64] = np.zeros((0, 0))
        self._loose_depth: NDArray[np.float64] = np.zeros((0, 0))

    def receive_map(self, terrain: TerrainMap) -> None:
        """Take a map; of those of the run, the first counts."""
        if self.first is not None or terrain.keyframe.run_id != self._run_id:
            return
        if terrain.keyframe.revision:
            raise RecordedRunError(
                f"the first map on {TERRAIN_MAP_TOPIC} shows revision {terrain.keyframe.revision} of the"
                " terrain, not the ground before it was dug; record from the start of the run"
            )
        self.first = terrain
        self._elevation = terrain.keyframe.elevation.copy()
        self._loose_depth = terrain.loose_depth.copy()
        self._apply()

    def receive_rows(self, chunk: RowChunk) -> None:
        """Take changed cells; those of other runs, of later ticks and repeats do not count."""
        if chunk.run_id != self._run_id:
            return
        ahead = (
            int(chunk.rows["seq"][0]) - self._num_applied - 1 + _ROW_NUMBER_MODULUS // 2
        ) % _ROW_NUMBER_MODULUS
        first = self._num_applied + 1 + ahead - _ROW_NUMBER_MODULUS // 2
        if first <= self._last:
            self._pending_rows[first] = chunk.rows
            self._apply()

    def end(self) -> tuple[HeightMap, NDArray[np.float64], NDArray[np.float64]]:
        """The ground before, then surface and depth of loose soil after [m], shape (rows, cols).

        Raises:
            RecordedRunError: there was no map of the run, or changed cells are missing.
        """
        if self.first is None:
            raise RecordedRunError(
                f"there is no map of the last run on {TERRAIN_MAP_TOPIC}; record from the start of the run"
            )
        if self._num_applied < self._last:
            raise RecordedRunError(
                f"row {self._num_applied + 1} of {self._last} is missing on {_MAP_UPDATES_TOPIC}; see that the"
                " recorder keeps up"
            )
        frame = self.first.keyframe
        return HeightMap(frame.grid, frame.elevation), self._elevation, self._loose_depth

    def _apply(self) -> None:
        """Apply all rows that come next. Each holds what its cell is, so the last one counts."""
        while self.first is not None and (rows := self._take_next_rows()) is not None:
            at = (rows["row"], rows["col"])
            if (at[0] >= self._elevation.shape[0]).any() or (
                at[1] >= self._elevation.shape[1]
            ).any():
                raise RecordedRunError(
                    f"a changed cell on {_MAP_UPDATES_TOPIC} lies off the map on {TERRAIN_MAP_TOPIC}"
                )
            self._elevation[at] = rows["z"]
            self._loose_depth[at] = rows["loose_depth"]
            self._num_applied += rows.size

    def _take_next_rows(self) -> Rows | None:
        """The rows after the last one applied, as far as they are here."""
        for first in sorted(self._pending_rows):
            if first > self._num_applied + 1:
                break
            rows = self._pending_rows.pop(first)
            new = rows[self._num_applied + 1 - first :]
            if new.size:
                return new
        return None
