"""pytest fixtures for launch-free tests of ROS nodes.

In the `conftest.py` of your tests:

    pytest_plugins = ["msg_bridge.testing.fixtures"]

A complete test of your node against the soil node, both in the process of the test:

    from std_srvs.srv import Trigger
    from msg_bridge.codec.qos import TRANSIENT_LOCAL
    from sensor_msgs.msg import PointCloud2
    from soil_sim.node.soil_node import SoilNode
    from your_package.planner import Planner

    def test_planner_plans_where_the_terrain_is_high(ros):
        ros.add(SoilNode, parameters={"expected_machines": []})
        planner = ros.add(Planner, parameters={"planner.reach": 6.0})
        maps = ros.collect("/terrain/map", PointCloud2, TRANSIENT_LOCAL)
        ros.spin_until(lambda: maps and planner.plan is not None)
        assert planner.plan.height > 0.0
        assert ros.call(Trigger, "/soil/verify", Trigger.Request()).success

and of your node as a process:

    def test_planner_ends_cleanly(ros, ros_process):
        process = ros_process([sys.executable, "-m", "your_package.planner"], namespace="/site")
        ros.spin_until(lambda: "/site/planner" in ros.node_names())
        process.stop()  # SIGINT, and the exit code must be 0

Fixtures:

- `ros_domain`: id of a ROS domain that only this test uses, on this machine only
- `ros`: a `msg_bridge.testing.ros_context.Ros` in that domain
- `ros_process`: starts a `msg_bridge.testing.ros_process.RosProcess` in that domain

Discovery is limited to the domain and to this machine, so tests may run in parallel, beside a
running simulation, and in a network with robots.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import pytest

from msg_bridge.dds_profile import LOCALHOST_PROFILE, PROFILE_VARIABLE, use_shipped_profile
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_domain import reserve_domain
from msg_bridge.testing.ros_process import RosProcess

__all__ = ["StartProcess", "limit_discovery_to_this_host", "ros", "ros_domain", "ros_process"]


class StartProcess(Protocol):
    """Type of the fixture `ros_process`."""

    def __call__(self, command: Sequence[str | os.PathLike[str]], **kwargs: Any) -> RosProcess:
        """Start a process; the keyword arguments are those of `RosProcess`."""


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[int]:
    """Reserve a ROS domain for one test and return its id.

    The environment is set accordingly and inherited by child processes: domain, discovery on this
    host only, the shipped Fast DDS profile unless another is chosen, and log files in the temporary
    folder of the test.
    """
    with reserve_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        limit_discovery_to_this_host(monkeypatch)
        yield domain


def limit_discovery_to_this_host(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limit discovery of this process and its children to this host while a patch lasts, with the
    shipped Fast DDS profile unless another is chosen.
    """
    monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)  # would override the range
    monkeypatch.delenv("ROS_STATIC_PEERS", raising=False)
    if Path(os.environ.get(PROFILE_VARIABLE, "")).name == LOCALHOST_PROFILE:
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")
        return
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if PROFILE_VARIABLE not in os.environ:
        monkeypatch.setenv(PROFILE_VARIABLE, "")  # so that the patch removes it at its end
        monkeypatch.delenv(PROFILE_VARIABLE)
    use_shipped_profile()


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """Return nodes, topics and services in the domain of the test; destroyed when it ends."""
    made = Ros(ros_domain)
    yield made
    made.close()


@pytest.fixture
def ros_process(ros: Ros, tmp_path: Path) -> Iterator[StartProcess]:
    """Return a function that starts a process; those still running at the end are killed.

    Their output is shown if the test fails. `ros.spin_until` fails as soon as a process has ended
    that should be running, and the end of the test if one has ended with another exit code than 0.
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
    crashes = [crash for process in started if (crash := process.crash()) is not None]
    for process in started:
        process.kill()
        # pytest shows what is printed here if the test failed.
        print(f"--- output of {process}\n{process.output}")
    assert not crashes, "\n".join(crashes)
