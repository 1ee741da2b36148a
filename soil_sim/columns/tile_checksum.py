"""Tiles of the map whose volume and digest are kept, so that a tick costs what it changed.

The state hash is SHA-256 over the digests of all tiles; only tiles with touched columns are
hashed again. It covers the volumes of every column (firm, loose, and the room that takes), its
kinds of soil and its moisture, and nothing else: not the grid and its floor, where tools stand, the
shape of a cut within a column, or which columns wait to slip. Terrains of one grid and one hash are
the same ground; they go on alike once no tool is in it and all is at rest.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel
from soil_sim.columns.state import Columns

__all__ = ["TILE_SIZE", "TileChecksums"]

TILE_SIZE = 64
"""Side of a tile [cells]."""


class TileChecksums:
    """Volume and digest of each tile of a terrain.

    Attributes:
        volume_mm3: bank volume of each tile, shape (tile rows, tile cols), int64.
    """

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        rows, cols = columns.grid.shape
        self._shape = (-(-rows // TILE_SIZE), -(-cols // TILE_SIZE))
        self.volume_mm3: NDArray[np.int64] = np.zeros(self._shape, dtype=np.int64)
        self._digests = [b""] * (self._shape[0] * self._shape[1])
        self._stale: NDArray[np.bool_] = np.ones(len(self._digests), dtype=np.bool_)
        for tile in range(len(self._digests)):
            window = self._window(tile)
            held = columns.firm[window].sum() + columns.loose[window].sum()
            self.volume_mm3[divmod(tile, self._shape[1])] = held

    @property
    def total_mm3(self) -> int:
        """Bank volume of the terrain [mm^3]: kept by the tiles."""
        return int(self.volume_mm3.sum())

    def apply_changes(self, cells: NDArray[np.int64], volume_change_mm3: NDArray[np.int64]) -> None:
        """Note by how much columns (flat indices) grew [mm^3 bank], and that they were touched."""
        if cells.size:
            volume, tile_cols = self.volume_mm3.reshape(-1), self._shape[1]
            _apply_changes(
                volume, self._stale, cells, volume_change_mm3, self._columns.grid.cols, tile_cols
            )

    def state_hash(self) -> str:
        """SHA-256 [hex] of volumes, kinds of soil and moisture of all columns, in tile order."""
        for tile in np.flatnonzero(self._stale).tolist():
            window = self._window(tile)
            columns, digest = self._columns, hashlib.sha256()
            for layer in (
                columns.firm,
                columns.loose,
                columns.bulk,
                columns.soil,
                columns.loose_soil,
                columns.moisture,
                columns.loose_moisture,
            ):
                digest.update(layer[window].tobytes())
            self._digests[tile] = digest.digest()
        self._stale[:] = False
        return hashlib.sha256(b"".join(self._digests)).hexdigest()

    def _window(self, tile: int) -> tuple[slice, slice]:
        i, j = divmod(tile, self._shape[1])
        return (
            slice(i * TILE_SIZE, (i + 1) * TILE_SIZE),
            slice(j * TILE_SIZE, (j + 1) * TILE_SIZE),
        )


@kernel
def _apply_changes(volume, stale, cells, volume_change_mm3, cols, tile_cols):  # type: ignore[no-untyped-def]
    """Add what columns grew to the volume of their tiles, and note that those are stale."""
    for n in range(cells.size):
        tile = cells[n] // cols // TILE_SIZE * tile_cols + cells[n] % cols // TILE_SIZE
        volume[tile] += volume_change_mm3[n]
        stale[tile] = True
