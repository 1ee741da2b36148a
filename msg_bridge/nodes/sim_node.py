"""A node whose endpoints cost nothing while nothing happens on them, with timers of wall time."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node

__all__ = ["SimNode"]


class SimNode(Node):
    """A node without rclpy's watchers of incompatible QoS.

    By default rclpy gives each publisher and subscription a watcher or two, and looks at every one
    in Python each time the executor waits: with the thirty topics of a machine that is most of what
    a message costs. What they would log cannot happen between this package's nodes.

    Its timers go by the wall clock even with `use_sim_time`: simulation time is what the soil makes
    with them, and it must go on asking for what was lost while that stands still.
    """

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_publisher`."""
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs)

    def create_subscription(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_subscription`."""
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        kwargs.setdefault("event_callbacks", quiet)
        return super().create_subscription(*args, **kwargs)

    def create_timer(self, *args: Any, **kwargs: Any) -> Any:
        """As `Node.create_timer`."""
        kwargs.setdefault("clock", Clock(clock_type=ClockType.STEADY_TIME))
        return super().create_timer(*args, **kwargs)
