"""Base of all nodes: no QoS event handlers, wall clock timers, publications that can be held."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher

__all__ = ["HeldPublications", "SimNode"]

HeldPublications = Sequence[Callable[[], None]]
"""Publications in their order; a call publishes one."""


class _HoldablePublisher(Publisher):
    """Publisher whose messages can be held; see `SimNode.hold_publications`."""

    held: list[Callable[[], None]] | None = None

    def publish(self, msg: Any) -> None:
        """As `Publisher.publish`, or hold the message."""
        if self.held is None:
            super().publish(msg)
        else:
            self.held.append(partial(super().publish, msg))


class SimNode(Node):
    """Node without QoS event handlers, whose timers run on the wall clock.

    By default rclpy adds one or two event handlers to each publisher and subscription and checks
    every one in Python whenever the executor waits. With the thirty topics of a machine that is
    most of the cost of a message. Incompatible QoS, which they log, is found by `endpoint_monitor`.

    Timers run on the wall clock even with `use_sim_time`: they request what was lost, also while
    simulated time stands still.
    """

    @contextmanager
    def hold_publications(self) -> Iterator[HeldPublications]:
        """Hold what the node publishes in this context, and give it as it is added."""
        held: list[Callable[[], None]] = []
        publishers = [each for each in self.publishers if isinstance(each, _HoldablePublisher)]
        for publisher in publishers:
            publisher.held = held
        try:
            yield held
        finally:
            for publisher in publishers:
                publisher.held = None

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_publisher`."""
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs, publisher_class=_HoldablePublisher)

    def create_subscription(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_subscription`."""
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        kwargs.setdefault("event_callbacks", quiet)
        return super().create_subscription(*args, **kwargs)

    def create_timer(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_timer`."""
        kwargs.setdefault("clock", Clock(clock_type=ClockType.STEADY_TIME))
        return super().create_timer(*args, **kwargs)
