"""Which required subscribers the publishers of a node have not matched yet.

A node can be in the ROS graph before its subscriptions are matched, and messages published then do
not reach it. So the matches of the publishers are counted, not the nodes in the graph.
"""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

from msg_bridge.contract import topics

__all__ = ["unmatched_topics"]


def unmatched_topics(node: Node, subscribers: Iterable[str]) -> list[str]:
    """Return the topics of a node that a required subscriber has not matched yet.

    Args:
        node: node whose publishers are checked.
        subscribers: names of the nodes that must be subscribed to each of its topics.

    Returns:
        `topic (subscriber)` for each missing match.
    """
    names = tuple(subscribers)
    missing: list[str] = []
    if not names:
        return missing
    for publisher in node.publishers:
        topic = publisher.topic_name
        if topic.endswith(f"/{topics.TERRAIN_VIEW}"):
            continue  # for display only
        infos = node.get_subscriptions_info_by_topic(topic)
        known = {info.node_name for info in infos}
        matched = publisher.get_subscription_count() >= len(infos)
        missing += [f"{topic} ({name})" for name in names if name not in known or not matched]
    return missing
