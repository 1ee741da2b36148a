"""What the sensors of a machine say."""

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
    """Publishers of one machine's inertial units (`imu/<name>/data`) and joint encoders (`joint_states_measured`)."""

    def __init__(
        self, node: Node, topic_prefix: str = "", *, frame_prefix: str, imus: Sequence[str]
    ) -> None:
        """
        Args:
            node: whose topics they are.
            folder: put before each topic's name: empty, or a machine's name and a slash.
            prefix: put before each frame's name.
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
        """Publish what a unit says; see `to_imu`, but for the frame's name without its prefix."""
        msg = to_imu(
            quaternion, angular_velocity, specific_force, self._frame_prefix + frame, stamp
        )
        self._imus[name].publish(msg)

    def publish_encoders(
        self, names: Sequence[str], time: float, angles: ArrayLike, speeds: ArrayLike
    ) -> None:
        """Publish what the encoders say; see `to_encoder_joint_state`."""
        self._encoders.publish(to_encoder_joint_state(names, time, angles, speeds))
