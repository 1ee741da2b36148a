"""Whether those who are to miss nothing are listening."""

from __future__ import annotations

import pytest
from rclpy.node import Node
from std_msgs.msg import String

from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.testing.ros_context import Ros


@pytest.fixture
def speaker(ros: Ros) -> SimNode:
    """A node with two topics of its own, beside those that every node has."""
    node = ros.add(SimNode, "speaker")
    for topic in ("one", "two"):
        node.create_publisher(String, topic, 10)
    return node


def own(topics: list[str]) -> list[str]:
    return [topic for topic in topics if topic.startswith(("/one", "/two"))]


def listen(node: Node, *topics: str) -> None:
    for topic in topics:
        node.create_subscription(String, topic, lambda message: None, 10)


def test_with_nobody_to_wait_for_nothing_is_missing(speaker: SimNode) -> None:
    assert unmatched_topics(speaker, ()) == []


def test_every_topic_of_a_listener_that_is_not_there_is_named(speaker: SimNode) -> None:
    missing = unmatched_topics(speaker, ["recorder"])
    assert own(missing) == ["/one (recorder)", "/two (recorder)"]


def test_a_topic_is_heard_once_its_listener_is_matched(ros: Ros, speaker: SimNode) -> None:
    recorder = ros.node("recorder")
    listen(recorder, "one")
    ros.spin_until(lambda: own(unmatched_topics(speaker, ["recorder"])) == ["/two (recorder)"])
    listen(recorder, "two")
    ros.spin_until(lambda: own(unmatched_topics(speaker, ["recorder"])) == [])


def test_another_listener_does_not_stand_in(ros: Ros, speaker: SimNode) -> None:
    listen(ros.node("viewer"), "one", "two")
    ros.spin_until(lambda: own(unmatched_topics(speaker, ["viewer"])) == [])
    assert own(unmatched_topics(speaker, ["viewer", "recorder"])) == [
        "/one (recorder)",
        "/two (recorder)",
    ]


def test_a_listener_that_has_gone_is_missed(ros: Ros, speaker: SimNode) -> None:
    recorder = ros.node("recorder")
    listen(recorder, "one", "two")
    ros.spin_until(lambda: own(unmatched_topics(speaker, ["recorder"])) == [])
    ros.remove(recorder)
    ros.spin_until(lambda: len(own(unmatched_topics(speaker, ["recorder"]))) == 2)


def test_a_subscription_that_is_known_but_not_matched_does_not_count(speaker: SimNode) -> None:
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
