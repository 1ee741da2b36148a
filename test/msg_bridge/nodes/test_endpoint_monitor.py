"""EndpointMonitor: publishers that other nodes must not have, or that are not received."""

from __future__ import annotations

from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool, Int64MultiArray, String
from support.node_scenes import Scene

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.contract.interface import is_exclusive
from msg_bridge.testing.ros_context import Ros

BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("/soil/tick", True),
        ("/plant/soil/tick", True),
        ("/site/digger/bucket/wrench", True),
        ("/site/hopper/payload", True),
        ("/excavator/soil_tick", True),
        ("/sim/config", True),
        ("/clock", True),
        ("/soil/tool_sweeps", False),
        ("/tf", False),
        ("/diagnostics", False),
        ("/excavator/joint_commands", False),
        ("/excavator/emergency_stop", False),
        ("/rosout", False),
        ("/camera/image", False),
    ],
)
def test_topics_with_one_publishing_executable_are_exclusive(topic: str, expected: bool) -> None:
    assert is_exclusive(topic) is expected


class Monitored:
    """A running machine and soil, of which a test disturbs one."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.scene = ros, Scene(ros, admit_other_machines=True)
        self.machine = self.scene.machine()
        self.scene.until_tick(2)
        self.other = ros.node("forger", namespace="/evil")

    def until_reported(self, node: Any, *parts: str) -> None:
        """Spin until the diagnostics of a node have a message with all parts."""

        def holds() -> bool:
            message = self.scene.shown(node).get("message", "")
            return all(part in message for part in parts)

        self.ros.spin_until(holds, what=f"{parts} in the diagnostics of {node.get_name()}")
        assert self.scene.shown(node)["level"] in ("1", "2")

    def until_ok(self, node: Any) -> None:
        self.scene.until_shown(node, "level", 0)


@pytest.fixture
def monitored(ros: Ros) -> Monitored:
    return Monitored(ros)


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        ("/soil/tick", Int64MultiArray),
        ("/soil/ledger", Int64MultiArray),
        ("/soil/conversions", PointCloud2),
        ("/sim/config", String),
        ("/excavator/conversion_backlog", PointCloud2),
    ],
)
def test_second_publisher_of_a_soil_topic_is_named_until_it_is_gone(
    monitored: Monitored, topic: str, kind: type, capfd: pytest.CaptureFixture[str]
) -> None:
    publisher = monitored.other.create_publisher(kind, topic, qos.TRANSIENT_LOCAL)
    soil = monitored.scene.soil
    monitored.until_reported(soil, "/evil/forger", topic)
    assert monitored.scene.shown(soil)["level"] == "2"
    monitored.other.destroy_publisher(publisher)
    monitored.until_ok(soil)
    output = capfd.readouterr().err
    assert output.count(f"[soil_sim]: another node, /evil/forger, also publishes {topic}") == 1


@pytest.mark.parametrize("has_gap", [True, False])
def test_second_publisher_that_was_restarted_is_logged_again(
    monitored: Monitored, capfd: pytest.CaptureFixture[str], has_gap: bool
) -> None:
    output = ""

    def num_lines() -> int:
        nonlocal output
        output += capfd.readouterr().err
        return output.count("[soil_sim]: another node, /evil/forger, also publishes /soil/tick")

    def publish() -> Publisher:
        return monitored.other.create_publisher(Int64MultiArray, "/soil/tick", qos.ROWS)

    first = publish()
    monitored.ros.spin_until(lambda: num_lines() == 1)
    if has_gap:
        monitored.other.destroy_publisher(first)
        monitored.until_ok(monitored.scene.soil)
        publish()
    else:  # the next one is there before the first is found to be gone
        publish()
        monitored.other.destroy_publisher(first)
    monitored.ros.spin_until(lambda: num_lines() == 2)


def test_second_publisher_is_named_by_subscribers(monitored: Monitored) -> None:
    monitored.other.create_publisher(Int64MultiArray, "/soil/tick", qos.ROWS)
    monitored.until_reported(
        monitored.machine, "/evil/forger and /soil_sim both publish /soil/tick"
    )


def test_second_publisher_of_unknown_name_may_have_been_killed(
    monitored: Monitored, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, killed = monitored.machine, monitored.other
    find_publishers = node.get_publishers_info_by_topic

    def without_name(topic: str) -> list[TopicEndpointInfo]:
        infos = find_publishers(topic)
        for info in infos:
            if info.node_name == killed.get_name():
                info.node_name = "_NODE_NAME_UNKNOWN_"
                info.node_namespace = "_NODE_NAMESPACE_UNKNOWN_"
        return infos

    monkeypatch.setattr(node, "get_publishers_info_by_topic", without_name)
    killed.create_publisher(String, "/sim/config", qos.TRANSIENT_LOCAL)
    named = "nodes /soil_sim and a node of unknown name both publish /sim/config"
    monitored.until_reported(node, named, "if one was killed, its DDS lease ends in 10 s")


def test_publisher_of_rows_that_is_no_machine_node_is_named(monitored: Monitored) -> None:
    second = monitored.scene.machine("/truck", machine_id=2, y=8.0)
    monitored.ros.spin_until(lambda: monitored.scene.joined == (1, 2))
    monitored.until_ok(monitored.scene.soil)  # several machine nodes publish rows
    publisher = monitored.other.create_publisher(PointCloud2, "/soil/tool_sweeps", qos.ROWS)
    monitored.until_reported(monitored.scene.soil, "/evil/forger", "/soil/tool_sweeps")
    monitored.other.destroy_publisher(publisher)
    monitored.until_ok(monitored.scene.soil)
    assert second.diagnostics.report().level == 0


@pytest.mark.parametrize(
    ("node", "topic", "kind", "profile", "reason"),
    [
        ("soil", "/soil/deposit_requests", PointCloud2, BEST_EFFORT, "best effort publisher"),
        ("machine", "/sim/paused", Bool, qos.ROWS, "volatile publisher"),
    ],
)
def test_publisher_that_is_not_received_is_named_with_the_reason(
    monitored: Monitored, node: str, topic: str, kind: type, profile: QoSProfile, reason: str
) -> None:
    checked = monitored.scene.soil if node == "soil" else monitored.machine
    publisher = monitored.other.create_publisher(kind, topic, profile)
    monitored.until_reported(checked, "/evil/forger", topic, reason)
    monitored.other.destroy_publisher(publisher)
    monitored.until_ok(checked)


def test_publisher_of_another_type_is_named(monitored: Monitored) -> None:
    context = Context()  # a participant has one type for each topic
    rclpy.init(context=context, domain_id=monitored.ros.domain)
    intruder = Node("intruder", context=context)
    try:
        intruder.create_publisher(Bool, "/excavator/cmd_vel", qos.ROWS)
        monitored.until_reported(
            monitored.machine, "/intruder on /excavator/cmd_vel", "its type is std_msgs/msg/Bool"
        )
    finally:
        intruder.destroy_node()
        rclpy.shutdown(context=context)
    monitored.until_ok(monitored.machine)


def test_received_publishers_are_not_reported(monitored: Monitored) -> None:
    machine: MachineNode = monitored.machine
    for profile in (BEST_EFFORT, qos.ROWS, qos.TRANSIENT_LOCAL):
        monitored.other.create_publisher(Bool, "/excavator/emergency_stop", profile)
        monitored.other.create_publisher(TwistStamped, "/excavator/cmd_vel", profile)
    reports = len(monitored.scene._diagnostics)
    monitored.ros.spin_until(lambda: len(monitored.scene._diagnostics) > reports + 5)
    assert monitored.scene.shown(machine)["level"] == "0"
