"""Publishers that write into a bag: what the nodes publish, without ROS nodes."""

from __future__ import annotations

from typing import Any

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter
from msg_bridge.contract.topics import resolve

__all__ = ["BagNode", "BagPublisher", "TimedBag"]


class TimedBag:
    """A bag being written, and the time of what is written to it.

    Attributes:
        writer: the bag.
        time: log time of the next messages [ns].
    """

    def __init__(self, writer: BagWriter) -> None:
        self.writer = writer
        self.time = 0


class BagPublisher:
    """Writes the messages of one topic."""

    def __init__(self, bag: TimedBag, topic: str) -> None:
        self._bag, self._topic = bag, topic

    def publish(self, message: Any) -> None:
        """Write a message, or its CDR bytes.

        Raises:
            BagError: the bag cannot be written.
        """
        data = message if isinstance(message, bytes) else serialize_message(message)
        self._bag.writer.write(self._topic, data, self._bag.time, self._bag.time)


class BagNode:
    """The part of `rclpy.node.Node` that creates publishers, for the publisher classes of nodes."""

    def __init__(self, bag: TimedBag, namespace: str) -> None:
        """
        Args:
            bag: the bag.
            namespace: absolute namespace of the node.
        """
        self._bag, self._namespace = bag, namespace

    def get_namespace(self) -> str:
        """Return the namespace of the node."""
        return self._namespace

    def create_publisher(self, kind: Any, topic: str, profile: QoSProfile) -> BagPublisher:
        """Add a topic to the bag, unless it is there, and return its publisher.

        Args:
            kind: class of its messages.
            topic: its name, absolute or relative to the namespace.
            profile: the QoS that a publisher would offer.
        """
        name = topic if topic.startswith("/") else resolve(topic, self._namespace)
        if name not in self._bag.writer.topics:
            package = kind.__module__.partition(".")[0]
            offered = OfferedQos(
                reliability=profile.reliability.name.lower(),
                durability=profile.durability.name.lower(),
                history=profile.history.name.lower(),
                depth=profile.depth,
            )
            self._bag.writer.add_topic(name, f"{package}/msg/{kind.__name__}", [offered])
        return BagPublisher(self._bag, name)
