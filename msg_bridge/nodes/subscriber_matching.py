"""Whether those who are to miss nothing are listening, seen from the publishers' side.

A node that has found another in the graph may publish before the other's subscription is matched,
and what it publishes then is lost to it. What counts is what the publisher itself has matched.
"""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

__all__ = ["unmatched_topics"]


def unmatched_topics(node: Node, listeners: Iterable[str]) -> list[str]:
    """Topics of a node that not all of some nodes are subscribed to yet.

    Args:
        node: whose publishers are looked at.
        listeners: names of nodes that must be subscribed to every topic of it.

    Returns:
        `topic (name of the listener)` of each that is missing.
    """
    names = tuple(listeners)
    missing: list[str] = []
    if not names:
        return missing
    for publisher in node.publishers:
        topic = publisher.topic_name
        infos = node.get_subscriptions_info_by_topic(topic)
        known = {info.node_name for info in infos}
        matched = publisher.get_subscription_count() >= len(infos)
        missing += [f"{topic} ({name})" for name in names if name not in known or not matched]
    return missing
