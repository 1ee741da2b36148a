"""A second soil node on the same topics, or a second machine node in one namespace."""

from __future__ import annotations

import re

import pytest
from support.node_scenes import SITE, Scene
from support.soil_node_scenes import NO_MACHINES

from machine_sim.node.machine_node import MachineNode
from msg_bridge.nodes.duplicate_node import DuplicateNodeError
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode


def test_soil_node_does_not_start_beside_another_one(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    with pytest.raises(DuplicateNodeError, match="/soil_sim, publishes /soil/tick; give each"):
        ros.add(SoilNode, discovery_time=5.0, parameters=SITE)
    scene.until_tick(5)
    assert scene.soil.count_publishers("/soil/tick") == 1


def test_soil_node_starts_beside_one_in_another_namespace(ros: Ros) -> None:
    Scene(ros, **NO_MACHINES)
    other: SoilNode = ros.add(SoilNode, namespace="/b", discovery_time=0.5, parameters=SITE)
    assert other.run.tick == -1


def test_two_soil_nodes_report_each_other_until_one_is_gone(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(1)
    other = ros.add(SoilNode, parameters=SITE, namespace="/")
    other_name = "another node, /soil_sim, also publishes"
    ros.spin_until(lambda: other_name in scene.shown(scene.soil).get("message", ""))
    assert scene.shown(scene.soil)["level"] == "2"
    ros.remove(other)
    scene.until_shown(scene.soil, "level", 0)
    lines = capfd.readouterr().err.splitlines()
    assert any("[ERROR]" in line and other_name in line for line in lines)
    assert any(f"no longer: {other_name}" in line for line in lines)


@pytest.mark.parametrize("machine_id", [1, 2])
def test_machine_node_does_not_start_in_the_namespace_of_another_one(
    ros: Ros, machine_id: int
) -> None:
    scene = Scene(ros)
    scene.machine()
    given = {"machine_id": machine_id}
    with pytest.raises(
        DuplicateNodeError,
        match=r"/excavator/machine_sim, publishes /excavator/soil_tick; .* own namespace",
    ):
        ros.add(MachineNode, discovery_time=5.0, parameters=given)
    scene.until_tick(5)


def test_machine_node_does_not_start_on_the_topics_of_a_machine_of_another_node(ros: Ros) -> None:
    Scene(ros)
    ros.add(MachineNode, namespace="/site", parameters={"machines": ["digger"]})
    with pytest.raises(DuplicateNodeError, match="publishes /site/digger/joint_states"):
        ros.add(MachineNode, namespace="/site/digger", discovery_time=5.0)


def test_soil_rejects_the_second_machine_id_of_a_namespace(ros: Ros) -> None:
    scene = Scene(ros)
    first = scene.machine()
    scene.until_tick(2)
    second = scene.machine(machine_id=2)  # within the discovery time of the first
    reason = r"/excavator is the namespace of the machine node with machine_id 1; start the node"
    scene.until_shown(second, "join_state", "out")
    ros.spin_until(lambda: re.search(reason, second.diagnostics.report().message))
    other = "another node, /excavator/machine_sim, also publishes"
    for node in (first, second):
        ros.spin_until(lambda node=node: other in node.diagnostics.report().message)
        assert node.diagnostics.report().level == 2
    assert scene.joined == (1,)
    ros.remove(second)
    scene.until_shown(first, "level", 0)
    scene.more_ticks(5)


def test_node_with_another_machine_id_replaces_one_that_is_gone(ros: Ros) -> None:
    scene = Scene(
        ros, expected_machines=[], admit_other_machines=True, sync="realtime", machine_timeout=0.5
    )
    first = scene.machine()
    ros.spin_until(lambda: scene.joined == (1,))
    ros.remove(first)
    scene.machine(machine_id=2)
    ros.spin_until(lambda: scene.joined == (2,))
