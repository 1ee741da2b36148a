"""Tiles of a large terrain, and the maps that are assembled from them."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.cdr import rows_to_cdr
from msg_bridge.codec.cloud_layout import layout_of_dtype
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud
from msg_bridge.codec.terrain import TERRAIN_CELL, TerrainMap, cells_of_terrain, keyframe_of_cells
from msg_bridge.codec.terrain_tiles import (
    TERRAIN_TILE,
    TILE_SIZE,
    TileOutline,
    TileRound,
    num_tiles_of,
    tile_from_cdr,
    tile_outlines,
    tile_to_cdr,
)
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows

GRID = Grid(86, 142, 0.2)
"""2 x 3 tiles, those at the edges smaller."""

STAMP = Time(sec=3, nanosec=7)
OUTLINES = tuple(tile_outlines(GRID.shape))


def terrain_cells(seed: int, revision: int = 5) -> Rows:
    """Return the points of a map with random heights and volumes."""
    rng = np.random.default_rng(seed)
    height = rng.uniform(-1.0, 1.0, GRID.shape).astype(np.float32).astype(np.float64)
    volume = rng.integers(0, 10**12, GRID.shape)
    keyframe = Keyframe(9, revision, GRID, height, volume)
    return cells_of_terrain(TerrainMap(keyframe, np.abs(height)))


def tiles_of(
    cells: Rows,
    revision: int,
    base: int | None = None,
    outlines: tuple[TileOutline, ...] = OUTLINES,
) -> list[bytes]:
    """Return the serialised tiles of a round."""
    base = revision if base is None else base
    tile_round = TileRound(9, revision, base, len(outlines), *GRID.shape)
    return [tile_to_cdr(cells, outline, tile_round, "map", STAMP) for outline in outlines]


def add_all(assembly: TileAssembly, tiles: list[bytes]) -> list[bool]:
    return [assembly.add(tile_from_cdr(each)) for each in tiles]


def test_tiles_partition_the_map() -> None:
    covered = np.zeros(GRID.shape, dtype=int)
    for outline in OUTLINES:
        covered[outline.slices] += 1
    assert (covered == 1).all()
    assert len(OUTLINES) == num_tiles_of(GRID.shape) == 6


def test_tile_is_a_cloud_with_the_fields_of_a_map() -> None:
    cells = terrain_cells(1)
    msg = deserialize_message(tiles_of(cells, 8)[4], PointCloud2)
    outline = OUTLINES[4]
    assert (msg.height, msg.width, msg.header.frame_id) == (22, TILE_SIZE, "map")
    assert msg.header.stamp == STAMP
    points = from_point_cloud(msg, TERRAIN_CELL).reshape(outline.num_rows, outline.num_cols)
    expected = cells[outline.slices].copy()
    expected["revision"] = 8
    assert points.tobytes() == expected.tobytes()


def test_map_is_assembled_from_tiles_in_any_order() -> None:
    cells, assembly = terrain_cells(2), TileAssembly()
    tiles = tiles_of(cells, 8)
    order = np.random.default_rng(3).permutation(len(tiles))
    added = add_all(assembly, [tiles[k] for k in order[[0, 0, 1, 2, 3, 4, 5]]])
    assert added == [False] * 6 + [True]
    assert (assembly.run_id, assembly.revision) == (9, 8)
    assert assembly.cells is not None
    keyframe = keyframe_of_cells(assembly.cells, cell=GRID.cell)
    assert keyframe.revision == 8
    assert np.array_equal(keyframe.volume_mm3, cells["volume_mm3"].astype(np.int64))
    assert np.array_equal(keyframe.elevation, cells["z"].astype(np.float64))


def test_changed_tiles_replace_those_of_the_round_before() -> None:
    first, second, assembly = terrain_cells(4), terrain_cells(5), TileAssembly()
    add_all(assembly, tiles_of(first, 8))
    changed = OUTLINES[1:3]
    assert add_all(assembly, tiles_of(second, 11, 8, changed)) == [False, True]
    assert assembly.cells is not None
    expected = first.copy()
    for outline in changed:
        expected[outline.slices] = second[outline.slices]
    expected["revision"] = 11
    assert assembly.cells.tobytes() == expected.tobytes()


def test_changes_after_a_lost_round_wait_for_the_next_full_one() -> None:
    cells, assembly = terrain_cells(6), TileAssembly()
    add_all(assembly, tiles_of(cells, 8))
    add_all(assembly, tiles_of(cells, 11, 8, OUTLINES[:2])[:1])  # its second tile is lost
    assert not any(add_all(assembly, tiles_of(cells, 12, 11, OUTLINES[:1])))
    assert assembly.revision == 8
    assert add_all(assembly, tiles_of(cells, 14))[-1]
    assert not any(add_all(assembly, tiles_of(cells, 11))), "an older round arrived late"
    assert assembly.revision == 14


def test_forged_tile_does_not_displace_the_round_that_is_being_received() -> None:
    cells, assembly = terrain_cells(7), TileAssembly()
    tiles, forged = tiles_of(cells, 8), tiles_of(cells, 2**32 - 1)
    assert not any(add_all(assembly, tiles[:3]))
    assembly.add(tile_from_cdr(forged[0]))
    assert add_all(assembly, tiles[3:])[-1]
    assert assembly.revision == 8


def test_incomplete_assembly_is_seen_until_there_is_a_map() -> None:
    tiles, assembly = tiles_of(terrain_cells(8), 8), TileAssembly()
    assert not assembly.is_incomplete
    add_all(assembly, tiles[:-1])
    assert assembly.is_incomplete
    add_all(assembly, tiles[-1:])
    assert not assembly.is_incomplete


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"row": 1}, ErrorCode.GRID),
        ({"col": 64}, ErrorCode.GRID),
        ({"map_rows": 60_000}, ErrorCode.GRID),
        ({"map_rows": 0}, ErrorCode.GRID),
        ({"num_tiles": 0}, ErrorCode.VALUE),
        ({"num_tiles": 7}, ErrorCode.VALUE),
        ({"num_tiles": 5}, ErrorCode.VALUE),  # of a full round
        ({"base_revision": 9}, ErrorCode.VALUE),
        ({"revision": [8] + [9] * 1407}, ErrorCode.VALUE),
    ],
)
def test_contradictory_tile_is_rejected(changes: dict[str, object], code: ErrorCode) -> None:
    data = tiles_of(terrain_cells(9), 8)[4]
    block = layout_of_dtype(TERRAIN_TILE).find_points(data)
    assert block is not None
    points = np.frombuffer(data, TERRAIN_TILE, block.height * block.width, block.offset).copy()
    for name, value in changes.items():
        points[name] = value
    with pytest.raises(CodecError) as caught:
        tile_from_cdr(rows_to_cdr(points, "map", STAMP, height=block.height))
    assert caught.value.code is code


def test_other_messages_are_no_tiles() -> None:
    data = tiles_of(terrain_cells(10), 8)[0]
    for each in (b"", data[:-100], rows_to_cdr(np.zeros(4, TERRAIN_CELL), "map", STAMP)):
        with pytest.raises(CodecError):
            tile_from_cdr(each)
