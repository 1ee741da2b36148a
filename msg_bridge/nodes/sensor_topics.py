"""What the sensors of a machine say."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from msg_bridge.codec import qos
from msg_bridge.codec.sensors import to_encoder_state, to_imu

__all__ = ["SensorTopics"]


class SensorTopics:
    """Publishers of one machine's inertial units (`imu/<name>`) and joint `encoders`."""

    def __init__(self, node: Node, folder: str = "", *, prefix: str, imus: Sequence[str]) -> None:
        """
        Args:
            node: whose topics they are.
            folder: put before each topic's name: empty, or a machine's name and a slash.
            prefix: put before each frame's name.
            imus: names of the inertial units.
        """
        self._prefix = prefix
        self._imus = {
            name: node.create_publisher(Imu, f"{folder}imu/{name}", qos.STATE) for name in imus
        }
        self._encoders = node.create_publisher(JointState, f"{folder}encoders", qos.STATE)

    def imu(
        self,
        name: str,
        frame: str,
        quaternion: ArrayLike,
        spin: ArrayLike,
        specific_force: ArrayLike,
        stamp: Time,
    ) -> None:
        """Publish what a unit says; see `to_imu`, but for the frame's name without its prefix."""
        msg = to_imu(quaternion, spin, specific_force, self._prefix + frame, stamp)
        self._imus[name].publish(msg)

    def encoders(
        self, names: Sequence[str], time: float, angles: ArrayLike, speeds: ArrayLike
    ) -> None:
        """Publish what the encoders say; see `to_encoder_state`."""
        self._encoders.publish(to_encoder_state(names, time, angles, speeds))
