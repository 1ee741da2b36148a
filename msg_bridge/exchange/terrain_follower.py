"""The terrain surface for observers, which receive the soil's messages and send none.

The soil sends lost rows again to machines, not to observers. An observer starts from a keyframe,
applies the map updates that each soil header counts, and adopts a newer keyframe if rows are lost.
Its surface is always that of the end of one tick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.map_updates import apply_map_updates
from msg_bridge.contract.messages import Keyframe, Message, RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["TerrainFollower"]

_MAX_HEADERS_BEHIND_GAP = 50
"""Number of headers after one with missing rows at which a keyframe is adopted instead."""

_MAX_BUFFERED_HEADERS = 10_000
"""Maximum number of headers kept while there is no terrain."""


class TerrainFollower:
    """The surface at the end of the latest tick that is known without a gap.

    Attributes:
        run_id: number of the run, 0 before the first keyframe.
        tick: the tick at whose end the surface is this; -1 before the first.
        revision: revision of the terrain.
        grid: grid of the terrain, None before the first keyframe.
        elevation: [m], shape (rows, cols), float64; changed in place.
        gaps: number of keyframes adopted because rows were lost.
        max_tick: last tick to advance to, for observers that need the surface of certain ticks;
            None: no limit. Set it by `advance_to`.
    """

    def __init__(self) -> None:
        self.gaps = 0
        self.max_tick: int | None = None
        self._other_run_keyframe: Keyframe | None = None  # newest of another run
        self._reset(0)

    def _reset(self, run_id: int) -> None:
        self.run_id = run_id
        self.tick = -1
        self.revision = -1
        self.grid: Grid | None = None
        self.elevation: NDArray[np.float64] = np.zeros((0, 0))
        self._newest_keyframe: Keyframe | None = None
        self._headers: dict[int, SoilHeader] = {}
        self._chunks: dict[int, Rows] = {}  # MAP_UPDATE rows by the number of the first

    def receive(self, message: Message) -> bool:
        """Process a message that the soil sends to all; others are ignored.

        Returns:
            Whether the run or the tick changed.

        Raises:
            ExchangeError: OFF_MAP: a map update lies outside of the grid.
        """
        before = (self.run_id, self.tick)
        if isinstance(message, Keyframe):
            if message.run_id > self.run_id:
                self._reset(message.run_id)
            if message.run_id == self.run_id:
                self._newest_keyframe = message
            else:
                self._other_run_keyframe = message
        elif message.run_id == self.run_id:
            if isinstance(message, SoilHeader) and message.tick > self.tick:
                self._headers[message.tick] = message
            elif isinstance(message, RowChunk) and message.stream is Stream.MAP_UPDATE:
                self._store_chunk(message.rows)
        self._advance()
        return (self.run_id, self.tick) != before

    def _store_chunk(self, rows: Rows) -> None:
        # Rows sent again to a machine arrive here too, and may be split otherwise.
        first = int(rows["seq"][0])
        if first not in self._chunks or self._chunks[first].size < rows.size:
            self._chunks[first] = rows

    def start_run(self, run_id: int) -> None:
        """Follow a run, as `/sim/config` names it, even if its number is smaller.

        A soil that was reset often may have a smaller number after a restart.
        """
        if run_id == self.run_id:
            return
        self._reset(run_id)
        if self._other_run_keyframe is not None and self._other_run_keyframe.run_id == run_id:
            self._newest_keyframe = self._other_run_keyframe
        self._advance()

    @property
    def is_missing_rows(self) -> bool:
        """Whether it cannot advance, because rows or headers are missing."""
        return bool(self._headers) and (
            self.max_tick is None or min(self._headers) <= self.max_tick
        )

    def advance_to(self, max_tick: int | None) -> None:
        """Set the last tick to advance to (None: no limit), and advance as far as rows are here."""
        self.max_tick = max_tick
        self._advance()

    def resync(self) -> bool:
        """Adopt the newest keyframe if rows are missing; return whether the tick changed.

        Call it when there has been no progress for a while.
        """
        before = self.tick
        if not self.is_missing_rows:
            return False  # or it waits at its last tick
        if self._newest_keyframe is not None and self._newest_keyframe.revision > self.revision:
            self._adopt_keyframe()
        self._advance()
        return self.tick != before

    def _advance(self) -> None:
        if self.grid is None and self._newest_keyframe is not None:
            self._adopt_keyframe()
        if self.grid is None:
            while len(self._headers) > _MAX_BUFFERED_HEADERS:
                del self._headers[min(self._headers)]
            return
        while self._headers:
            header = self._headers[min(self._headers)]
            if self.max_tick is not None and header.tick > self.max_tick:
                break
            if header.revision > self.revision and not self._apply(header):
                if len(self._headers) <= _MAX_HEADERS_BEHIND_GAP or not self._is_newer(header):
                    return
                self.gaps += 1
                self._adopt_keyframe()
                continue
            self.tick = header.tick
            del self._headers[header.tick]
        self._drop_old_chunks()

    def _is_newer(self, header: SoilHeader) -> bool:
        return (
            self._newest_keyframe is not None and self._newest_keyframe.revision >= header.revision
        )

    def _adopt_keyframe(self) -> None:
        assert self._newest_keyframe is not None
        self.grid = self._newest_keyframe.grid
        self.elevation = self._newest_keyframe.elevation.astype(np.float32).astype(np.float64)
        self.revision = self._newest_keyframe.revision

    def _apply(self, header: SoilHeader) -> bool:
        """Apply the map updates of a header; return False if rows are missing."""
        if header.revision != self.revision + 1:
            return False  # a header in between is missing
        rows = self._rows(header)
        if rows is None:
            return False
        apply_map_updates(rows, {"z": self.elevation})
        self.revision = header.revision
        return True

    def _rows(self, header: SoilHeader) -> Rows | None:
        """Return all MAP_UPDATE rows that a header counts; None if any is missing."""
        wanted, parts = header.map_updates, []
        number = wanted.first
        while number <= wanted.last:
            part = self._chunks.get(number % 2**32)
            if part is None:
                return None
            parts.append(part[: wanted.last + 1 - number])
            number += part.size
        return np.concatenate(parts) if parts else None

    def _drop_old_chunks(self) -> None:
        """Discard rows that are applied."""
        self._chunks = {
            first: rows
            for first, rows in self._chunks.items()
            if int(rows["revision"][-1]) > self.revision
        }
