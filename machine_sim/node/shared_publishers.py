"""Topics that the machines of a node share: particles, state hash, parameters, bins."""

from __future__ import annotations

from collections.abc import Iterable

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, String

from machine_sim.dem import SoilEngine
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import PayloadState, to_payload_array
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.state_hash import StateHash, to_state_hash_string
from msg_bridge.contract import topics
from msg_bridge.contract.topics import MAP_FRAME

__all__ = ["SharedPublishers"]


class SharedPublishers:
    """Publishers in the namespace of a machine node."""

    def __init__(self, node: Node, bins: Iterable[str] = ()) -> None:
        """
        Args:
            node: node of the publishers.
            bins: names of the bins.
        """
        self._particles = node.create_publisher(PointCloud2, topics.PARTICLES, qos.STATE)
        self._hash = node.create_publisher(String, topics.MACHINE_STATE_HASH, qos.STATE)
        self._config = node.create_publisher(String, topics.MACHINE_CONFIG, qos.TRANSIENT_LOCAL)
        self._payloads = {
            name: node.create_publisher(
                Float64MultiArray, topics.bin_payload_topic(name), qos.STATE
            )
            for name in bins
        }

    def publish_config(self, text: str) -> None:
        """Publish the node's parameters as YAML."""
        self._config.publish(String(data=text))

    def publish_payload(self, name: str, payload: PayloadState) -> None:
        """Publish the payload of a bin."""
        self._payloads[name].publish(to_payload_array(payload))

    def publish_particles(self, particles: SoilEngine, stamp: Time) -> None:
        """Publish all particles of an engine."""
        cloud = to_particle_cloud(
            particles.positions,
            particles.velocities,
            particles.radii,
            particles.ids,
            particles.volumes_mm3,
            particles.soil,
            MAP_FRAME,
            stamp,
        )
        self._particles.publish(cloud)

    def publish_state_hash(self, state_hash: StateHash) -> None:
        """Publish the hash of the machines' state after a tick."""
        self._hash.publish(to_state_hash_string(state_hash))
