"""Assemble the map of a large terrain from its tiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.codec.terrain_tiles import TerrainTile, TileOutline, TileRound
from msg_bridge.contract.rows import Rows

__all__ = ["TileAssembly"]

_MAX_ROUNDS = 2
"""Number of incomplete rounds that are kept: a forged tile does not displace the real round."""


class TileAssembly:
    """The newest map of which all tiles have arrived, in any order.

    Attributes:
        cells: TERRAIN_CELL points, shape (rows, cols), changed in place by later rounds; None
            before the first complete round.
        run_id, revision: run and revision of that map.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Discard the map and all tiles."""
        self.cells: Rows | None = None
        self.run_id, self.revision = 0, -1
        self._rounds: dict[TileRound, dict[TileOutline, NDArray[np.void]]] = {}

    @property
    def is_incomplete(self) -> bool:
        """Whether tiles of a round are missing, and there is no map."""
        return self.cells is None and bool(self._rounds)

    def add(self, tile: TerrainTile) -> bool:
        """Add a tile; return whether it completed a map.

        A round that is not full and follows another one than that of the present map is ignored:
        the next full round replaces the map.
        """
        if tile.round.run_id == self.run_id and tile.round.revision <= self.revision:
            return False
        tiles = self._rounds.pop(tile.round, {})
        tiles[tile.outline] = tile.cells
        self._rounds[tile.round] = tiles  # the last that received a tile is the last one
        if len(self._rounds) > _MAX_ROUNDS:
            del self._rounds[next(iter(self._rounds))]
        return len(tiles) == tile.round.num_tiles and self._complete(tile.round, tiles)

    def _complete(self, done: TileRound, tiles: dict[TileOutline, NDArray[np.void]]) -> bool:
        """Apply all tiles of a round; return whether there is a map of it now."""
        del self._rounds[done]
        if done.is_full:
            self.cells = np.empty(done.shape, dtype=TERRAIN_CELL)
        elif (
            self.cells is None
            or self.cells.shape != done.shape
            or (self.run_id, self.revision) != (done.run_id, done.base_revision)
        ):
            return False
        self.run_id, self.revision = done.run_id, done.revision
        content = self.cells.view(f"V{TERRAIN_CELL.itemsize}")
        for outline, cells in tiles.items():
            content[outline.slices] = cells
        self.cells["revision"] = done.revision
        self._rounds = {
            each: kept
            for each, kept in self._rounds.items()
            if each.run_id != done.run_id or each.revision > done.revision
        }
        return True
