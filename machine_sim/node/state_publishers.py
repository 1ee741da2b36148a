"""Topics of one machine: state, payload, wrenches, transforms, markers, applied commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import (
    BaseState,
    JointValues,
    PayloadState,
    TrackValues,
    to_command_state,
    to_cylinder_array,
    to_joint_state,
    to_payload_array,
    to_track_array,
)
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.poses import (
    ToolWrench,
    to_odometry,
    to_tf_message,
    to_transforms,
    to_wrench,
)
from msg_bridge.contract import topics
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.contract.topics import MAP_FRAME, parent_namespace, resolve

__all__ = ["StatePublishers"]


class StatePublishers:
    """Publishers of one machine's state, in its node's namespace or one below it."""

    def __init__(
        self,
        node: Node,
        topic_prefix: str = "",
        *,
        frame_prefix: str,
        command_names: Sequence[str],
        frames: Sequence[str],
        tool_frames: Mapping[str, str],
        has_payload: bool,
        markers: MarkerSet,
        publish_tf: bool,
    ) -> None:
        """
        Args:
            node: node of the publishers.
            topic_prefix: prefix of each topic: empty, or a machine's name and a slash.
            frame_prefix: prefix of each frame.
            command_names: names of joints and tracks.
            frames: frames of the links, the base first, then of the parts that are only shown.
            tool_frames: frame of each tool, by the tool's name.
            has_payload: whether the machine publishes a payload.
            markers: visuals of the machine.
            publish_tf: whether to publish `tf` where its message is installed.
        """
        self._command_names = tuple(command_names)
        self._frames = [frame_prefix + frame for frame in frames]
        self._tool_frames = {tool: frame_prefix + frame for tool, frame in tool_frames.items()}
        self._markers = markers

        def publisher(kind: type, topic: str, profile: QoSProfile = qos.STATE) -> Publisher:
            return node.create_publisher(kind, topic_prefix + topic, profile)

        # A replay needs each of them.
        self._applied = publisher(JointState, topics.APPLIED_COMMANDS, qos.ROWS)
        self._joints = publisher(JointState, topics.JOINT_STATES)
        self._odom = publisher(Odometry, topics.ODOM)
        self._cylinders = publisher(Float64MultiArray, topics.CYLINDERS)
        self._tracks = publisher(Float64MultiArray, topics.TRACKS)
        self._payload = publisher(Float64MultiArray, topics.PAYLOAD) if has_payload else None
        self._wrenches = {
            tool: publisher(WrenchStamped, topics.wrench_topic(tool)) for tool in tool_frames
        }
        self._transforms = publisher(TransformStamped, topics.TRANSFORMS, qos.ROWS)
        self._marker_array = publisher(MarkerArray, topics.MARKERS)
        self._description = publisher(String, topics.ROBOT_DESCRIPTION, qos.TRANSIENT_LOCAL)
        tf = to_tf_message([]) if publish_tf else None
        tf_topic = resolve(topics.TF, parent_namespace(node.get_namespace()))
        self._tf = None if tf is None else node.create_publisher(type(tf), tf_topic, qos.STATE)

    def publish_description(self, urdf: str) -> None:
        """Publish the robot description (URDF)."""
        self._description.publish(String(data=urdf))

    def publish_applied_command(self, velocities: ArrayLike, stamp: Time) -> None:
        """Publish the command that takes effect in the tick that ends at `stamp`.

        Args:
            velocities: velocities of the joints [rad/s], then of the tracks [m/s].
            stamp: end of the tick.
        """
        self._applied.publish(to_command_state(self._command_names, velocities, stamp))

    def publish_state(
        self,
        joints: JointValues,
        base: BaseState,
        payload: PayloadState,
        wrenches: Mapping[str, ToolWrench],
        stamp: Time,
    ) -> None:
        """Publish joints, base, payload, and the wrench of the soil on each tool."""
        self._joints.publish(to_joint_state(joints, base, stamp))
        self._odom.publish(to_odometry(base, self._frames[0], stamp, frame_id=MAP_FRAME))
        if self._payload is not None:
            self._payload.publish(to_payload_array(payload))
        for tool, wrench in wrenches.items():
            self._wrenches[tool].publish(to_wrench(*wrench, self._tool_frames[tool], stamp))

    def publish_cylinders(self, cylinders: Mapping[str, CylinderState], time: float) -> None:
        """Publish the state of the cylinders by joint at simulation time `time` [s]."""
        self._cylinders.publish(to_cylinder_array(cylinders, time))

    def publish_tracks(self, left: TrackValues, right: TrackValues, time: float) -> None:
        """Publish the state of the tracks at simulation time `time` [s]."""
        self._tracks.publish(to_track_array(left, right, time))

    def publish_transforms(self, positions: ArrayLike, quaternions: ArrayLike, stamp: Time) -> None:
        """Publish the pose of every link in the map, with the parts that are only shown."""
        messages = to_transforms(self._frames, positions, quaternions, stamp)
        for message in messages:
            self._transforms.publish(message)
        if self._tf is not None:
            self._tf.publish(to_tf_message(messages))

    def publish_markers(
        self, link_poses: tuple[ArrayLike, ArrayLike], shoe_poses: ArrayLike, stamp: Time
    ) -> None:
        """Publish the markers of links and shoes."""
        self._marker_array.publish(self._markers.at(link_poses, shoe_poses, stamp))
