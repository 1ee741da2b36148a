"""Follow the ROS graph: subscribe to every selected topic, and again where publishers changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_bridge.bag.message_schemas import SchemaError
from msg_bridge.raw_topics.raw_subscriptions import RawSubscriptions
from msg_bridge.raw_topics.received_message import ReceivedMessage

__all__ = ["GraphTopics", "TopicListener"]

_SCANS_PER_PUBLISHER_CHECK = 10
"""Publishers of known topics are queried less often: a query is slow, and they rarely change."""


class TopicListener(Protocol):
    """What a node does with the topics that are found."""

    def add_topic(
        self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo]
    ) -> None:
        """Begin to use a topic that was subscribed.

        Raises:
            SchemaError: its type cannot be described; then it is not subscribed.
        """

    def update_publishers(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Note the current publishers of an added topic; called about every second."""

    def before_resubscription(self) -> None:
        """Take the received messages: those of one subscription are lost next."""

    def warn(self, text: str) -> None:
        """Log a warning."""


class GraphTopics:
    """Raw subscriptions to the selected topics of the graph."""

    def __init__(
        self, node: Node, listener: TopicListener, *, is_selected: Callable[[str], bool]
    ) -> None:
        """Begin without topics; call `scan` periodically.

        Args:
            node: node of the subscriptions.
            listener: is called within `scan` and `check_publishers`.
            is_selected: returns whether to subscribe to a topic.
        """
        self._node = node
        self._listener = listener
        self._is_selected = is_selected
        self._subscriptions = RawSubscriptions(node)
        self._skipped: set[str] = set()
        self._scans = 0

    @property
    def topics(self) -> list[str]:
        """Names of the subscribed topics."""
        return self._subscriptions.topics

    @property
    def known_topics(self) -> set[str]:
        """Names of all topics found so far, subscribed or not."""
        return {*self._subscriptions.topics, *self._skipped}

    def type_name(self, topic: str) -> str | None:
        """Return the type of a topic, as `std_msgs/msg/String`; None if it is not subscribed."""
        return self._subscriptions.type_name(topic)

    def take(self) -> list[ReceivedMessage]:
        """Return the messages received since the last call, in the order of their reception."""
        return self._subscriptions.take()

    def scan(self) -> None:
        """Subscribe to new topics; now and then check the publishers of the others."""
        self._scans += 1
        if self._scans % _SCANS_PER_PUBLISHER_CHECK == 0:
            self.check_publishers()
        known = self.known_topics
        for topic, _ in self._node.get_topic_names_and_types():
            if topic in known:
                continue
            if not self._is_selected(topic):
                self._skipped.add(topic)
            elif publishers := self._node.get_publishers_info_by_topic(topic):
                self._add(topic, publishers)

    def check_publishers(self, *, resubscribe: bool = True) -> None:
        """Update the publishers of each topic.

        Args:
            resubscribe: subscribe again where some publishers are not received.
        """
        for topic in self._subscriptions.topics:
            publishers = self._node.get_publishers_info_by_topic(topic)
            if resubscribe and self._subscriptions.qos_incompatible(topic, publishers):
                self._listener.before_resubscription()
                self._subscriptions.resubscribe(topic, publishers)
            self._listener.update_publishers(topic, publishers)

    def _add(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        types = sorted({each.topic_type for each in publishers})
        if len(types) > 1:
            self._listener.warn(
                f"{topic} has types {', '.join(types)}; only messages of the first are received"
            )
        try:
            self._subscriptions.add(topic, types[0], publishers)
            self._listener.add_topic(topic, types[0], publishers)
        except SchemaError as error:
            self._subscriptions.drop(topic)
            self._skipped.add(topic)
            self._listener.warn(f"{topic} is not received: {error}")
            return
        self._listener.update_publishers(topic, publishers)
