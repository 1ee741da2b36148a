"""Malformed messages are rejected with the kind of their error, and later ones are taken."""

from __future__ import annotations

from std_msgs.msg import String

from msg_bridge.testing.ros_context import Ros
from viewer.sources.polled_subscriptions import ANY_PUBLISHER, PolledSubscriptions


def test_any_error_of_a_message_rejects_it_and_no_other(ros: Ros) -> None:
    rejected: list[tuple[str, str]] = []
    taken: list[float] = []
    subscriptions = PolledSubscriptions(ros.node(), lambda *reason: rejected.append(reason))
    subscriptions.add(String, "/numbers", ANY_PUBLISHER, lambda msg: taken.append(float(msg.data)))
    publisher = ros.publisher("/numbers", String)

    def are_both_received() -> bool:
        publisher.publish(String(data="none"))
        publisher.publish(String(data="1.5"))
        subscriptions.take_all()
        return bool(rejected and taken)

    ros.spin_until(are_both_received)
    assert rejected[0][0] == "/numbers"
    assert rejected[0][1].startswith("ValueError: ")
    assert set(taken) == {1.5}
