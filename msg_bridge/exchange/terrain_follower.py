"""Follows the terrain from outside the exchange: one who looks and never answers.

A machine is sent again what it misses; one who only listens is not. It starts from a keyframe,
applies the changed cells that each soil header counts, and takes a newer keyframe if it must. So
the surface is always that of one certain tick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, Message, RowChunk, SoilHeader, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["TerrainFollower"]

_MAX_HEADERS_BEHIND_GAP = 50
"""Headers that may come after one whose rows are missing before a keyframe is taken instead."""

_MAX_BUFFERED_HEADERS = 10_000
"""Headers kept at most while there is no terrain to apply them to."""


class TerrainFollower:
    """The surface at the end of a tick, as far as it is known without a gap.

    Attributes:
        epoch: number of the run, 0 before the first keyframe.
        tick: the tick whose surface this is; -1 before the first.
        revision: of the terrain.
        grid: of the terrain, None before the first keyframe.
        elevation: the surface [m], shape (rows, cols), float64; changed in place.
        gaps: times that rows were missed and a keyframe had to be taken.
        limit: go no further than to this tick, for now; None: as far as can be. For one who has to
            see the surface of each of certain ticks. Change it by `advance_to`.
    """

    def __init__(self) -> None:
        self.gaps = 0
        self.max_tick: int | None = None
        self._other_run_keyframe: Keyframe | None = None  # of another run
        self._reset(0)

    def _reset(self, run_id: int) -> None:
        self.run_id = run_id
        self.tick = -1
        self.revision = -1
        self.grid: Grid | None = None
        self.elevation: NDArray[np.float64] = np.zeros((0, 0))
        self._newest_keyframe: Keyframe | None = None
        self._headers: dict[int, SoilHeader] = {}
        self._chunks: dict[int, Rows] = {}  # CHANGED rows by the number of the first

    def receive(self, message: Message) -> bool:
        """Take what the soil says to all; anything else is ignored.

        Returns:
            Whether `tick` went on.
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
        # What is sent again to a machine comes here too, and may be cut otherwise.
        first = int(rows["seq"][0])
        if first not in self._chunks or self._chunks[first].size < rows.size:
            self._chunks[first] = rows

    def start_run(self, run_id: int) -> None:
        """Follow this run, as `/sim/config` names it, even if its number is not larger.

        A soil that was reset often and is started again may come back to a number it was beyond.
        """
        if run_id == self.run_id:
            return
        self._reset(run_id)
        if self._other_run_keyframe is not None and self._other_run_keyframe.run_id == run_id:
            self._newest_keyframe = self._other_run_keyframe
        self._advance()

    def advance_to(self, max_tick: int | None) -> None:
        """Go on to a tick, as far as its rows have come, and no further; None: no limit."""
        self.max_tick = max_tick
        self._advance()

    def resync(self) -> bool:
        """Take the newest keyframe if rows are missing; returns whether `tick` went on.

        To be called when nothing has gone on for a while.
        """
        before = self.tick
        if self.max_tick is not None and min(self._headers, default=0) > self.max_tick:
            return False  # it waits, and lacks nothing
        if (
            self._headers
            and self._newest_keyframe is not None
            and self._newest_keyframe.revision > self.revision
        ):
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
        """Apply a header's changed cells if nothing before them is missing and all are here."""
        if header.revision != self.revision + 1:
            return False  # a tick between was missed
        rows = self._rows(header)
        if rows is None:
            return False
        shape = self.elevation.shape
        if (rows["row"] >= shape[0]).any() or (rows["col"] >= shape[1]).any():
            raise ExchangeError("a changed cell lies off the map; the soil sends another grid")
        self.elevation[rows["row"], rows["col"]] = rows["z"]
        self.revision = header.revision
        return True

    def _rows(self, header: SoilHeader) -> Rows | None:
        """All CHANGED rows a header counts, None if some are missing."""
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
        """Forget rows the surface has."""
        self._chunks = {
            first: rows
            for first, rows in self._chunks.items()
            if int(rows["revision"][-1]) > self.revision
        }
