"""Diagnostics of several publishers that command the same machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState, Joy
from support.node_scenes import Scene

from machine_sim.node.machine_node import MachineNode
from msg_bridge.testing.ros_context import Ros

PERIOD = 0.02


def swing(velocity: float) -> JointState:
    return JointState(name=["swing"], velocity=[velocity])


def joystick(left_x: float) -> Joy:
    return Joy(axes=[left_x, *[0.0] * 5], buttons=[0] * 12)


class Commanded:
    """A machine in real time, and nodes that command it periodically."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.scene = ros, Scene(ros, sync="realtime")
        self.machine: MachineNode = self.scene.machine()
        self.scene.until_tick(2)
        self.num_published: dict[str, int] = {}

    def start(self, name: str, topic: str, message: Any) -> tuple[Node, Publisher]:
        """Start a node that publishes a command at 50 Hz."""
        node = self.ros.node(name, namespace="/operators")
        publisher = node.create_publisher(type(message), f"/excavator/{topic}", 10)
        self.num_published[name] = 0

        def publish() -> None:
            publisher.publish(message)
            self.num_published[name] += 1

        node.create_timer(PERIOD, publish)
        return node, publisher

    @property
    def message(self) -> str:
        return self.scene.shown(self.machine).get("message", "")

    def present_message(self) -> str:
        """Return the message of diagnostics that are published now."""
        self.machine.diagnostics.publish()
        return self.machine.diagnostics.report().message

    def until(self, holds: Callable[[], bool]) -> None:
        self.ros.spin_until(holds, what=f"other diagnostics than {self.message!r}")


@pytest.fixture
def commanded(ros: Ros) -> Commanded:
    return Commanded(ros)


@pytest.mark.parametrize(
    ("topic", "other"), [("joint_commands", swing(-0.2)), ("joy", joystick(0.2))]
)
def test_nodes_that_command_a_machine_in_turn_are_named_until_one_ends(
    commanded: Commanded, topic: str, other: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    commanded.start("first", "joint_commands", swing(0.2))
    second, publisher = commanded.start("second", topic, other)
    names = (
        "/operators/first on /excavator/joint_commands",
        f"/operators/second on /excavator/{topic}",
    )
    commanded.until(lambda: all(name in commanded.message for name in names))
    assert "the machine in turn (swing" in commanded.message
    assert commanded.scene.shown(commanded.machine)["level"] == "1"
    second.destroy_publisher(publisher)
    commanded.ros.remove(second)
    commanded.until(lambda: "in turn" not in commanded.message)
    output = capfd.readouterr().err
    assert output.count("several publishers command the machine") == 1
    assert output.count("no longer alternate") == 1


def test_nodes_that_do_not_command_the_same_joints_are_not_reported(commanded: Commanded) -> None:
    commanded.start("arm", "joint_commands", JointState(name=["arm"], velocity=[0.0]))
    commanded.start("swing", "joint_commands", swing(0.1))
    commanded.start("idle", "joy", joystick(0.0))
    commanded.until(lambda: min(commanded.num_published.values()) > 1.5 / PERIOD)
    assert "in turn" not in commanded.present_message()


def test_node_that_takes_over_is_not_reported(commanded: Commanded) -> None:
    first, publisher = commanded.start("first", "joint_commands", swing(0.1))
    commanded.until(lambda: commanded.num_published["first"] > 0.5 / PERIOD)
    commanded.start("second", "joint_commands", swing(-0.1))
    first.destroy_publisher(publisher)
    commanded.ros.remove(first)
    commanded.until(lambda: commanded.num_published["second"] > 1.5 / PERIOD)
    assert "in turn" not in commanded.present_message()
