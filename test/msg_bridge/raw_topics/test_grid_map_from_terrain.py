"""`/terrain/grid_map` made from the terrain map, in bags."""

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import PointCloud2
from support.recorder_scenes import spin_until_recorded

from msg_bridge.bag.bundled_types import GRID_MAP_TYPE
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

GRID = Grid(3, 5, 0.5)
SELECTED = "^/terrain/"


def terrain(time: float) -> PointCloud2:
    """Return a map whose heights are 0, 1, 2 ... [m] in row-major order."""
    heights = np.arange(15.0).reshape(GRID.shape)
    layer = np.zeros(GRID.shape, np.uint8)
    volume = np.full(GRID.shape, 10**9, np.int64)
    keyframe = Keyframe(7, 1, GRID, heights, volume, layer, layer)
    cloud = TerrainMap(keyframe, np.zeros(GRID.shape))
    return to_terrain_cloud(cloud, "map", stamp_from_seconds(time))


def record(ros, node, times) -> None:
    """Publish maps at simulation times [s] and wait until they are recorded."""
    publisher = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    for number, time in enumerate(times, start=1):
        publisher.publish(terrain(time))
        ros.spin_until(lambda number=number: node.recording.messages >= number)
    node.stop()


def test_bag_has_a_grid_map_that_independent_readers_decode(ros, recorder, tmp_path):
    node = recorder(include=SELECTED)
    record(ros, node, [1.0])
    with AnyReader([tmp_path / "dig"]) as reader:
        of_map = [each for each in reader.connections if each.topic == "/terrain/grid_map"]
        ((connection, _, data),) = reader.messages(of_map)
        message = reader.deserialize(data, connection.msgtype)
    assert connection.msgtype == GRID_MAP_TYPE
    elevation = message.data[message.layers.index("elevation")]
    columns, rows = elevation.layout.dim
    heights = np.array(elevation.data).reshape(columns.size, rows.size).T
    assert np.array_equal(heights, np.arange(15.0).reshape(GRID.shape))
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        decoding = make_reader(file, decoder_factories=[DecoderFactory()])
        ((*_, decoded),) = decoding.iter_decoded_messages("/terrain/grid_map")
    assert decoded.info.resolution == GRID.cell
    assert decoded.header.frame_id == "map"


def counts(folder) -> dict[str, int]:
    with Reader(folder) as reader:
        return {each.topic: each.msgcount for each in reader.connections}


def test_grid_maps_are_a_period_of_simulation_time_apart(ros, recorder, tmp_path):
    node = recorder(
        include=SELECTED,
        grid_map_period=10.0,
        repeat_transient_local_period=0.0,
        terrain_keyframe_period=0.0,
    )
    record(ros, node, [1.0, 2.0, 10.9, 11.0, 20.0, 0.5])  # the last after a reset
    assert counts(tmp_path / "dig") == {"/terrain/map": 6, "/terrain/grid_map": 3}


def test_grid_map_is_not_made_without_a_period_or_if_not_selected(ros, recorder, tmp_path):
    node = recorder(include=SELECTED, grid_map_period=0.0, path=str(tmp_path / "without"))
    other = recorder(include="^/terrain/map$", path=str(tmp_path / "other"))
    publisher = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=2)
    publisher.publish(terrain(1.0))
    for each in (node, other):
        spin_until_recorded(ros, each, 1)
        each.stop()
        assert each.recording.topics == ("/terrain/map",)
