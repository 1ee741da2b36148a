"""Polled subscriptions that deliver messages of any type as bytes.

Each requests the strongest QoS that all publishers of its topic offer. Subscriptions are polled,
about 50 times a second, rather than waited for: an rclpy executor spends time on each subscription
at every message, polling almost none. In between, the middleware queues the messages with their
times of reception.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_bridge.bag.message_schemas import SchemaError
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.nodes.polled_group import PolledGroup
from msg_bridge.raw_topics.received_message import ReceivedMessage

__all__ = [
    "RawSubscriptions",
    "advertised_type_hash",
    "all_transient_local",
    "message_class",
    "offered_qos",
]

_DEPTH = 1000
"""Maximum number of messages of a topic that are queued between two polls."""

_TRANSIENT_LOCAL_DEPTH = 100
"""The same for a transient-local topic, whose messages may be whole maps."""


class RawSubscriptions:
    """Raw subscriptions of a node, by topic."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = PolledGroup()
        self._subscriptions: dict[str, TopicSubscription] = {}

    @property
    def topics(self) -> list[str]:
        """Names of the subscribed topics."""
        return list(self._subscriptions)

    def add(self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Subscribe to a topic.

        Args:
            topic: its name.
            type_name: as `std_msgs/msg/String`.
            publishers: its publishers.

        Raises:
            SchemaError: the type is not installed here.
        """
        self._subscriptions[topic] = self._subscribe(
            topic, type_name, message_class(type_name), publishers
        )

    def drop(self, topic: str) -> None:
        """Unsubscribe from a topic, if it is subscribed."""
        entry = self._subscriptions.pop(topic, None)
        if entry is not None:
            self._node.destroy_subscription(entry.subscription)

    def type_name(self, topic: str) -> str | None:
        """Return the type of a topic, as `std_msgs/msg/String`; None if it is not subscribed."""
        entry = self._subscriptions.get(topic)
        return None if entry is None else entry.type_name

    def qos_incompatible(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> bool:
        """Return whether some publishers offer less than is requested, and are not received."""
        entry = self._subscriptions[topic]
        return (entry.reliable and not _all_reliable(publishers)) or (
            entry.transient_local and not all_transient_local(publishers)
        )

    def resubscribe(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Subscribe again with the QoS that all publishers offer; queued messages are lost."""
        entry = self._subscriptions[topic]
        self._node.destroy_subscription(entry.subscription)
        self._subscriptions[topic] = self._subscribe(
            topic, entry.type_name, entry.message_class, publishers
        )

    def take(self) -> list[ReceivedMessage]:
        """Return the messages received since the last call, in the order of their reception."""
        messages: list[ReceivedMessage] = []
        for entry in self._subscriptions.values():
            _take_queued(entry, messages)
        messages.sort(key=attrgetter("received_time"))
        return messages

    def _subscribe(
        self,
        topic: str,
        type_name: str,
        message_class: type,
        publishers: Sequence[TopicEndpointInfo],
    ) -> TopicSubscription:
        reliable, transient_local = _all_reliable(publishers), all_transient_local(publishers)
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_TRANSIENT_LOCAL_DEPTH if transient_local else _DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE
            ),
        )
        subscription = self._node.create_subscription(
            message_class, topic, _unused_callback, profile, callback_group=self._group, raw=True
        )
        return TopicSubscription(
            topic, type_name, message_class, subscription, reliable, transient_local
        )


def all_transient_local(publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Return whether all publishers are transient local."""
    offers = (each.qos_profile.durability for each in publishers)
    return all(each == DurabilityPolicy.TRANSIENT_LOCAL for each in offers)


def advertised_type_hash(publisher: TopicEndpointInfo) -> str | None:
    """Return the type hash that a publisher advertises; None if it advertises none."""
    type_hash = str(publisher.topic_type_hash)
    return type_hash if type_hash.startswith("RIHS01_") else None


def offered_qos(publisher: TopicEndpointInfo) -> OfferedQos:
    """Return the QoS that a publisher offers."""
    profile = publisher.qos_profile
    return OfferedQos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
        depth=profile.depth,
        liveliness=profile.liveliness.name.lower(),
        deadline=profile.deadline.nanoseconds,
        lifespan=profile.lifespan.nanoseconds,
        lease=profile.liveliness_lease_duration.nanoseconds,
    )


@dataclass
class TopicSubscription:
    """A subscription with its requested QoS."""

    topic: str
    type_name: str
    message_class: type
    subscription: Subscription
    reliable: bool
    transient_local: bool


def _take_queued(entry: TopicSubscription, messages: list[ReceivedMessage]) -> None:
    """Append the queued messages of a subscription, at most one queue length."""
    handle = entry.subscription.handle
    with handle:
        for _ in range(_DEPTH):
            taken = handle.take_message(entry.message_class, True)
            if taken is None:
                return
            data, info = taken
            # A middleware without timestamps leaves 0.
            received_time = info["received_timestamp"] or time.time_ns()
            source_time = info["source_timestamp"] or received_time
            sequence_number = info["publication_sequence_number"]
            messages.append(
                ReceivedMessage(entry.topic, data, received_time, source_time, sequence_number)
            )


def _unused_callback(message: bytes) -> None:
    """Do nothing: subscriptions are polled."""


def message_class(type_name: str) -> type:
    """Return the installed class of a message type.

    Raises:
        SchemaError: it is not installed.
    """
    package, _, name = type_name.partition("/msg/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise SchemaError(
            f"type {type_name} is not installed; install {package.split('/')[0]} or source its"
            " workspace"
        ) from error
    return found


def _all_reliable(publishers: Sequence[TopicEndpointInfo]) -> bool:
    offers = (each.qos_profile.reliability for each in publishers)
    return all(each == ReliabilityPolicy.RELIABLE for each in offers)
