"""Tiles of a large terrain: parts of its map, each an organised cloud of its own.

A tile is a block of TILE_SIZE x TILE_SIZE columns, fewer at the -x and -y edges. Its points have
the fields of a map, their `row` and `col` in the map, and what shows which tiles belong together.
Tiles are published in rounds. All tiles of a round show the terrain at the same `revision`. A full
round has all tiles, and its `base_revision` is its own revision. Another round has the `num_tiles`
tiles that changed after `base_revision`, the revision of the round before.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray

from msg_bridge.codec.cdr import rows_to_cdr
from msg_bridge.codec.cloud_layout import layout_of_dtype
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import Rows

__all__ = [
    "TERRAIN_TILE",
    "TILE_SIZE",
    "TerrainTile",
    "TileOutline",
    "TileRound",
    "num_tiles_of",
    "tile_from_cdr",
    "tile_outlines",
    "tile_to_cdr",
]

TILE_SIZE = 64
"""Number of rows and of columns of a tile. Its message of 280 kB is five datagrams, so that receive
buffers have room for other topics."""

TERRAIN_TILE = np.dtype(
    [
        *((name, TERRAIN_CELL[name]) for name in TERRAIN_CELL.names or ()),
        ("row", "<u2"),  # in the map
        ("col", "<u2"),
        ("map_rows", "<u2"),  # size of the map; the same in every point, as all that follow
        ("map_cols", "<u2"),
        ("base_revision", "<u4"),  # of the round before, whose other tiles are still valid
        ("num_tiles", "<u4"),  # of the round
    ]
)
"""A point of a tile."""

_CELL_BYTES = np.dtype(f"V{TERRAIN_CELL.itemsize}")
_CELL_OF_TILE = np.dtype(
    {"names": ["cell"], "formats": [_CELL_BYTES], "itemsize": TERRAIN_TILE.itemsize}
)
"""A point of a tile of which only the bytes of a point of a map are visible."""

_LAYOUT = layout_of_dtype(TERRAIN_TILE)
_ROUND_FIELDS = ("run_id", "revision", "base_revision", "num_tiles", "map_rows", "map_cols")


class TileOutline(NamedTuple):
    """Where a tile lies: its first row and column in the map, and its size."""

    row: int
    col: int
    num_rows: int
    num_cols: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Its rows and columns in an array of the map."""
        return (
            slice(self.row, self.row + self.num_rows),
            slice(self.col, self.col + self.num_cols),
        )


class TileRound(NamedTuple):
    """What the tiles of a round have in common.

    Attributes:
        run_id: number of the run.
        revision: revision of the terrain that they show.
        base_revision: revision of the round before; its own revision: the round is full.
        num_tiles: number of its tiles.
        map_rows, map_cols: size of the map.
    """

    run_id: int
    revision: int
    base_revision: int
    num_tiles: int
    map_rows: int
    map_cols: int

    @property
    def is_full(self) -> bool:
        """Whether it has all tiles of the map."""
        return self.base_revision == self.revision

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the map."""
        return (self.map_rows, self.map_cols)


class TerrainTile(NamedTuple):
    """A decoded tile.

    Attributes:
        round: the round it belongs to.
        outline: where it lies.
        cells: the bytes of its TERRAIN_CELL points, shape (num_rows, num_cols), read-only.
    """

    round: TileRound
    outline: TileOutline
    cells: NDArray[np.void]


def tile_outlines(shape: tuple[int, int]) -> Iterator[TileOutline]:
    """Yield the tiles of a map of a shape, row by row.

    Args:
        shape: (rows, cols) of the map.
    """
    rows, cols = shape
    for row in range(0, rows, TILE_SIZE):
        for col in range(0, cols, TILE_SIZE):
            yield _outline(row, col, shape)


def tile_to_cdr(
    cells: Rows, outline: TileOutline, tile_round: TileRound, frame_id: str, stamp: Time
) -> bytes:
    """Serialise a tile of a map.

    Args:
        cells: TERRAIN_CELL points of the whole map, shape (rows, cols), contiguous.
        outline: the tile.
        tile_round: its round; run and revision of `cells` are replaced by those of the round.
        frame_id: the map frame.
        stamp: time of the round.
    """
    row, col, num_rows, num_cols = outline
    points = np.empty((num_rows, num_cols), dtype=TERRAIN_TILE)
    # Copying field by field would take many times as long.
    points.view(_CELL_OF_TILE)["cell"] = cells.view(_CELL_BYTES)[outline.slices]
    points["row"] = np.arange(row, row + num_rows)[:, np.newaxis]
    points["col"] = np.arange(col, col + num_cols)
    for name in _ROUND_FIELDS:
        points[name] = getattr(tile_round, name)
    return rows_to_cdr(points.reshape(-1), frame_id, stamp, height=num_rows)


def tile_from_cdr(data: bytes) -> TerrainTile:
    """Parse a serialised tile.

    Its layers are not checked, but when the map is decoded.

    Raises:
        CodecError: FIELDS: no cloud of TERRAIN_TILE points; VALUE: they contradict one another;
            GRID: they are not those of a tile of the map.
    """
    block = _LAYOUT.find_points(data)
    if block is None or not block.height or not block.width:
        raise CodecError("the cloud does not have the points of a tile", ErrorCode.FIELDS)
    shape = (block.height, block.width)
    points = np.frombuffer(data, TERRAIN_TILE, block.height * block.width, block.offset)
    points = points.reshape(shape)
    for name in _ROUND_FIELDS:
        if (points[name] != points[name][0, 0]).any():
            raise CodecError(f"the tile's {name} is not the same in every point", ErrorCode.VALUE)
    first = points[0, 0]
    tile_round = TileRound(*(int(first[name]) for name in _ROUND_FIELDS))
    row, col = int(first["row"]), int(first["col"])
    is_inside = row < tile_round.map_rows and col < tile_round.map_cols
    outline = _outline(row, col, tile_round.shape) if is_inside else TileOutline(row, col, 0, 0)
    is_block = (points["row"] == np.arange(row, row + block.height)[:, np.newaxis]).all() and (
        points["col"] == np.arange(col, col + block.width)
    ).all()
    is_tile = row % TILE_SIZE == 0 and col % TILE_SIZE == 0 and outline[2:] == shape
    if not is_block or not is_tile:
        raise CodecError(
            f"{block.height} x {block.width} points from row {row}, column {col} on are no tile of"
            f" a map of {tile_round.map_rows} x {tile_round.map_cols} columns",
            ErrorCode.GRID,
        )
    total = num_tiles_of(tile_round.shape)
    is_possible = tile_round.num_tiles == total or (
        not tile_round.is_full and 0 < tile_round.num_tiles < total
    )
    if not is_possible or tile_round.base_revision > tile_round.revision:
        raise CodecError(
            f"a round of {tile_round.num_tiles} of {total} tiles from revision"
            f" {tile_round.base_revision} to {tile_round.revision} is not possible",
            ErrorCode.VALUE,
        )
    return TerrainTile(tile_round, outline, points.view(_CELL_OF_TILE)["cell"])


def num_tiles_of(shape: tuple[int, int]) -> int:
    """Return the number of tiles of a map of a shape."""
    return -(-shape[0] // TILE_SIZE) * -(-shape[1] // TILE_SIZE)


def _outline(row: int, col: int, shape: tuple[int, int]) -> TileOutline:
    return TileOutline(row, col, min(TILE_SIZE, shape[0] - row), min(TILE_SIZE, shape[1] - col))
