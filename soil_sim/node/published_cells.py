"""The points of a large terrain as they are published, at a revision that can be held.

The tiles of a round must show one revision, but are sent over many ticks. So the points are a copy
of the terrain, to which changes are applied after each tick, or later while a round is sent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.terrain import TERRAIN_CELL, TerrainMap, cells_of_terrain
from msg_bridge.codec.terrain_tiles import TILE_SIZE, TileOutline, tile_outlines
from msg_bridge.contract.rows import MAP_UPDATE, Rows

__all__ = ["PublishedCells"]

_COPIED_FIELDS = tuple(
    name for name in TERRAIN_CELL.names or () if name in (MAP_UPDATE.names or ())
)
"""Fields of a point that a map update has; the others are read from the terrain."""


class _Change(NamedTuple):
    """Columns that changed in a tick: their flat numbers, their points, and the new revision."""

    numbers: NDArray[np.int64]
    points: Rows
    revision: int


class PublishedCells:
    """A copy of a terrain as points of its map.

    Attributes:
        cells: TERRAIN_CELL points, shape (rows, cols).
        revision: revision of the terrain that they show.
    """

    def __init__(self, terrain: TerrainMap) -> None:
        """
        Args:
            terrain: the present terrain, of which a copy is made.
        """
        self.cells = cells_of_terrain(terrain)
        self.revision = terrain.keyframe.revision
        self._run_id = terrain.keyframe.run_id
        self._is_held = False
        self._changes: list[_Change] = []  # since it is held
        self._outlines = tuple(tile_outlines(self.cells.shape))
        self._num_tile_cols = -(-self.cells.shape[1] // TILE_SIZE)
        self._has_changed = np.zeros(len(self._outlines), dtype=bool)  # by tile

    @property
    def outlines(self) -> tuple[TileOutline, ...]:
        """All tiles."""
        return self._outlines

    @property
    def has_changed(self) -> bool:
        """Whether any tile has changed since `take_changed_tiles`, with what is not applied yet."""
        return bool(self._has_changed.any() or self._changes)

    def update(
        self,
        map_updates: Rows,
        surface_material: NDArray[np.uint8],
        design_difference: NDArray[np.float32] | None,
    ) -> None:
        """Note the columns that changed in a tick.

        Args:
            map_updates: MAP_UPDATE rows of the tick.
            surface_material: layer of the terrain, shape (rows, cols).
            design_difference: layer of the terrain [m], same shape; None without a design.
        """
        if not map_updates.size:
            return
        rows, cols = map_updates["row"].astype(np.int64), map_updates["col"].astype(np.int64)
        revision = int(map_updates["revision"][-1])
        points: Rows = np.empty(map_updates.size, dtype=TERRAIN_CELL)
        for name in _COPIED_FIELDS:
            points[name] = map_updates[name]
        points["surface_material"] = surface_material[rows, cols]
        points["design_difference"] = (
            np.nan if design_difference is None else design_difference[rows, cols]
        )
        points["run_id"] = self._run_id
        change = _Change(rows * self.cells.shape[1] + cols, points, revision)
        if self._is_held:
            self._changes.append(change)
        else:
            self._apply(change)

    def hold(self) -> None:
        """Keep the present revision until `release`."""
        self._is_held = True

    def release(self) -> None:
        """Apply what has changed since `hold`."""
        self._is_held = False
        for change in self._changes:
            self._apply(change)
        self._changes = []

    def take_changed_tiles(self) -> list[TileOutline]:
        """Return the tiles that changed since the last call, of what is applied."""
        changed = [self._outlines[n] for n in np.flatnonzero(self._has_changed)]
        self._has_changed[:] = False
        return changed

    def _apply(self, change: _Change) -> None:
        self.cells.reshape(-1)[change.numbers] = change.points
        self.revision = change.revision
        rows, cols = np.divmod(change.numbers, self.cells.shape[1])
        self._has_changed[rows // TILE_SIZE * self._num_tile_cols + cols // TILE_SIZE] = True
