"""SubscriptionPoller: take the messages of many subscriptions together when one of them triggers.

A tick consists of several messages. If the executor woke the node for each of them, the wake-ups
would cost more than the messages. So only the last message of a tick triggers, and the others are
taken with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from msg_bridge.nodes.polled_group import PolledGroup

__all__ = ["SubscriptionPoller"]

_POLL_PERIOD = 0.001
"""Wall time between polls for messages that should have arrived [s]."""

_MAX_TAKE_TIME = 0.005
"""Wall time after which no further messages are taken from a topic in one poll [s].

A flood of messages on one topic must not keep the node from its other topics and its ticks. What
is left is taken in the next poll, which then follows at once.
"""


class SubscriptionPoller:
    """Subscriptions of a node that are polled together."""

    def __init__(self, node: Node, on_polled: Callable[[], None]) -> None:
        """
        Args:
            node: node of the subscriptions.
            on_polled: called once after all waiting messages were taken.
        """
        self._node = node
        self._on_polled = on_polled
        self._polled_group = PolledGroup()
        self._subscriptions_and_callbacks: list[
            tuple[Subscription, Callable[[Any, Any], None]]
        ] = []
        self._subscriptions: dict[str, list[Subscription]] = {}  # by topic
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll_timer = node.create_timer(_POLL_PERIOD, self._poll, clock=steady)
        self._poll_timer.cancel()

    def subscribe(
        self,
        kind: Any,
        topic: str,
        profile: Any,
        take: Callable[..., None],
        *,
        triggers: bool = True,
        raw: bool = False,
        with_info: bool = False,
    ) -> None:
        """Subscribe to a topic.

        Args:
            kind: message class.
            topic: name of the topic.
            profile: QoS profile.
            take: called with each message; must not raise.
            triggers: whether a message triggers a poll; if not, it waits for the next one.
            raw: pass the CDR bytes instead of the message.
            with_info: pass the message and its info, a mapping with `publication_sequence_number`.
        """

        def receive(msg: Any, info: Any) -> None:
            if with_info:
                take(msg, info)
            else:
                take(msg)

        def wake(msg: Any, info: Any) -> None:
            receive(msg, info)
            self._poll()

        group = None if triggers else self._polled_group
        subscription = self._node.create_subscription(
            kind, topic, wake, profile, callback_group=group, raw=raw
        )
        self._subscriptions.setdefault(topic, []).append(subscription)
        # Triggering subscriptions are polled first: their messages are published last, so that the
        # rows they count have arrived by the time the others are polled.
        index = 0 if triggers else len(self._subscriptions_and_callbacks)
        self._subscriptions_and_callbacks.insert(index, (subscription, receive))

    def unsubscribe(self, topic: str) -> None:
        """End the subscriptions to a topic; not in a callback of a message.

        Args:
            topic: name of the topic, as given to `subscribe`.
        """
        for subscription in self._subscriptions.pop(topic, ()):
            self._subscriptions_and_callbacks = [
                each for each in self._subscriptions_and_callbacks if each[0] is not subscription
            ]
            self._node.destroy_subscription(subscription)

    def take_all(self) -> int:
        """Take all waiting messages and return their number."""
        num_taken = 0
        for subscription, receive in self._subscriptions_and_callbacks:
            with subscription.handle:
                deadline = time.monotonic() + _MAX_TAKE_TIME
                while True:
                    message = subscription.handle.take_message(
                        subscription.msg_type, subscription.raw
                    )
                    if message is None:
                        break
                    receive(*message)
                    num_taken += 1
                    if time.monotonic() > deadline:
                        break
        return num_taken

    def set_polling(self, wanted: bool) -> None:
        """Start or stop polling every millisecond.

        For messages without a trigger that should have arrived before the triggering one.
        """
        if wanted == self._poll_timer.is_canceled():
            if wanted:
                self._poll_timer.reset()
            else:
                self._poll_timer.cancel()

    def _poll(self) -> None:
        self.take_all()
        self._on_polled()
