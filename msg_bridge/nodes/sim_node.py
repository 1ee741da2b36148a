"""Base of all nodes: no QoS event handlers, and timers of wall clock time."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node

__all__ = ["SimNode"]


class SimNode(Node):
    """Node without QoS event handlers, whose timers run on the wall clock.

    By default rclpy adds one or two event handlers to each publisher and subscription and checks
    every one in Python whenever the executor waits. With the thirty topics of a machine that is
    most of the cost of a message. Incompatible QoS, which they log, is found by `endpoint_monitor`.

    Timers run on the wall clock even with `use_sim_time`: they request what was lost, also while
    simulated time stands still.
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
