"""Topics that a required subscriber does not subscribe to yet."""

from __future__ import annotations

import pytest
from rclpy.node import Node
from std_msgs.msg import String

from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.testing.ros_context import Ros


@pytest.fixture
def publisher_node(ros: Ros) -> SimNode:
    """Return a node with two topics beside those of every node."""
    node = ros.add(SimNode, "publisher_node")
    for topic in ("one", "two"):
        node.create_publisher(String, topic, 10)
    return node


def own(topics: list[str]) -> list[str]:
    return [topic for topic in topics if topic.startswith(("/one", "/two"))]


def subscribe(node: Node, *topics: str) -> None:
    for topic in topics:
        node.create_subscription(String, topic, lambda message: None, 10)


def test_no_topic_is_unmatched_without_required_subscribers(publisher_node: SimNode) -> None:
    assert unmatched_topics(publisher_node, ()) == []


def test_all_topics_are_unmatched_for_an_absent_subscriber(publisher_node: SimNode) -> None:
    missing = unmatched_topics(publisher_node, ["recorder"])
    assert own(missing) == ["/one (recorder)", "/two (recorder)"]


def test_topic_is_matched_once_the_subscription_is(ros: Ros, publisher_node: SimNode) -> None:
    recorder = ros.node("recorder")
    subscribe(recorder, "one")
    ros.spin_until(
        lambda: own(unmatched_topics(publisher_node, ["recorder"])) == ["/two (recorder)"]
    )
    subscribe(recorder, "two")
    ros.spin_until(lambda: own(unmatched_topics(publisher_node, ["recorder"])) == [])


def test_subscription_of_another_node_does_not_match(ros: Ros, publisher_node: SimNode) -> None:
    subscribe(ros.node("viewer"), "one", "two")
    ros.spin_until(lambda: own(unmatched_topics(publisher_node, ["viewer"])) == [])
    assert own(unmatched_topics(publisher_node, ["viewer", "recorder"])) == [
        "/one (recorder)",
        "/two (recorder)",
    ]


def test_topics_of_a_removed_subscriber_are_unmatched_again(
    ros: Ros, publisher_node: SimNode
) -> None:
    recorder = ros.node("recorder")
    subscribe(recorder, "one", "two")
    ros.spin_until(lambda: own(unmatched_topics(publisher_node, ["recorder"])) == [])
    ros.remove(recorder)
    ros.spin_until(lambda: len(own(unmatched_topics(publisher_node, ["recorder"]))) == 2)


def test_discovered_but_unmatched_subscription_does_not_count(publisher_node: SimNode) -> None:
    class Unmatched:
        topic_name = "/one"

        def get_subscription_count(self) -> int:
            return 1

    class Info:
        node_name = "recorder"

    class Graph:
        publishers = (Unmatched(),)

        def get_subscriptions_info_by_topic(self, topic: str) -> list[Info]:
            return [Info(), Info()]

    assert unmatched_topics(Graph(), ["recorder"]) == ["/one (recorder)"]  # type: ignore[arg-type]
