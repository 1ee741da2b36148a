"""Timers of nodes follow the wall clock, with `use_sim_time` too: the soil produces /clock."""

from __future__ import annotations

import pytest
from support.node_scenes import Scene

from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.testing.ros_context import Ros


def test_timer_fires_while_simulation_time_stands_still(ros: Ros) -> None:
    node = ros.add(SimNode, "timed", parameters={"use_sim_time": True})
    fired: list[int] = []
    node.create_timer(0.01, lambda: fired.append(1))
    ros.spin_until(lambda: fired)


@pytest.mark.parametrize("sync", ["realtime", "lockstep"])
def test_soil_and_machine_run_with_use_sim_time(ros: Ros, sync: str) -> None:
    scene = Scene(ros, sync=sync, use_sim_time=True)
    scene.machine(use_sim_time=True)
    scene.until_tick(5)
    assert scene.joined == (1,)
