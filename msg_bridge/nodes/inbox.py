"""Inbox: subscriptions that are emptied together when one of a few wakes the node.

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

from msg_bridge.nodes.unwaited import Unwaited

__all__ = ["Inbox"]

_LOOK_AGAIN = 0.001
"""Wall time after which one looks again for what should have come [s]."""

_MOST_AT_ONCE = 1000
"""Messages of one topic taken at once: one who sends without end must not stop the node."""


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
        self._unwaited = Unwaited()
        self._takers: list[tuple[Subscription, Callable[[Any], None]]] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._again = node.create_timer(_LOOK_AGAIN, self._look, clock=steady)
        self._again.cancel()

    def subscribe(
        self,
        kind: Any,
        topic: str,
        profile: Any,
        take: Callable[[Any], None],
        *,
        wakes: bool = True,
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
            self._look()

        group = None if wakes else self._unwaited
        subscription = self._node.create_subscription(
            kind, topic, wake, profile, callback_group=group, raw=raw
        )
        # Those that are waited for are looked at first: they come last, so that what they tell of
        # has arrived by then, and is not overlooked.
        place = 0 if wakes else len(self._takers)
        self._takers.insert(place, (subscription, take))

    def empty(self) -> int:
        """Take all that has arrived; returns how many messages that were."""
        taken = 0
        for subscription, take in self._takers:
            with subscription.handle:
                for _ in range(_MOST_AT_ONCE):
                    found = subscription.handle.take_message(
                        subscription.msg_type, subscription.raw
                    )
                    if found is None:
                        break
                    take(found[0])
                    taken += 1
        return taken

    def look_again(self, wanted: bool) -> None:
        """Look again soon, and go on doing so, or no more.

        For what nobody waits for and should have come before what was waited for.
        """
        if wanted == self._again.is_canceled():
            if wanted:
                self._again.reset()
            else:
                self._again.cancel()

    def _look(self) -> None:
        self.empty()
        self._then()
