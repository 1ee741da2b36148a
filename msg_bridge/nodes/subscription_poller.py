"""SubscriptionPoller: subscriptions that are emptied together when one of a few wakes the node.

A tick is told by several messages. The executor would wake the node for each of them, and a wake
costs more than most messages do, here and for whoever shares the processor. So only the last
message of a tick is waited for; the others are taken with it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from msg_bridge.nodes.polled_group import PolledGroup

__all__ = ["SubscriptionPoller"]

_POLL_PERIOD = 0.001
"""Wall time after which one looks again for what should have come [s]."""

_MAX_MESSAGES_PER_POLL = 1000
"""Messages of one topic taken at once: one who sends without end must not stop the node."""


class SubscriptionPoller:
    """Some of a node's subscriptions."""

    def __init__(self, node: Node, on_polled: Callable[[], None]) -> None:
        """
        Args:
            node: whose subscriptions they are.
            then: called once after all that had arrived was taken.
        """
        self._node = node
        self._on_polled = on_polled
        self._polled_group = PolledGroup()
        self._subscriptions_and_callbacks: list[tuple[Subscription, Callable[[Any], None]]] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll_timer = node.create_timer(_POLL_PERIOD, self._poll, clock=steady)
        self._poll_timer.cancel()

    def subscribe(
        self,
        kind: Any,
        topic: str,
        profile: Any,
        take: Callable[[Any], None],
        *,
        triggers: bool = True,
        raw: bool = False,
    ) -> None:
        """Have the messages of a topic taken.

        Args:
            kind: type of the message.
            topic: its name.
            profile: QoS.
            take: takes each message; must not raise.
            wakes: whether the node is to wake for it, or has it taken when it is awake.
            raw: whether to hand over the message's bytes.
        """

        def wake(msg: Any) -> None:
            take(msg)
            self._poll()

        group = None if triggers else self._polled_group
        subscription = self._node.create_subscription(
            kind, topic, wake, profile, callback_group=group, raw=raw
        )
        # Those that are waited for are looked at first: they come last, so that what they tell of
        # has arrived by then, and is not overlooked.
        place = 0 if triggers else len(self._subscriptions_and_callbacks)
        self._subscriptions_and_callbacks.insert(place, (subscription, take))

    def take_all(self) -> int:
        """Take all that has arrived; returns how many messages that were."""
        taken = 0
        for subscription, take in self._subscriptions_and_callbacks:
            with subscription.handle:
                for _ in range(_MAX_MESSAGES_PER_POLL):
                    found = subscription.handle.take_message(
                        subscription.msg_type, subscription.raw
                    )
                    if found is None:
                        break
                    take(found[0])
                    taken += 1
        return taken

    def set_polling(self, wanted: bool) -> None:
        """Look again soon, and go on doing so, or no more.

        For what nobody waits for and should have come before what was waited for.
        """
        if wanted == self._poll_timer.is_canceled():
            if wanted:
                self._poll_timer.reset()
            else:
                self._poll_timer.cancel()

    def _poll(self) -> None:
        self.take_all()
        self._on_polled()
