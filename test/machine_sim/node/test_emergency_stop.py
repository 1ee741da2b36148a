"""Emergency stop: publishers of any QoS, before and after discovery, in log and diagnostics."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import create_autospec

import pytest
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from support.node_scenes import Scene

from machine_sim.commands import CommandArbiter
from machine_sim.machine import load_machine_spec
from machine_sim.node.emergency_stop import EmergencyStops, StopSubscriptions
from machine_sim.node.machine_node import MachineNode
from msg_bridge.config_files import find_config
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.testing.ros_context import Ros

TOPIC = "/excavator/emergency_stop"
RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
VOLATILE, TRANSIENT_LOCAL = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL


def profile(reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(depth=1, reliability=reliability, durability=durability)


def transient_local(ros: Ros, *values: bool) -> Publisher:
    """Return a transient-local publisher that has published some values."""
    publisher = ros.publisher(TOPIC, Bool, profile(RELIABLE, TRANSIENT_LOCAL))
    for value in values:
        publisher.publish(Bool(data=value))
    return publisher


@pytest.mark.parametrize("durability", [VOLATILE, TRANSIENT_LOCAL])
@pytest.mark.parametrize("reliability", [RELIABLE, BEST_EFFORT])
def test_publisher_of_any_qos_stops_and_releases(
    ros: Ros, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> None:
    received: list[bool] = []
    StopSubscriptions(ros.node("machine"), TOPIC, received.append)
    publisher = ros.publisher(TOPIC, Bool, profile(reliability, durability), subscriptions=1)
    for value in (True, False, True):
        publisher.publish(Bool(data=value))
        ros.spin_until(lambda value=value: received and received[-1] is value)
        ros.spin_for(0.1)  # copies of the message
        assert received[-1] is value


def test_stop_pressed_before_the_node_was_there_holds(ros: Ros) -> None:
    publisher = transient_local(ros, True)
    machine: MachineNode = ros.add(MachineNode)
    arbiter = machine.instances[0].arbiter
    ros.spin_until(lambda: arbiter.is_stopped)
    publisher.publish(Bool(data=False))
    ros.spin_until(lambda: not arbiter.is_stopped)


def test_earlier_release_releases_no_stop_of_another_publisher(ros: Ros) -> None:
    transient_local(ros, False)
    received: list[bool] = []
    node = ros.node("machine")
    StopSubscriptions(node, TOPIC, received.append)
    ros.publisher(TOPIC, Bool, subscriptions=1).publish(Bool(data=True))
    num_before = len(list(node.subscriptions))
    ros.spin_until(lambda: len(list(node.subscriptions)) > num_before)  # to earlier messages
    ros.spin_until(lambda: received)
    ros.spin_for(0.3)
    assert received == [True]


def infos(*times: int) -> list[Any]:
    return [{"source_timestamp": each} for each in times]


def test_late_best_effort_copy_of_a_release_undoes_no_later_stop(ros: Ros) -> None:
    received: list[bool] = []
    stop = StopSubscriptions(ros.node("machine"), TOPIC, received.append)
    (_, live), (_, best_effort) = stop._subscriptions
    released, pressed = infos(1, 2)
    live(Bool(data=False), released)
    live(Bool(data=True), pressed)
    best_effort(Bool(data=False), released)  # its copy of the later message is lost
    assert received[-1] is True


def test_change_is_reported_at_once(ros: Ros) -> None:
    arbiter = CommandArbiter(load_machine_spec(find_config("machines/excavator.yaml")))
    reports: list[bool] = []
    diagnostics = create_autospec(Diagnostics, instance=True)
    diagnostics.publish.side_effect = lambda: reports.append(arbiter.is_stopped)
    instance: Any = SimpleNamespace(name="", topic_prefix="/excavator/", arbiter=arbiter)
    stops = EmergencyStops(ros.node("machine"), diagnostics, [instance], lambda: None)
    publisher = ros.publisher(TOPIC, Bool, subscriptions=1)

    def has_reported(is_stopped: bool) -> bool:
        stops.take_all()
        return bool(reports) and reports[-1] is is_stopped

    for pressed in (True, False):
        publisher.publish(Bool(data=pressed))
        ros.spin_until(lambda pressed=pressed: has_reported(pressed))
        publisher.publish(Bool(data=pressed))  # no change
    ros.spin_for(0.1)
    stops.take_all()
    assert reports == [True, False]


def test_stop_is_in_log_and_diagnostics_while_it_is_pressed(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros)
    machine = scene.machine("/site", machines=["digger", "truck"], **{"truck.y": 6.0})
    scene.until_tick(2)
    publisher = ros.publisher("/site/truck/emergency_stop", Bool, subscriptions=1)
    for _ in range(3):
        publisher.publish(Bool(data=True))
    scene.until_shown(machine, "truck/emergency_stop", True)
    report = scene.shown(machine)
    assert report["level"] == "1"
    assert "emergency stop is pressed: truck" in report["message"]
    assert scene.trigger("/sim/reset").success
    scene.until_tick(5)
    scene.until_shown(machine, "truck/emergency_stop", True)  # it holds across runs
    publisher.publish(Bool(data=False))
    scene.until_shown(machine, "truck/emergency_stop", False)
    assert "emergency stop" not in scene.shown(machine)["message"]
    output = capfd.readouterr().err
    assert output.count("emergency stop of truck is pressed") == 1
    assert output.count("emergency stop of truck is released") == 1
