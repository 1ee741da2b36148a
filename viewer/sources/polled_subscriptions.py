"""Subscriptions that are polled together, and come and go with the topics of the graph."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.printable import printable
from msg_bridge.nodes.polled_group import PolledGroup

__all__ = ["ANY_PUBLISHER", "NEWEST", "PolledSubscriptions"]

_MAX_MESSAGES = 1000
"""Maximum number of messages taken from one topic in one poll."""

NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""States of which only the newest is shown."""

ANY_PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""Profile that publishers of any reliability and durability match."""


class PolledSubscriptions:
    """Subscriptions of a node, by topic, that do not wake its executor."""

    def __init__(self, node: Node, reject: Callable[[str, str], None]) -> None:
        """
        Args:
            node: their node.
            reject: called with topic and reason of a message that cannot be used.
        """
        self._node, self._reject = node, reject
        self._group = PolledGroup()
        self._entries: dict[str, list[tuple[Subscription, Callable[[Any], None]]]] = {}

    def add(
        self,
        kind: Any,
        topic: str,
        profile: QoSProfile,
        take: Callable[[Any], None],
        *,
        raw: bool = False,
    ) -> None:
        """Subscribe to a topic; a second subscription to it is polled beside the first.

        Args:
            kind: message class.
            topic: absolute name of the topic.
            profile: QoS profile.
            take: called with each message; one for which it raises an error is rejected.
            raw: pass the CDR bytes instead of the message.
        """
        subscription = self._node.create_subscription(
            kind, topic, _unused_callback, profile, callback_group=self._group, raw=raw
        )
        self._entries.setdefault(topic, []).append((subscription, partial(self._take, topic, take)))

    def drop(self, topic: str) -> None:
        """Unsubscribe from a topic, if it is subscribed."""
        for subscription, _ in self._entries.pop(topic, []):
            self._node.destroy_subscription(subscription)

    def take_all(self) -> None:
        """Process all waiting messages."""
        for entries in list(self._entries.values()):
            for subscription, take in entries:
                with subscription.handle:
                    for _ in range(_MAX_MESSAGES):
                        message = subscription.handle.take_message(
                            subscription.msg_type, subscription.raw
                        )
                        if message is None:
                            break
                        take(message[0])

    def _take(self, topic: str, take: Callable[[Any], None], message: Any) -> None:
        try:
            take(message)
        except EarthmovingError as error:
            self._reject(topic, str(error))
        except Exception as error:  # malformed data of another publisher must not end the node
            self._reject(topic, printable(f"{type(error).__name__}: {error}"))


def _unused_callback(message: Any) -> None:
    """Do nothing: subscriptions are polled."""
