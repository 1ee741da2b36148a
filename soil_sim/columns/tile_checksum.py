"""Volume and state hash of the terrain, kept by tiles so that a tick costs what it changed.

The state hash is the SHA-256 of the digests of all tiles; only tiles with touched columns are
hashed again. It covers the volumes of every column (firm, loose and bulk, packing and rut), the
kinds and the moistures of its soil. It does not cover the grid and the floor, the positions of
tools, the shape of a cut within a column, or the queue of columns to relax. Two terrains with the
same grid and hash are in the same state, and evolve in the same way once no tool is in the soil and
all is at rest.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import fixed_signature_kernel
from soil_sim.columns.state import Columns

__all__ = ["TILE_SIZE", "TileChecksums"]

TILE_SIZE = 64
"""Side of a tile [cells]."""


class TileChecksums:
    """Volume and digest of each tile of a terrain.

    Attributes:
        volume_mm3: bank volume of each tile [mm^3], shape (tile rows, tile cols), int64.
        total_mm3: their sum, the bank volume of the terrain [mm^3].
    """

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        rows, cols = columns.grid.shape
        self._shape = (-(-rows // TILE_SIZE), -(-cols // TILE_SIZE))
        self.volume_mm3: NDArray[np.int64] = np.zeros(self._shape, dtype=np.int64)
        self._digests = [b""] * (self._shape[0] * self._shape[1])
        self._is_stale: NDArray[np.bool_] = np.ones(len(self._digests), dtype=np.bool_)
        for tile in range(len(self._digests)):
            window = self._window(tile)
            volume = columns.firm[window].sum() + columns.loose[window].sum()
            self.volume_mm3[divmod(tile, self._shape[1])] = volume
        self.total_mm3 = int(self.volume_mm3.sum())

    def apply_changes(self, cells: NDArray[np.int64], volume_change_mm3: NDArray[np.int64]) -> None:
        """Add volume changes [mm^3 bank] of touched columns (flat indices), shape (n,) each."""
        if cells.size:
            self.total_mm3 += _apply_changes(
                self.volume_mm3.reshape(-1),
                self._is_stale,
                cells,
                volume_change_mm3,
                self._columns.grid.cols,
                self._shape[1],
            )

    def state_hash(self) -> str:
        """Return the SHA-256 [hex] of volumes, kinds and moistures of all columns."""
        for tile in np.flatnonzero(self._is_stale).tolist():
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
                columns.packing,
                columns.rut_volume,
            ):
                digest.update(layer[window].tobytes())
            self._digests[tile] = digest.digest()
        self._is_stale[:] = False
        return hashlib.sha256(b"".join(self._digests)).hexdigest()

    def _window(self, tile: int) -> tuple[slice, slice]:
        """Return the rows and columns of a tile, by its index in row-major order."""
        i, j = divmod(tile, self._shape[1])
        return (
            slice(i * TILE_SIZE, (i + 1) * TILE_SIZE),
            slice(j * TILE_SIZE, (j + 1) * TILE_SIZE),
        )


@fixed_signature_kernel
def _apply_changes(volume, is_stale, cells, volume_change_mm3, cols, tile_cols):  # type: ignore[no-untyped-def]
    """Add the volume changes of columns to their tiles, and mark those tiles as stale.

    Returns:
        The sum of the changes.
    """
    total = np.int64(0)
    for n in range(cells.size):
        tile = cells[n] // cols // TILE_SIZE * tile_cols + cells[n] % cols // TILE_SIZE
        volume[tile] += volume_change_mm3[n]
        is_stale[tile] = True
        total += volume_change_mm3[n]
    return total
