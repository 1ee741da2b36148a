"""What a machine tells everybody: its state, its load, its particles, what it is told to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import (
    COMMAND_NAMES,
    BaseState,
    PayloadState,
    to_command_state,
    to_cylinder_array,
    to_joint_state,
    to_payload_array,
)
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.poses import to_odometry, to_tf_message, to_transforms, to_wrench
from msg_bridge.contract.cylinders import CylinderState
from msg_bridge.nodes.topics import MAP_FRAME

__all__ = ["JointValues", "MachineTopics", "ToolWrench"]


@dataclass(frozen=True)
class ToolWrench:
    """The soil's reaction at the tool, map frame.

    Attributes:
        force: [N], shape (3,).
        torque: about the tool frame's origin [N m], shape (3,).
        rotation: tool to map, shape (3, 3).
    """

    force: ArrayLike
    torque: ArrayLike
    rotation: ArrayLike


@dataclass(frozen=True)
class JointValues:
    """Joints with their angles [rad] or lengths [m], speeds and efforts [N m] or [N], by name."""

    names: Sequence[str]
    positions: ArrayLike
    velocities: ArrayLike
    efforts: ArrayLike


class MachineTopics:
    """Publishers of one machine's state, in its node's namespace."""

    def __init__(
        self,
        node: Node,
        *,
        prefix: str,
        link_frames: Sequence[str],
        tool_frame: str,
        markers: MarkerSet,
        publish_tf: bool,
    ) -> None:
        """
        Args:
            node: whose topics they are.
            prefix: put before each frame's name.
            link_frames: frames of the links from the base to the tool, then of what is only seen.
            tool_frame: that of the tool.
            markers: how the machine looks.
            publish_tf: whether to publish `/tf` where its message is installed.
        """
        self._frames = [prefix + frame for frame in link_frames]
        self._tool_frame = prefix + tool_frame
        self._links = list(link_frames).index(tool_frame) + 1
        self._markers = markers
        publisher = node.create_publisher
        self._applied = publisher(JointState, "applied_commands", qos.STATE)
        self._joints = publisher(JointState, "joint_states", qos.STATE)
        self._odom = publisher(Odometry, "odom", qos.STATE)
        self._cylinders = publisher(Float64MultiArray, "cylinders", qos.STATE)
        self._payload = publisher(Float64MultiArray, "payload", qos.STATE)
        self._wrench = publisher(WrenchStamped, "bucket/wrench", qos.STATE)
        self._particles = publisher(PointCloud2, "particles", qos.STATE)
        self._transforms = publisher(TransformStamped, "transforms", qos.STATE)
        self._marker_array = publisher(MarkerArray, "markers", qos.STATE)
        self._hash = publisher(String, "state_hash", qos.STATE)
        self._description = publisher(String, "robot_description", qos.LATCHED)
        self._config = publisher(String, "config", qos.LATCHED)
        tf = to_tf_message([]) if publish_tf else None
        self._tf = None if tf is None else publisher(type(tf), "/tf", qos.STATE)

    def describe(self, urdf: str, config: str) -> None:
        """Publish what the machine is: its URDF, and its parameters as YAML."""
        self._description.publish(String(data=urdf))
        self._config.publish(String(data=config))

    def applied(self, velocities: ArrayLike, stamp: Time) -> None:
        """Publish the command that takes effect in the tick that ends at `stamp`.

        Args:
            velocities: of the joints [rad/s], then the tracks [m/s], shape (6,).
            stamp: end of the tick.
        """
        self._applied.publish(to_command_state(COMMAND_NAMES, velocities, stamp))

    def state(
        self,
        joints: JointValues,
        base: BaseState,
        payload: PayloadState,
        wrench: ToolWrench,
        stamp: Time,
    ) -> None:
        """Publish joints, base, load and the soil's reaction."""
        values = (joints.positions, joints.velocities, joints.efforts)
        self._joints.publish(to_joint_state(*values, base, stamp, names=joints.names))
        self._odom.publish(to_odometry(base, self._frames[0], stamp, frame_id=MAP_FRAME))
        self._payload.publish(to_payload_array(payload))
        reaction = to_wrench(wrench.force, wrench.torque, wrench.rotation, self._tool_frame, stamp)
        self._wrench.publish(reaction)

    def cylinders(self, cylinders: Mapping[str, CylinderState], time: float) -> None:
        """Publish the cylinders by joint, as of `time` [s]."""
        self._cylinders.publish(to_cylinder_array(cylinders, time))

    def transforms(self, positions: ArrayLike, quaternions: ArrayLike, stamp: Time) -> None:
        """Publish the pose of every link in the map; of what is only seen on `/tf` alone."""
        messages = to_transforms(self._frames, positions, quaternions, stamp)
        for message in messages[: self._links]:
            self._transforms.publish(message)
        if self._tf is not None:
            self._tf.publish(to_tf_message(messages))

    def markers(
        self, link_poses: tuple[ArrayLike, ArrayLike], shoe_poses: ArrayLike, stamp: Time
    ) -> None:
        """Publish how the machine looks."""
        self._marker_array.publish(self._markers.at(link_poses, shoe_poses, stamp))

    def particles(self, store: Any, stamp: Time) -> None:
        """Publish all particles; `store` has position, velocity, radius, ids, volumes, soils."""
        cloud = to_particle_cloud(
            store.position,
            store.velocity,
            store.radius,
            store.particle_id,
            store.volume_mm3,
            store.soil,
            MAP_FRAME,
            stamp,
        )
        self._particles.publish(cloud)

    def state_hash(self, tick: int, digest: str) -> None:
        """Publish the hash [hex] of the machine's state after a tick, as `tick digest`."""
        self._hash.publish(String(data=f"{tick} {digest}"))
