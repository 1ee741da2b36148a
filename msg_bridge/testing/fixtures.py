"""pytest fixtures for tests of nodes, without launch: of this package's, and of yours with them.

In the `conftest.py` of your tests:

    pytest_plugins = ["msg_bridge.testing.fixtures"]

A complete test of a node of yours against the soil's, both in the test's own process:

    from std_srvs.srv import Trigger
    from msg_bridge.codec.qos import LATCHED
    from sensor_msgs.msg import PointCloud2
    from soil_sim.node.soil_node import SoilNode
    from your_package.planner import Planner

    def test_planner_plans_where_the_terrain_is_high(ros):
        ros.add(SoilNode, parameters={"expected_machines": []})
        planner = ros.add(Planner, parameters={"planner.reach": 6.0})
        maps = ros.collect("/terrain/map", PointCloud2, LATCHED)
        ros.spin_until(lambda: maps and planner.plan is not None)
        assert planner.plan.height > 0.0
        assert ros.call(Trigger, "/soil/verify", Trigger.Request()).success

and of a process:

    def test_planner_ends_cleanly(ros, ros_process):
        process = ros_process([sys.executable, "-m", "your_package.planner"], namespace="/site")
        ros.spin_until(lambda: "/site/planner" in ros.node_names())
        process.stop()  # SIGINT, and the exit code must be 0

Fixtures:

- `ros_domain`: the id of a ROS domain of this test alone, on this machine alone
- `ros`: a `msg_bridge.testing.ros_context.Ros` in that domain
- `ros_process`: starts a `msg_bridge.testing.ros_process.RosProcess` in that domain

Nodes are heard only in their own domain and on this machine, so tests may run beside one another,
beside a running simulation, and in a network full of robots.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import pytest

from msg_bridge.config_files import find_config
from msg_bridge.dds_profile import PROFILE_VARIABLE
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_domain import reserve_domain
from msg_bridge.testing.ros_process import RosProcess

__all__ = ["StartProcess", "ros", "ros_domain", "ros_process"]


class StartProcess(Protocol):
    """What the fixture `ros_process` is."""

    def __call__(self, command: Sequence[str | os.PathLike[str]], **kwargs: Any) -> RosProcess:
        """Start a process; the keyword arguments are those of `RosProcess`."""


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[int]:
    """The id of a ROS domain that this test alone has, among all tests running on this machine.

    The environment is set for it, so what the test starts is in it too: domain, discovery on this
    machine only, the shipped Fast DDS profile unless another is chosen, and log files in the
    test's temporary folder.
    """
    with reserve_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)  # would stand above the former
        monkeypatch.delenv("ROS_STATIC_PEERS", raising=False)
        if PROFILE_VARIABLE not in os.environ:
            monkeypatch.setenv(PROFILE_VARIABLE, str(find_config("fastdds.xml").resolve()))
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        yield domain


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """Nodes, topics and services in the test's own domain; all destroyed when it ends."""
    made = Ros(ros_domain)
    yield made
    made.close()


@pytest.fixture
def ros_process(ros: Ros, tmp_path: Path) -> Iterator[StartProcess]:
    """Starts nodes as processes; what still runs when the test ends is killed.

    Their output is shown if the test fails. If one ends that should be running, `ros.spin_until`
    says so at once.
    """
    started: list[RosProcess] = []
    number = itertools.count(1)

    def start(command: Sequence[str | os.PathLike[str]], **kwargs: Any) -> RosProcess:
        folder = tmp_path / f"process_{next(number)}"
        folder.mkdir()
        process = RosProcess(command, folder, **kwargs)
        started.append(process)
        ros.fail_on(process.failure_reason)
        return process

    yield start
    for process in started:
        process.kill()
        # pytest shows what is printed here if the test failed.
        print(f"--- output of {process}\n{process.output}")
