"""Make `/terrain/grid_map` from `/terrain/map` where no node publishes it.

The package grid_map_msgs is not on PyPI, so a soil whose ROS is installed from wheels publishes
only the point cloud, which has the same layers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.grid_map import grid_map_to_cdr
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract import topics
from msg_bridge.raw_topics.graph_topics import GraphTopics
from msg_bridge.raw_topics.received_message import ReceivedMessage

__all__ = ["GRID_MAP_QOS", "GridMapFromTerrain"]

_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
_NANO = 10**9

GRID_MAP_QOS = OfferedQos(durability="transient_local", history="keep_last", depth=1)
"""QoS of `/terrain/grid_map`, for players."""


class GridMapFromTerrain:
    """Converts messages on `/terrain/map` to messages on `/terrain/grid_map`, not more often."""

    def __init__(self, graph_topics: GraphTopics, period: float) -> None:
        """
        Args:
            graph_topics: the subscribed topics. A `terrain/grid_map` among them is not made.
            period: minimum simulation time between two messages [s].
        """
        self._graph_topics = graph_topics
        self._period = round(period * _NANO)
        self._last: dict[str, int] = {}  # stamp of the last message [ns] by topic
        self._num_made: dict[str, int] = {}  # by topic

    def convert(self, messages: Sequence[ReceivedMessage]) -> Iterator[ReceivedMessage]:
        """Yield GridMaps made from received messages; malformed maps are skipped.

        Args:
            messages: received messages of any topic, in their order.
        """
        for message in messages:
            topic = self._grid_map_topic(message.topic)
            if topic is not None and self._is_due(topic, message.data):
                made = self._make(topic, message)
                if made is not None:
                    yield made

    def _grid_map_topic(self, topic: str) -> str | None:
        """Return the topic to make from a topic; None for other topics, and if it is received."""
        namespace, _, rest = topic.rpartition(f"/{topics.TERRAIN_MAP}")
        if rest or not topic.endswith(topics.TERRAIN_MAP):
            return None
        grid_map_topic = f"{namespace}/{topics.TERRAIN_GRID_MAP}"
        is_cloud = self._graph_topics.type_name(topic) == _CLOUD_TYPE
        return (
            None if not is_cloud or grid_map_topic in self._graph_topics.topics else grid_map_topic
        )

    def _is_due(self, topic: str, data: bytes) -> bool:
        """Return whether one period passed since the last message; a reset counts as a period."""
        if len(data) < len(LITTLE_ENDIAN) + STAMP.size:
            return False
        seconds, nanoseconds = STAMP.unpack_from(data, len(LITTLE_ENDIAN))
        stamp, last = seconds * _NANO + nanoseconds, self._last.get(topic)
        if last is not None and 0 <= stamp - last < self._period:
            return False
        self._last[topic] = stamp
        return True

    def _make(self, topic: str, message: ReceivedMessage) -> ReceivedMessage | None:
        begin = len(LITTLE_ENDIAN)
        try:
            cloud = deserialize_message(message.data, PointCloud2)
            stamp = message.data[begin : begin + STAMP.size]
            data = grid_map_to_cdr(from_terrain_cloud(cloud), cloud.header.frame_id, stamp)
        except (CodecError, RuntimeError):  # rclpy raises RuntimeError for bytes cut short
            return None
        number = self._num_made[topic] = self._num_made.get(topic, 0) + 1
        return ReceivedMessage(topic, data, message.received_time, message.source_time, number)
