"""Updates that a map lacks are found by their revision, wherever they are in the bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from support.recorded_messages import Recording

from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, RowChunk, Stream
from msg_bridge.contract.rows import MAP_UPDATE, empty_rows
from msg_bridge.player.map_updates import find_map_updates

MAP, UPDATES = "/terrain/map", "/terrain/map_updates"
UNREADABLE = PointCloud2(data=[0])
GRID = Grid(rows=2, cols=3, cell=1.0)


def terrain_map(revision: int, run_id: int = 1) -> PointCloud2:
    zeros, layer = np.zeros(GRID.shape), np.zeros(GRID.shape, np.uint8)
    volume = np.zeros(GRID.shape, np.int64)
    frame = Keyframe(run_id, revision, GRID, zeros, volume, layer, layer)
    return to_terrain_cloud(TerrainMap(frame, zeros), "map", Time())


def update(revision: int, run_id: int = 1) -> PointCloud2:
    rows = empty_rows(MAP_UPDATE, 2)
    rows["seq"], rows["revision"] = [2 * revision - 1, 2 * revision], revision
    return to_chunk_cloud(RowChunk(run_id, Stream.MAP_UPDATE, 0, 0, rows), "map", Time())


@pytest.mark.parametrize(
    ("messages", "expected"),
    [
        ([update(1), terrain_map(1), update(2), update(3)], [2, 3]),
        ([terrain_map(1), update(2), update(3), terrain_map(1), update(4)], [1, 2, 4]),
        ([update(1), update(2), terrain_map(1)], [1]),
        ([update(8, run_id=1), terrain_map(0, run_id=2), update(1, run_id=2)], [2]),
        ([update(1), PointCloud2(), update(2)], [2]),
        ([terrain_map(3), update(4), update(2), update(5), terrain_map(3), update(6)], [1, 3, 5]),
        ([UNREADABLE, terrain_map(3), UNREADABLE, update(2), update(4)], [2, 4]),
    ],
    ids=[
        "behind it",
        "repeated",
        "received late",
        "next run",
        "of another program",
        "sent again",
        "of an earlier format",
    ],
)
def test_updates_of_a_map_are_those_of_later_revisions(
    tmp_path: Path, messages: list[PointCloud2], expected: list[int]
) -> None:
    recording = Recording()
    for message in messages:
        is_map = not message.data or "design_difference" in {each.name for each in message.fields}
        recording.add(MAP if is_map else UPDATES, message)
    index = BagReader(recording.write(tmp_path / "bag.mcap")).index([MAP, UPDATES])
    last_map = index.latest(MAP, index.size)
    assert last_map is not None
    assert find_map_updates(index, UPDATES, last_map, index.size) == expected
    assert find_map_updates(index, UPDATES, last_map, expected[-1]) == expected[:-1]
    index.close()
