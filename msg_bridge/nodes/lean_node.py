"""A node whose endpoints cost nothing while nothing happens on them."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node

__all__ = ["LeanNode"]


class LeanNode(Node):
    """A node without rclpy's watchers of incompatible QoS.

    By default rclpy gives each publisher and subscription a watcher or two, and looks at every one
    in Python each time the executor waits: with the thirty topics of a machine that is most of what
    a message costs. What they would log cannot happen between this package's nodes.
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
