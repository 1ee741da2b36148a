"""A second soil node on the same topics."""

from __future__ import annotations

import pytest
from support.node_scenes import SITE, Scene
from support.soil_node_scenes import NO_MACHINES

from msg_bridge.testing.ros_context import Ros
from soil_sim.node.duplicate_soil_node import DuplicateSoilNodeError
from soil_sim.node.soil_node import SoilNode


def test_soil_node_does_not_start_beside_another_one(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    with pytest.raises(DuplicateSoilNodeError, match="/soil/tick"):
        ros.add(SoilNode, discovery_time=5.0, parameters=SITE)
    scene.until_tick(5)
    assert scene.soil.count_publishers("/soil/tick") == 1


def test_soil_node_starts_beside_one_in_another_namespace(ros: Ros) -> None:
    Scene(ros, **NO_MACHINES)
    other: SoilNode = ros.add(SoilNode, namespace="/b", discovery_time=0.5, parameters=SITE)
    assert other.run.tick == -1


def test_two_soil_nodes_report_each_other(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    ros.add(SoilNode, parameters=SITE)
    scene.until_shown(scene.soil, "level", 2)
    assert "another soil node publishes /soil/tick" in scene.shown(scene.soil)["message"]
