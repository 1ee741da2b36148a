"""Publish a terrain as one map."""

from __future__ import annotations

from collections.abc import Callable

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2

from msg_bridge.codec import qos
from msg_bridge.codec.grid_map import grid_map_type, to_grid_map
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.terrain_images import to_elevation_image
from msg_bridge.contract import topics
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import MAP_FRAME
from soil_sim.node.soil_run import SoilRun

__all__ = ["MapPublication", "MapPublishers"]


class MapPublishers:
    """Publishers of a terrain as cloud, image and, where it is installed, GridMap."""

    def __init__(self, node: Node) -> None:
        """
        Args:
            node: node of the publishers.
        """
        self._map = node.create_publisher(PointCloud2, topics.TERRAIN_MAP, qos.TRANSIENT_LOCAL)
        self._elevation = node.create_publisher(
            Image, topics.TERRAIN_ELEVATION, qos.TRANSIENT_LOCAL
        )
        kind = grid_map_type()
        self._grid_map = kind and node.create_publisher(
            kind, topics.TERRAIN_GRID_MAP, qos.TRANSIENT_LOCAL
        )

    def publish(self, terrain: TerrainMap, stamp: Time) -> None:
        """Publish a terrain with all layers."""
        self._map.publish(to_terrain_cloud(terrain, MAP_FRAME, stamp))
        self._elevation.publish(to_elevation_image(terrain.keyframe, MAP_FRAME, stamp))
        if self._grid_map is not None:
            self._grid_map.publish(to_grid_map(terrain, MAP_FRAME, stamp))


class MapPublication:
    """Publishes the terrain of a run."""

    def __init__(self, node: Node, run: SoilRun, terrain: Callable[[], TerrainMap]) -> None:
        """
        Args:
            node: the soil node.
            run: the run of the soil, which a reset begins again.
            terrain: returns the present terrain.
        """
        self._run, self._terrain = run, terrain
        self._publishers = MapPublishers(node)
        self._revision = -1

    def begin(self, stamp: Time) -> None:
        """Publish the terrain with which a run begins, or continues."""
        self.send_all(stamp)

    def record_tick(self, map_updates: Rows, stamp: Time) -> None:
        """Do nothing: a map is made of the terrain as it is when it is published."""

    def publish_if_changed(self, stamp: Time) -> None:
        """Publish the terrain if it has changed since it was published."""
        if self._run.endpoint.soil.revision != self._revision:
            self.send_all(stamp)

    def send_all(self, stamp: Time) -> None:
        """Publish the present terrain."""
        terrain = self._terrain()
        self._revision = terrain.keyframe.revision
        self._publishers.publish(terrain, stamp)

    def update_for_new_subscribers(self, stamp: Time) -> None:
        """Do nothing: a new subscriber receives the last map."""
