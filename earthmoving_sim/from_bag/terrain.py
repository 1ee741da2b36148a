"""The terrain before and after a recorded run, from its first map and all changed cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.from_bag.words import BagOutcomeError
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import Rows
from msg_bridge.nodes.topics import MAP_TOPIC, STREAM_TOPIC
from soil_sim.terrain import HeightMap

__all__ = ["RecordedTerrain"]

_CHANGES_TOPIC = STREAM_TOPIC[Stream.CHANGED]

_NUMBERS = 2**32
"""Row numbers begin anew after so many; the headers' do not."""


class RecordedTerrain:
    """The terrain of one run, as its messages come, in any order.

    Attributes:
        first: the terrain before, None until a map of the run has come.
    """

    def __init__(self, header: SoilHeader) -> None:
        """`header` is the soil's of the tick to stop after."""
        self.first: TerrainMap | None = None
        self._epoch = header.epoch
        self._last = header.changed.last
        self._done = 0  # number of the last row that was applied
        self._waiting: dict[int, Rows] = {}  # by the number of the first
        self._surface: NDArray[np.float64] = np.zeros((0, 0))
        self._loose: NDArray[np.float64] = np.zeros((0, 0))

    def receive_map(self, terrain: TerrainMap) -> None:
        """Take a map; of those of the run, the first counts."""
        if self.first is not None or terrain.keyframe.epoch != self._epoch:
            return
        if terrain.keyframe.revision:
            raise BagOutcomeError(
                f"the first map on {MAP_TOPIC} shows revision {terrain.keyframe.revision} of the"
                " terrain, not the ground before it was dug; record from the start of the run"
            )
        self.first = terrain
        self._surface = terrain.keyframe.elevation.copy()
        self._loose = terrain.loose_depth.copy()
        self._apply()

    def receive_rows(self, chunk: RowChunk) -> None:
        """Take changed cells; those of other runs, of later ticks and repeats do not count."""
        if chunk.epoch != self._epoch:
            return
        ahead = (int(chunk.rows["seq"][0]) - self._done - 1 + _NUMBERS // 2) % _NUMBERS
        first = self._done + 1 + ahead - _NUMBERS // 2
        if first <= self._last:
            self._waiting[first] = chunk.rows
            self._apply()

    def end(self) -> tuple[HeightMap, NDArray[np.float64], NDArray[np.float64]]:
        """The ground before, then surface and depth of loose soil after [m], shape (rows, cols).

        Raises:
            BagOutcomeError: there was no map of the run, or changed cells are missing.
        """
        if self.first is None:
            raise BagOutcomeError(
                f"there is no map of the last run on {MAP_TOPIC}; record from the start of the run"
            )
        if self._done < self._last:
            raise BagOutcomeError(
                f"row {self._done + 1} of {self._last} is missing on {_CHANGES_TOPIC}; see that the"
                " recorder keeps up"
            )
        frame = self.first.keyframe
        return HeightMap(frame.grid, frame.elevation), self._surface, self._loose

    def _apply(self) -> None:
        """Apply all rows that come next. Each holds what its cell is, so the last one counts."""
        while self.first is not None and (rows := self._next()) is not None:
            at = (rows["row"], rows["col"])
            if (at[0] >= self._surface.shape[0]).any() or (at[1] >= self._surface.shape[1]).any():
                raise BagOutcomeError(
                    f"a changed cell on {_CHANGES_TOPIC} lies off the map on {MAP_TOPIC}"
                )
            self._surface[at] = rows["z"]
            self._loose[at] = rows["loose_depth"]
            self._done += rows.size

    def _next(self) -> Rows | None:
        """The rows after the last one applied, as far as they are here."""
        for first in sorted(self._waiting):
            if first > self._done + 1:
                break
            rows = self._waiting.pop(first)
            new = rows[self._done + 1 - first :]
            if new.size:
                return new
        return None
