"""Hostile messages on every topic that soil and machine nodes subscribe to change no state.

Each is reported in the diagnostics of its node. Time stands still meanwhile, so that the states can
be compared; then the run continues.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from chaos.hostile_messages import hostile_messages, large_cloud
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool
from support.node_scenes import Scene, dig, machine_file, ready_to_dig

from msg_bridge.testing.ros_context import Ros

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

VALID = {Bool}
"""Types of which each message is valid: pause and emergency stop."""


def publisher_of(ros: Ros, node: Node, topic: str, kind: type) -> Publisher:
    """Return a publisher that matches the subscriptions of a node."""
    profiles = [each.qos_profile for each in node.subscriptions if each.topic_name == topic]
    return ros.publisher(topic, kind, profiles[0], subscriptions=1)


def test_hostile_messages_change_no_state(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros)
    machine = scene.machine(
        machine=machine_file(tmp_path, ready_to_dig()), **{"commands.command_timeout": 60.0}
    )
    dig(scene, machine, lambda ledger: ledger.particles > 10**8)
    ros.publisher("/excavator/joint_commands", JointState, subscriptions=1).publish(
        JointState(name=["boom", "arm", "bucket"], velocity=[0.0, 0.0, 0.0])
    )
    scene.more_ticks(20)
    scene.pause()
    ros.spin_for(0.5)  # the last answer is applied
    assert machine.run is not None
    before = scene.soil.run.endpoint.soil.state_hash(), machine.run.sim.state_hash()
    arbiter = machine.instances[0].arbiter
    for node in (scene.soil, machine):
        topics = {each.topic_name: each.msg_type for each in node.subscriptions}
        for topic, kind in topics.items():
            if kind in VALID:
                continue
            publisher = publisher_of(ros, node, topic, kind)
            for name, message in hostile_messages(kind):
                publisher.publish(message)
                ros.spin_for(0.02)
                moved = [each for each in arbiter.state.active.values() if each.setpoint.value]
                assert not moved, f"{name} on {topic} is taken for a command"
            until_rejected(scene, node, topic, 1)
            if kind is PointCloud2:
                count = num_rejected(scene, node, topic)
                publisher.publish(large_cloud())
                until_rejected(scene, node, topic, count + 1)
            ros.helper.destroy_publisher(publisher)
    ros.spin_for(1.0)
    assert (scene.soil.run.endpoint.soil.state_hash(), machine.run.sim.state_hash()) == before
    scene.pause(False)
    scene.more_ticks(100)
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.joined == (1,)


def num_rejected(scene: Scene, node: Node, topic: str) -> int:
    """Return the number of rejected messages of a topic in the diagnostics of a node."""
    node.diagnostics.publish()  # type: ignore[attr-defined]
    names = {each.split()[-1]: each for each in scene.shown(node) if each.startswith("rejected ")}
    counts = [int(scene.shown(node)[key]) for name, key in names.items() if topic.endswith(name)]
    return max(counts, default=0)


def until_rejected(scene: Scene, node: Node, topic: str, count: int) -> None:
    scene.ros.spin_until(
        lambda: num_rejected(scene, node, topic) >= count,
        timeout=60.0,
        what=f"{count} rejected messages on {topic} in the diagnostics",
    )
