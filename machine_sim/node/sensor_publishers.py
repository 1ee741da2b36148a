"""Topics of the sensors of one machine."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from msg_bridge.codec import qos
from msg_bridge.codec.sensors import to_encoder_joint_state, to_imu
from msg_bridge.contract import topics

__all__ = ["SensorPublishers"]


class SensorPublishers:
    """Publishers of inertial units (`imu/<name>/data`) and encoders (`joint_states_measured`)."""

    def __init__(
        self, node: Node, topic_prefix: str = "", *, frame_prefix: str, imus: Sequence[str]
    ) -> None:
        """
        Args:
            node: node of the publishers.
            topic_prefix: prefix of each topic: empty, or a machine's name and a slash.
            frame_prefix: prefix of each frame.
            imus: names of the inertial units.
        """
        self._frame_prefix = frame_prefix
        self._imus = {
            name: node.create_publisher(Imu, topic_prefix + topics.imu_topic(name), qos.STATE)
            for name in imus
        }
        self._encoders = node.create_publisher(
            JointState, topic_prefix + topics.MEASURED_JOINT_STATES, qos.STATE
        )

    def publish_imu(
        self,
        name: str,
        frame: str,
        quaternion: ArrayLike,
        angular_velocity: ArrayLike,
        specific_force: ArrayLike,
        stamp: Time,
    ) -> None:
        """Publish the reading of a unit; arguments as for `to_imu`, the frame without prefix."""
        msg = to_imu(
            quaternion, angular_velocity, specific_force, self._frame_prefix + frame, stamp
        )
        self._imus[name].publish(msg)

    def publish_encoders(
        self, names: Sequence[str], time: float, angles: ArrayLike, speeds: ArrayLike
    ) -> None:
        """Publish the reading of the encoders; arguments as for `to_encoder_joint_state`."""
        self._encoders.publish(to_encoder_joint_state(names, time, angles, speeds))
