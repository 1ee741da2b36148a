"""Messages of many subscriptions are taken together; a flood on one does not delay the others."""

from __future__ import annotations

import time

from std_msgs.msg import String

from msg_bridge.codec import qos
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.testing.ros_context import Ros

NUM_MESSAGES = 100


def test_flood_of_one_topic_does_not_delay_the_others(ros: Ros) -> None:
    receiver, sender = ros.node("receiver"), ros.node("sender")
    poller = SubscriptionPoller(receiver, lambda: None)
    flood: list[String] = []
    other: list[String] = []

    def take_slowly(msg: String) -> None:
        flood.append(msg)
        time.sleep(0.002)

    poller.subscribe(String, "flood", qos.ROWS, take_slowly, triggers=False)
    poller.subscribe(String, "other", qos.ROWS, other.append, triggers=False)
    publishers = [sender.create_publisher(String, topic, qos.ROWS) for topic in ("flood", "other")]
    ros.spin_until(lambda: all(each.get_subscription_count() for each in publishers))
    for _ in range(NUM_MESSAGES):
        publishers[0].publish(String())
    publishers[1].publish(String())
    polls = 0
    while not other:
        poller.take_all()
        polls += 1
    assert len(flood) <= 5 * polls
    ros.spin_until(lambda: poller.take_all() == 0 and len(flood) == NUM_MESSAGES)
