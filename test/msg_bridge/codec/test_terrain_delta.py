"""A terrain map is restored to the last bit from a keyframe and its difference from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.codec.terrain import TERRAIN_CELL, TerrainMap, to_terrain_cloud
from msg_bridge.codec.terrain_delta import (
    TERRAIN_DELTA,
    apply_delta,
    base_of_delta,
    encode_delta,
    keyframe_identity,
)
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

SHAPE = (7, 9)


def terrain(*, revision: int = 1, run_id: int = 5, shape: tuple[int, int] = SHAPE) -> TerrainMap:
    grid = Grid(rows=shape[0], cols=shape[1], cell=0.1)
    rng = np.random.default_rng(3)
    volume = rng.integers(1, 10**9, grid.shape)
    layer = np.zeros(grid.shape, np.uint8)
    keyframe = Keyframe(run_id, revision, grid, volume / 1e7, volume, layer, layer)
    return TerrainMap(keyframe, np.zeros(grid.shape))  # design_difference is NaN


def to_cdr(terrain: TerrainMap, time: float = 0.0) -> bytes:
    return serialize_message(to_terrain_cloud(terrain, "map", stamp_from_seconds(time)))


def decoded(data: bytes | None) -> PointCloud2:
    """Return the message of CDR bytes, whose padding is undefined."""
    assert data is not None
    return deserialize_message(data, PointCloud2)


def changed(columns: int, *, revision: int) -> TerrainMap:
    """Return the terrain with other volumes in some columns."""
    before = terrain(revision=revision)
    volume = before.keyframe.volume_mm3.copy()
    volume.ravel()[:columns] += 1  # too little to change the float32 height
    return replace(before, keyframe=replace(before.keyframe, volume_mm3=volume))


@pytest.mark.parametrize("columns", [0, 1, 30])
def test_map_is_restored_to_the_last_bit(columns: int) -> None:
    keyframe, new = to_cdr(terrain()), to_cdr(changed(columns, revision=4), time=2.5)
    delta = encode_delta(keyframe, new)
    assert delta is not None
    assert decoded(apply_delta(keyframe, delta)) == decoded(new)
    message = deserialize_message(delta, PointCloud2)
    rows = from_point_cloud(message, TERRAIN_DELTA)
    assert rows["cell"].tolist() == list(range(max(columns, 1)))
    assert (rows["base_revision"] == 1).all()
    assert (message.header.frame_id, message.header.stamp.sec) == ("map", 2)
    assert (base_of_delta(delta), keyframe_identity(new)) == ((5, 1), (5, 4))


@pytest.mark.parametrize(
    "new",
    [
        to_cdr(changed(63, revision=2)),  # larger than the map
        to_cdr(terrain(shape=(9, 8))),
        to_cdr(terrain())[:-20],
        b"",
    ],
    ids=["all columns changed", "other grid", "cut short", "empty"],
)
def test_map_that_cannot_be_a_smaller_difference_has_none(new: bytes) -> None:
    assert encode_delta(to_cdr(terrain()), new) is None


def test_transposed_grid_has_no_difference() -> None:
    """It has the same number of columns, so only the restored bytes show it."""
    assert encode_delta(to_cdr(terrain()), to_cdr(terrain(shape=SHAPE[::-1]))) is None


def test_delta_is_applied_to_its_own_keyframe_only() -> None:
    delta = encode_delta(to_cdr(terrain()), to_cdr(changed(1, revision=4)))
    assert delta is not None
    for other in (terrain(revision=2), terrain(run_id=6), terrain(shape=(2, 2))):
        assert apply_delta(to_cdr(other), delta) is None or other.keyframe.grid.rows == 2
    rows_beyond = encode_delta(to_cdr(terrain()), to_cdr(changed(30, revision=4)))
    assert rows_beyond is not None
    assert apply_delta(to_cdr(terrain(shape=(2, 2))), rows_beyond) is None
    assert apply_delta(to_cdr(terrain()), delta[:-20]) is None


def without_ruts(data: bytes) -> bytes:
    """Return a map, or a delta, of the rows of older bags, which had no `rut_depth`."""
    message = deserialize_message(data, PointCloud2)
    dtype = TERRAIN_DELTA if len(message.fields) == len(TERRAIN_DELTA.names or ()) else TERRAIN_CELL
    rows = from_point_cloud(message, dtype)
    names = [name for name in dtype.names or () if name != "rut_depth"]
    older = np.empty(rows.size, np.dtype([(name, dtype[name]) for name in names]))
    for name in names:
        older[name] = rows[name]
    header = message.header
    cloud = to_point_cloud(older, header.frame_id, header.stamp, height=message.height)
    return bytes(serialize_message(cloud))


def test_delta_of_older_maps_is_applied_to_older_maps_only() -> None:
    keyframe, new = to_cdr(terrain()), to_cdr(changed(30, revision=4), time=2.5)
    delta = encode_delta(keyframe, new)
    assert delta is not None
    older = without_ruts(delta)
    restored = apply_delta(without_ruts(keyframe), older)
    assert decoded(restored) == decoded(without_ruts(new))
    assert (base_of_delta(older), keyframe_identity(without_ruts(new))) == ((5, 1), (5, 4))
    assert apply_delta(keyframe, older) is None
