"""Inbox: subscriptions that are emptied together as soon as one of them wakes the node.

A tick is told by several messages. The executor would wake the node for each, and a wake costs more
than most messages do. Here the first one wakes it, all that have arrived are taken, and what is to
be done about them is done once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

__all__ = ["Inbox"]


class Inbox:
    """Some of a node's subscriptions."""

    def __init__(self, node: Node, then: Callable[[], None]) -> None:
        """
        Args:
            node: whose subscriptions they are.
            then: called once after all that had arrived was taken.
        """
        self._node = node
        self._then = then
        self._takers: list[tuple[Subscription, Callable[[Any], None]]] = []

    def subscribe(self, kind: Any, topic: str, profile: Any, take: Callable[[Any], None]) -> None:
        """Have the messages of a topic taken.

        Args:
            kind: type of the message.
            topic: its name.
            profile: QoS.
            take: takes each message; must not raise.
        """

        def wake(msg: Any) -> None:
            take(msg)
            self.empty()
            self._then()

        subscription = self._node.create_subscription(kind, topic, wake, profile)
        self._takers.append((subscription, take))

    def empty(self) -> int:
        """Take all that has arrived; returns how many messages that were."""
        taken = 0
        for subscription, take in self._takers:
            with subscription.handle:
                while True:
                    found = subscription.handle.take_message(subscription.msg_type, False)
                    if found is None:
                        break
                    take(found[0])
                    taken += 1
        return taken
