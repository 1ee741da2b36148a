"""Subscriptions of the recorder: raw, with the QoS that all publishers offer, and looked at.

They are looked at, say 50 times a second, instead of being waited for: waiting costs rclpy some
time for each subscription at every message, looking costs next to nothing. Meanwhile messages wait
in the middleware, which knows when each arrived.
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
from msg_bridge.recorder.recording import RecordedMessage

__all__ = ["RawSubscriptions", "advertised_type_hash", "all_transient_local", "offered_qos"]

_DEPTH = 1000
"""Messages of a topic that wait between two looks, at most."""

_TRANSIENT_LOCAL_DEPTH = 100
"""Of a latched topic, whose messages may be whole maps."""


class RawSubscriptions:
    """Listens to topics on behalf of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = PolledGroup()
        self._subscriptions: dict[str, TopicSubscription] = {}

    @property
    def topics(self) -> list[str]:
        """Names of what it listens to."""
        return list(self._subscriptions)

    def add(self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Begin to listen.

        Raises:
            SchemaError: the type is not installed here.
        """
        self._subscriptions[topic] = self._subscribe(
            topic, _message_class_of(type_name), publishers
        )

    def drop(self, topic: str) -> None:
        """Listen to a topic no more, if it was listened to."""
        ear = self._subscriptions.pop(topic, None)
        if ear is not None:
            self._node.destroy_subscription(ear.subscription)

    def qos_incompatible(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> bool:
        """Whether some of a topic's publishers offer less than is asked for; they are not heard."""
        ear = self._subscriptions[topic]
        return (ear.reliable and not _all_reliable(publishers)) or (
            ear.transient_local and not all_transient_local(publishers)
        )

    def resubscribe(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Ask for what all of them offer; what has arrived and was not taken is lost."""
        ear = self._subscriptions[topic]
        self._node.destroy_subscription(ear.subscription)
        self._subscriptions[topic] = self._subscribe(topic, ear.message_class, publishers)

    def take(self) -> list[RecordedMessage]:
        """What has arrived since the last time, in the order it did."""
        heard: list[RecordedMessage] = []
        for ear in self._subscriptions.values():
            _take(ear, heard)
        heard.sort(key=attrgetter("received_time"))
        return heard

    def _subscribe(
        self, topic: str, message_class: type, publishers: Sequence[TopicEndpointInfo]
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
        return TopicSubscription(topic, message_class, subscription, reliable, transient_local)


def all_transient_local(publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether all keep their newest messages for late subscribers."""
    offers = (each.qos_profile.durability for each in publishers)
    return all(each == DurabilityPolicy.TRANSIENT_LOCAL for each in offers)


def advertised_type_hash(publisher: TopicEndpointInfo) -> str | None:
    """The hash of its type as a publisher tells it, if it does."""
    told = str(publisher.topic_type_hash)
    return told if told.startswith("RIHS01_") else None


def offered_qos(publisher: TopicEndpointInfo) -> OfferedQos:
    """What a publisher offers."""
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
    """A subscription, and what it asks for."""

    topic: str
    message_class: type
    subscription: Subscription
    reliable: bool
    transient_local: bool


def _take(ear: TopicSubscription, heard: list[RecordedMessage]) -> None:
    """Take what waits at a subscription, at most as much as it can hold."""
    handle = ear.subscription.handle
    with handle:
        for _ in range(_DEPTH):
            taken = handle.take_message(ear.message_class, True)
            if taken is None:
                return
            data, info = taken
            # A middleware that tells no times leaves 0.
            received_time = info["received_timestamp"] or time.time_ns()
            source_time = info["source_timestamp"] or received_time
            sequence_number = info["publication_sequence_number"]
            heard.append(
                RecordedMessage(ear.topic, data, received_time, source_time, sequence_number)
            )


def _unused_callback(message: bytes) -> None:
    """Subscriptions are looked at instead."""


def _message_class_of(type_name: str) -> type:
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
