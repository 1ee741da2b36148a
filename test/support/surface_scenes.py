"""A terrain that changes tick by tick, as maps and map updates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import MAP_UPDATE
from viewer.scene.terrain_surface import SurfaceMap
from viewer.scene.terrain_tiles import SurfaceLayers

__all__ = ["ChangingTerrain"]


class ChangingTerrain:
    """Layers that change at random; each tick is a revision with rows in one or two chunks.

    Attributes:
        grid: the grid; its sides are no multiples of a tile.
        height: elevation [m], float32.
        revision: revision of the terrain.
    """

    def __init__(self, seed: int = 0, grid: Grid | None = None) -> None:
        self.grid = grid = grid or Grid(41, 50, 0.5)
        self.run_id = 7
        self._rng = np.random.default_rng(seed)
        self.height: NDArray[np.float32] = self._rng.random(grid.shape).astype(np.float32)
        self.loose = np.zeros(grid.shape)
        self.soil = np.zeros(grid.shape, dtype=np.uint8)
        self.moisture = np.full(grid.shape, 10, dtype=np.uint8)
        self.revision = 0
        self._seq = 1

    def map(self) -> SurfaceMap:
        """Return the present map."""
        layers = SurfaceLayers(
            self.height.copy(), self.loose.copy(), self.soil.copy(), self.moisture.copy()
        )
        return SurfaceMap(self.run_id, self.revision, self.grid, layers)

    def tick(self, num_cells: int = 30) -> list[RowChunk]:
        """Change some cells; return the rows."""
        self.revision += 1
        cells = self._rng.choice(self.height.size, num_cells, replace=False)
        rows = np.zeros(num_cells, dtype=MAP_UPDATE)
        rows["row"], rows["col"] = np.divmod(cells, self.grid.cols)
        rows["z"] = self._rng.random(num_cells)
        rows["loose_depth"] = self._rng.integers(0, 500, num_cells) / 1000.0
        rows["soil"], rows["moisture"] = self._rng.integers(0, 3, num_cells), 20
        rows["revision"] = self.revision
        rows["seq"] = np.arange(self._seq, self._seq + num_cells)
        self._seq += num_cells
        for layer, name in (
            (self.height, "z"),
            (self.loose, "loose_depth"),
            (self.soil, "soil"),
            (self.moisture, "moisture"),
        ):
            layer[rows["row"], rows["col"]] = rows[name]
        parts = [rows[: num_cells // 2], rows[num_cells // 2 :]]
        return [RowChunk(self.run_id, Stream.MAP_UPDATE, 0, 0, part) for part in parts]
