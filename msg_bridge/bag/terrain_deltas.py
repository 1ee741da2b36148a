"""Topics of bags on which terrain maps are stored as deltas, and the maps that they restore.

A recorder writes a map in full now and then, and in between as its difference from the last full
map (`msg_bridge.codec.terrain_delta`) on the topic `terrain/map_deltas`, which exists in bags only.
"""

from __future__ import annotations

from typing import Final

from mcap.records import Channel

from msg_bridge.bag.mcap_index import McapFile
from msg_bridge.codec.terrain_delta import apply_delta, base_of_delta, keyframe_identity
from msg_bridge.contract import topics

__all__ = [
    "CLOUD_TYPE",
    "TerrainRestorer",
    "deltas_topic",
    "has_deltas",
    "is_map_topic",
    "map_topic_of_deltas",
]

CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
"""Type of maps and deltas."""

_MAP, _DELTAS = f"/{topics.TERRAIN_MAP}", f"/{topics.TERRAIN_MAP}_deltas"
_MAX_RUNS = 2


def is_map_topic(topic: str, type_name: str) -> bool:
    """Return whether a topic has terrain maps, in any namespace."""
    return topic.endswith(_MAP) and type_name == CLOUD_TYPE


def deltas_topic(map_topic: str) -> str:
    """Return the topic of the deltas of maps on a topic."""
    return map_topic.removesuffix(_MAP) + _DELTAS


def map_topic_of_deltas(topic: str, type_name: str) -> str | None:
    """Return the topic of the maps that a topic of deltas restores; None for other topics."""
    if not topic.endswith(_DELTAS) or type_name != CLOUD_TYPE:
        return None
    return topic.removesuffix(_DELTAS) + _MAP


def has_deltas(file: McapFile, channel: Channel) -> bool:
    """Return whether a channel of ROS 2 messages has maps as deltas."""
    schema = file.schemas.get(channel.schema_id)
    return schema is not None and map_topic_of_deltas(channel.topic, schema.name) is not None


class TerrainRestorer:
    """Restores the maps of one topic from full maps and deltas, in the order of the bag."""

    def __init__(self) -> None:
        # The last full map of each run: with simulation time, a reset makes log times begin again,
        # and messages of two runs alternate.
        self._keyframes: dict[int, bytes] = {}

    def add_keyframe(self, data: bytes) -> None:
        """Keep a full map for the deltas that follow; another message is ignored."""
        identity = keyframe_identity(data)
        if identity is None:
            return
        self._keyframes.pop(identity[0], None)
        self._keyframes[identity[0]] = data
        if len(self._keyframes) > _MAX_RUNS:
            del self._keyframes[next(iter(self._keyframes))]

    def restore(self, delta: bytes) -> bytes | None:
        """Return the map of a delta; None if its keyframe is missing, or it is no delta."""
        base = base_of_delta(delta)
        keyframe = None if base is None else self._keyframes.get(base[0])
        return None if keyframe is None else apply_delta(keyframe, delta)
