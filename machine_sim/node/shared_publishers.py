"""Topics that the machines of a node share: particles, state hash, parameters, bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

from machine_sim.dem import SoilEngine
from machine_sim.machine_contacts import MachineContact
from machine_sim.simulated_bin import BinSpec, SimulatedBin
from msg_bridge.codec import qos
from msg_bridge.codec.contacts import to_contact_string
from msg_bridge.codec.machine_state import PayloadState, to_payload_array
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.state_hash import StateHash, to_state_hash_string
from msg_bridge.contract import topics
from msg_bridge.contract.topics import MAP_FRAME

__all__ = ["SharedPublishers"]


_BIN_LINK = "walls"
"""Name of the marker namespace of a bin, below that of the bin."""

_BIN_COLOR = (0.35, 0.38, 0.42, 1.0)
"""Red, green, blue and alpha of a bin."""


class SharedPublishers:
    """Publishers in the namespace of a machine node."""

    def __init__(
        self,
        node: Node,
        bins: Mapping[str, BinSpec] | None = None,
        *,
        machines: Sequence[str] = (),
    ) -> None:
        """
        Args:
            node: node of the publishers.
            bins: bins by name; None for none.
            machines: names of the machines.
        """
        bins = bins or {}
        self._names = (*machines, *bins)
        self._contacts = (
            node.create_publisher(String, topics.CONTACTS, qos.ROWS)
            if len(self._names) > 1
            else None
        )
        self._particles = node.create_publisher(PointCloud2, topics.PARTICLES, qos.STATE)
        self._hash = node.create_publisher(String, topics.MACHINE_STATE_HASH, qos.STATE)
        self._config = node.create_publisher(String, topics.MACHINE_CONFIG, qos.TRANSIENT_LOCAL)
        self._payloads = {
            name: node.create_publisher(
                Float64MultiArray, topics.bin_payload_topic(name), qos.STATE
            )
            for name in bins
        }
        self._bin_markers = {
            name: node.create_publisher(MarkerArray, topics.bin_markers_topic(name), qos.STATE)
            for name in bins
        }
        self._bin_marker_sets = {
            name: MarkerSet(
                [_BIN_LINK],
                [
                    (_BIN_LINK, box.size, box.center, box.pitch, _BIN_COLOR)
                    for box in spec.shape.boxes()
                ],
                namespace=name,
                frame_id=MAP_FRAME,
            )
            for name, spec in bins.items()
        }

    def publish_config(self, text: str) -> None:
        """Publish the node's parameters as YAML."""
        self._config.publish(String(data=text))

    def publish_contact(self, contact: MachineContact, offset: float) -> None:
        """Publish a contact that has begun or ended.

        Args:
            contact: the contact.
            offset: simulation time at which the contact's times are 0 [s].
        """
        if self._contacts is None:
            return
        message = to_contact_string(
            [self._names[k] for k in contact.pair],
            start_time=offset + contact.start_time,
            end_time=offset + contact.end_time,
            max_force=contact.max_force,
            position=contact.position,
            is_over=contact.is_over,
        )
        self._contacts.publish(message)

    def publish_payload(self, name: str, payload: PayloadState) -> None:
        """Publish the payload of a bin."""
        self._payloads[name].publish(to_payload_array(payload))

    def publish_bin_markers(self, name: str, simulated: SimulatedBin, stamp: Time) -> None:
        """Publish the boxes of a bin."""
        poses = simulated.position[None], simulated.quaternion[None]
        self._bin_markers[name].publish(self._bin_marker_sets[name].at(poses, None, stamp))

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
