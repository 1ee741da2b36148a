"""Layers of the terrain surface, stored by tile so that changed tiles are sent as they are.

A tile has 16 x 16 cells. Tiles are numbered row by row, in the matrix order of the grid:

        cols ->            tile_cols = 3
      +----+----+--+
    r | 0  | 1  | 2|       cell (row, col) is in tile (row // 16) * tile_cols + col // 16
    o +----+----+--+
    w | 3  | 4  | 5|       tiles on the last row and column are padded with their edge cells
    s +----+----+--+
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows

__all__ = ["TILE", "TILE_SIZE", "SurfaceLayers", "TerrainTiles"]

TILE_SIZE = 16
"""Number of cells along each side of a tile."""

_SHAPE = (TILE_SIZE, TILE_SIZE)

TILE = np.dtype(
    [
        ("height", "<f4", _SHAPE),  # elevation [m]
        ("loose_depth", "<u2", _SHAPE),  # depth of loose soil [mm]
        ("soil", "u1", _SHAPE),  # id of the soil type at the surface
        ("moisture", "u1", _SHAPE),  # at the surface [% of saturation]
    ]
)
"""A tile as it is sent."""

_MAX_LOOSE_DEPTH_MM = 2**16 - 1


class SurfaceLayers(NamedTuple):
    """Layers of the surface, each of shape (rows, cols).

    Attributes:
        height: elevation [m].
        loose_depth: depth of loose soil [m].
        soil: id of the soil type at the surface.
        moisture: moisture at the surface [% of saturation].
    """

    height: NDArray[Any]
    loose_depth: NDArray[Any]
    soil: NDArray[Any]
    moisture: NDArray[Any]


class TerrainTiles:
    """The surface of one terrain.

    Attributes:
        grid: the grid.
        tile_rows, tile_cols: number of tiles along x and y.
        counter: number of changes so far.
        changed: value of `counter` at the last change of each tile, shape (tiles,), int64.
    """

    def __init__(self, layers: SurfaceLayers, grid: Grid) -> None:
        """
        Args:
            layers: the surface.
            grid: its grid.
        """
        self.grid = grid
        self.tile_rows = -(-grid.rows // TILE_SIZE)
        self.tile_cols = -(-grid.cols // TILE_SIZE)
        self._tiles = self._to_tiles(layers)
        self.counter = 1
        self.changed = np.ones(self._tiles.size, dtype=np.int64)

    def replace(self, layers: SurfaceLayers) -> None:
        """Replace the whole surface; only tiles that differ count as changed."""
        new = self._to_tiles(layers)
        size = TILE.itemsize
        differs = (
            new.view(np.uint8).reshape(-1, size) != self._tiles.view(np.uint8).reshape(-1, size)
        ).any(axis=1)
        self._tiles = new
        self._mark(np.flatnonzero(differs))

    def update(self, rows: Rows) -> None:
        """Set the cells of MAP_UPDATE rows; of several rows of one cell the last counts.

        Raises:
            ExchangeError: OFF_MAP: a cell lies outside of the grid; nothing was changed.
        """
        if rows.size == 0:
            return
        row, col = rows["row"].astype(np.intp), rows["col"].astype(np.intp)
        if row.max() >= self.grid.rows or col.max() >= self.grid.cols:
            raise ExchangeError(
                f"a map update lies outside of the {self.grid.rows} x {self.grid.cols} cells of"
                " the terrain; the map is of another grid",
                ErrorCode.OFF_MAP,
            )
        tile = (row // TILE_SIZE) * self.tile_cols + col // TILE_SIZE
        cell = (tile, row % TILE_SIZE, col % TILE_SIZE)
        self._tiles["height"][cell] = rows["z"]
        self._tiles["loose_depth"][cell] = _to_millimetres(rows["loose_depth"])
        self._tiles["soil"][cell] = rows["soil"]
        self._tiles["moisture"][cell] = rows["moisture"]
        touched = np.unique(tile)
        self._pad(touched)
        self._mark(touched)

    def encode(self, numbers: NDArray[np.integer[Any]]) -> bytes:
        """Return tiles as bytes, `TILE.itemsize` for each."""
        data: bytes = self._tiles[numbers].tobytes()
        return data

    def centers(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of the centre of each tile [m], map frame, shape (tiles,)."""
        middle = 0.5 * (TILE_SIZE - 1)
        number = np.arange(self._tiles.size)
        row, col = number // self.tile_cols, number % self.tile_cols
        return (
            self.grid.x(row * TILE_SIZE + middle),
            self.grid.y(col * TILE_SIZE + middle),
        )

    def layer(self, name: str) -> NDArray[Any]:
        """Return a layer of `TILE` as a matrix of shape (rows, cols)."""
        blocks = self._tiles[name].reshape(self.tile_rows, self.tile_cols, *_SHAPE)
        matrix = blocks.swapaxes(1, 2).reshape(
            self.tile_rows * TILE_SIZE, self.tile_cols * TILE_SIZE
        )
        return np.ascontiguousarray(matrix[: self.grid.rows, : self.grid.cols])

    def _mark(self, numbers: NDArray[np.intp]) -> None:
        if numbers.size:
            self.counter += 1
            self.changed[numbers] = self.counter

    def _to_tiles(self, layers: SurfaceLayers) -> Rows:
        tiles = np.empty(self.tile_rows * self.tile_cols, dtype=TILE)
        tiles["height"] = self._blocks(layers.height)
        tiles["loose_depth"] = self._blocks(_to_millimetres(layers.loose_depth))
        tiles["soil"] = self._blocks(layers.soil)
        tiles["moisture"] = self._blocks(layers.moisture)
        return tiles

    def _blocks(self, layer: NDArray[Any]) -> NDArray[Any]:
        """Return a matrix as blocks of the size of a tile, shape (tiles, 16, 16), edges padded."""
        below = self.tile_rows * TILE_SIZE - self.grid.rows
        right = self.tile_cols * TILE_SIZE - self.grid.cols
        padded = np.pad(layer, ((0, below), (0, right)), mode="edge") if below or right else layer
        blocks = padded.reshape(self.tile_rows, TILE_SIZE, self.tile_cols, TILE_SIZE)
        return blocks.swapaxes(1, 2).reshape(-1, *_SHAPE)

    def _pad(self, numbers: NDArray[np.intp]) -> None:
        """Repeat the edge cells in the padding of some tiles."""
        last_row = self.grid.rows - (self.tile_rows - 1) * TILE_SIZE
        last_col = self.grid.cols - (self.tile_cols - 1) * TILE_SIZE
        if last_row < TILE_SIZE:
            edge = numbers[numbers // self.tile_cols == self.tile_rows - 1]
            for name in TILE.names or ():
                self._tiles[name][edge, last_row:, :] = self._tiles[name][edge, last_row - 1, None]
        if last_col < TILE_SIZE:
            edge = numbers[numbers % self.tile_cols == self.tile_cols - 1]
            for name in TILE.names or ():
                layer = self._tiles[name]
                layer[edge, :, last_col:] = layer[edge, :, last_col - 1, None]


def _to_millimetres(depth: NDArray[Any]) -> NDArray[np.uint16]:
    """Return depths [m] as whole millimetres; a depth that is not finite becomes 0."""
    rounded = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) * 1e3)
    clipped: NDArray[np.uint16] = np.clip(rounded, 0, _MAX_LOOSE_DEPTH_MM).astype(np.uint16)
    return clipped
