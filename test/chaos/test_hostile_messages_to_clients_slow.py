"""Hostile messages on every topic that operator, viewer and Foxglove server read end none of them.

The recorder writes all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from chaos.hostile_messages import hostile_messages, large_cloud
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from support.node_scenes import Scene, machine_file, ready_to_dig
from support.stream_client import StreamClient

from dig_operator.node import DigOperatorNode
from msg_bridge.bag.reader import BagReader
from msg_bridge.foxglove_server.node import FoxgloveServerNode
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros
from viewer.node import ViewerNode

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

KINDS: dict[str, Callable[..., Node]] = {
    "operator": DigOperatorNode,
    "viewer": ViewerNode,
    "foxglove": FoxgloveServerNode,
}


def matching(profile: QoSProfile) -> QoSProfile:
    """Return a reliable profile that a subscription of any profile receives."""
    return QoSProfile(depth=100, durability=DurabilityPolicy(profile.durability))


@pytest.mark.parametrize("kind", KINDS)
def test_hostile_messages_end_no_client(ros: Ros, tmp_path: Path, kind: str) -> None:
    scene = Scene(ros)
    scene.machine(machine=machine_file(tmp_path, ready_to_dig()))
    recorder = ros.add(RecorderNode, parameters={"path": str(tmp_path / "bag"), "progress": False})
    parameters = {} if kind == "operator" else {"port": 0}
    node = ros.add(KINDS[kind], parameters=parameters)
    scene.until_tick(30)
    ros.spin_for(1.0)  # topics are found
    client = StreamClient(node.server.port) if isinstance(node, ViewerNode) else None
    if client is not None:
        client.__enter__()
    topics = {each.topic_name: each for each in node.subscriptions}
    assert len(topics) > 5
    own = {"/rosout", "/parameter_events", "/diagnostics", "/recorder/status"}
    for topic in sorted(set(topics) - own):
        subscription = topics[topic]
        publisher = ros.publisher(topic, subscription.msg_type, matching(subscription.qos_profile))
        for _, message in hostile_messages(subscription.msg_type):
            publisher.publish(message)
            ros.spin_for(0.02)
        if subscription.msg_type is PointCloud2 and topic == "/terrain/map":
            publisher.publish(large_cloud())
            ros.spin_for(0.2)
        ros.helper.destroy_publisher(publisher)
    ros.spin_for(1.0)
    assert not getattr(node, "finished", False)
    if client is not None:
        assert not client.is_closed
        client.__exit__()
    if kind != "foxglove":  # which sends on bytes that it does not decode
        values = node.diagnostics.report().values  # type: ignore[attr-defined]
        rejected = {each.split()[-1] for each in values if each.startswith("rejected ")}
        assert {"/sim/config", "/terrain/map", "/terrain/map_updates"} <= rejected
    num_recorded = recorder.recording.messages
    assert num_recorded > 100
    recorder.stop()
    assert sum(1 for _ in BagReader(tmp_path / "bag").raw_messages()) >= num_recorded
    stop = getattr(node, "stop", None)
    if stop is not None:
        stop()
