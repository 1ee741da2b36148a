"""A machine stays in its run while another publisher announces a run."""

from __future__ import annotations

import pytest
from std_msgs.msg import String
from support.node_scenes import Scene

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.testing.ros_context import Ros


def run_id(machine: MachineNode) -> int:
    assert machine.run is not None
    return machine.run.facts.run_id


@pytest.fixture
def scene(ros: Ros) -> Scene:
    return Scene(ros, hash_rate=100.0)


@pytest.fixture
def machine(scene: Scene) -> MachineNode:
    machine = scene.machine()
    scene.until_tick(3)
    return machine


def forge_run(ros: Ros, scene: Scene, machine: MachineNode, number: int) -> None:
    """Announce the run of the soil node with another number, and its terrain."""
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: configs)
    text = configs[-1].data.replace(f"run_id: {run_id(machine)}", f"run_id: {number}")
    publisher = ros.publisher("/sim/config", String, qos.TRANSIENT_LOCAL, subscriptions=1)
    publisher.publish(String(data=text))
    ros.spin_until(lambda: len(configs) > 1)


def test_announced_run_of_another_publisher_is_not_joined(
    ros: Ros, scene: Scene, machine: MachineNode, capfd: pytest.CaptureFixture[str]
) -> None:
    present = run_id(machine)
    forge_run(ros, scene, machine, present + 5)
    scene.more_ticks(20)
    assert run_id(machine) == present
    assert f"run {present + 5} was announced" in capfd.readouterr().err


def test_reset_is_followed_although_there_is_another_publisher(
    ros: Ros, scene: Scene, machine: MachineNode
) -> None:
    present = run_id(machine)
    forge_run(ros, scene, machine, present + 5)
    assert scene.trigger("/sim/reset").success
    ros.spin_until(lambda: run_id(machine) == present + 1, what="the run after the reset")
    ros.spin_until(lambda: scene.joined == (1,))
