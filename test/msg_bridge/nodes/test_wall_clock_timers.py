"""With `use_sim_time` the nodes go by the wall clock all the same: they are what makes time."""

from __future__ import annotations

import pytest
from support.node_scenes import Scene

from dig_operator.node import DigOperatorNode
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.terrain_subscriber import TerrainSubscriber
from msg_bridge.testing.ros_context import Ros


def test_a_timer_fires_while_simulation_time_stands_still(ros: Ros) -> None:
    node = ros.add(SimNode, "timed", parameters={"use_sim_time": True})
    fired: list[int] = []
    node.create_timer(0.01, lambda: fired.append(1))
    ros.spin_until(lambda: fired)


@pytest.mark.parametrize("sync", ["realtime", "lockstep"])
def test_soil_and_machine_begin_and_go_on_with_use_sim_time(ros: Ros, sync: str) -> None:
    scene = Scene(ros, sync=sync, use_sim_time=True)
    scene.machine(use_sim_time=True)
    scene.until_tick(5)
    assert scene.joined == (1,)


def test_the_terrain_is_looked_for_while_simulation_time_stands_still(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []
    monkeypatch.setattr(TerrainSubscriber, "_on_stall", lambda self: looked.append(1))
    ros.add(DigOperatorNode, parameters={"use_sim_time": True})
    ros.spin_until(lambda: looked)
