"""Commands that clients publish: checked, and passed on to the machines."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool

from msg_bridge.codec import qos
from msg_bridge.codec.cdr_primitives import is_little_endian
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.topics import parent_namespace, resolve

__all__ = ["COMMAND_TYPES", "ClientMessageError", "ClientMessages"]

COMMAND_TYPES: dict[str, type] = {
    topics.JOY: Joy,
    topics.JOINT_COMMANDS: JointState,
    topics.CMD_VEL: TwistStamped,
    topics.EMERGENCY_STOP: Bool,
}
"""Message class of each topic of a machine that clients may publish."""

_MAX_SIZE = 1 << 16
"""Maximum size of a message of a client [bytes]."""


class ClientMessageError(EarthmovingError):
    """A message of a client was not published."""


class _Publication(NamedTuple):
    """A channel that a client has advertised.

    Attributes:
        topic: its topic.
        encoding: encoding of its messages, such as `cdr`.
        type_name: name of their type, such as `geometry_msgs/Twist`.
    """

    topic: str
    encoding: str
    type_name: str


class ClientMessages:
    """Publishes messages of clients on the command topics of machines."""

    def __init__(self, node: Node, known_topics: Callable[[], Collection[str]]) -> None:
        """
        Args:
            node: node of the publishers.
            known_topics: returns the names of the topics of the graph. A machine is known by its
                `joint_states`.
        """
        self._node = node
        self._known_topics = known_topics
        self._publications: dict[tuple[int, int], _Publication] = {}  # by client and channel
        self._publishers: dict[str, Publisher] = {}

    def advertise(
        self, client: int, channel: int, topic: str, encoding: str, type_name: str
    ) -> None:
        """Note what a client will publish on one of its channels.

        Args:
            client: id of the client.
            channel: id of the channel, given by the client.
            topic: its topic.
            encoding: encoding of its messages.
            type_name: as `geometry_msgs/Twist` or `geometry_msgs/msg/Twist`.
        """
        short_name = type_name.replace("/msg/", "/")
        self._publications[client, channel] = _Publication(topic, encoding, short_name)

    def unadvertise(self, client: int, channel: int) -> None:
        """Remove a channel of a client."""
        self._publications.pop((client, channel), None)

    def publish(self, client: int, channel: int, data: bytes) -> None:
        """Publish a message of a client.

        Args:
            client, channel: ids of the client and its channel.
            data: the serialised message.

        Raises:
            ClientMessageError: it is not a command of a machine, or not valid.
        """
        publication = self._publications.get((client, channel))
        if publication is None:
            return
        message = _decode(publication, self._message_class(publication), data)
        self._publisher(publication.topic).publish(message)

    def _message_class(self, publication: _Publication) -> type:
        """Return the class of the messages of a channel.

        Raises:
            ClientMessageError: clients may not publish it.
        """
        topic, encoding, type_name = publication
        name = topic.rpartition("/")[2]
        machine = parent_namespace(topic)
        expected = COMMAND_TYPES.get(name)
        if expected is None or resolve(topics.JOINT_STATES, machine) not in self._known_topics():
            names = ", ".join(f"<m>/{each}" for each in COMMAND_TYPES)
            raise ClientMessageError(
                f"clients may not publish on {topic}; topics of a machine that they may publish"
                f" are {names}"
            )
        accepted = (expected, Twist) if expected is TwistStamped else (expected,)
        for each in accepted:
            if type_name == _type_name(each) and encoding == "cdr":
                return each
        raise ClientMessageError(
            f"{topic} takes {' or '.join(map(_type_name, accepted))} in cdr, not {type_name} in"
            f" {encoding}"
        )

    def _publisher(self, topic: str) -> Publisher:
        publisher = self._publishers.get(topic)
        if publisher is None:
            of = COMMAND_TYPES[topic.rpartition("/")[2]]
            publisher = self._node.create_publisher(of, topic, qos.STATE)
            self._publishers[topic] = publisher
        return publisher


def _decode(publication: _Publication, message_class: type, data: bytes) -> Any:
    """Return a message to publish.

    Raises:
        ClientMessageError: the bytes are not a message of the class.
    """
    try:
        if len(data) > _MAX_SIZE or not is_little_endian(data):
            raise ValueError("too large, or not in little-endian CDR")
        message = deserialize_message(data, message_class)
    except Exception as error:  # rclpy raises various types
        raise ClientMessageError(
            f"a client sent bytes on {publication.topic} that are no {publication.type_name}:"
            f" {error}"
        ) from error
    # Panels publish Twist; machines take TwistStamped, without stamp as the newest.
    return TwistStamped(twist=message) if message_class is Twist else message


def _type_name(message_class: type) -> str:
    return f"{message_class.__module__.split('.')[0]}/{message_class.__name__}"
