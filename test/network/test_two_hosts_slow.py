"""Nodes on two hosts: a machine of the other one joins in the middle of a run, digs and leaves."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from network.two_hosts import NamespaceError, TwoHosts
from support.node_scenes import SITE, TICK, machine_file, ready_to_dig

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_process import RosProcess

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

PROGRAMS = Path(sys.executable).parent
TESTS = Path(__file__).parents[1]
HERE, THERE = range(2)
JOINED = r"/late \(machine_id 2\) joined"
LEFT = r"/late \(machine_id 2\) left"

CONTROLLER = """
import sys
import numpy as np
import rclpy
from sensor_msgs.msg import JointState
sys.path.append(sys.argv[1])
from support.node_scenes import drag_angles, ready_to_dig

rclpy.init()
node = rclpy.create_node("controller")
publisher = node.create_publisher(JointState, "/late/joint_commands", 10)
machine, count = ready_to_dig(), 0

def command():
    global count
    count += 1
    goal = drag_angles(machine, min(count / 60, 1.0)).tolist()
    publisher.publish(JointState(name=["boom", "arm", "bucket"], position=goal))
    if count == 100:
        print("the bucket is curled", flush=True)

node.create_timer(0.05, command)
rclpy.spin(node)
"""


@pytest.fixture
def hosts() -> Iterator[TwoHosts]:
    try:
        made = TwoHosts(loss_percent=1.0, delay_ms=1.0)
    except NamespaceError as error:
        pytest.skip(f"no network namespaces here: {error}")
    yield made
    made.close()


def test_machine_on_another_host_joins_digs_and_leaves(
    hosts: TwoHosts, ros_process: StartProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE", raising=False)
    bag = tmp_path / "bag"

    def start(host: int, program: str, namespace: str = "", **parameters: Any) -> RosProcess:
        command = hosts.command(host, [PROGRAMS / program])
        return ros_process(command, parameters=parameters, namespace=namespace)

    recorder = start(HERE, "exchange_recorder", path=str(bag), progress=False)
    required = {"required_subscribers": ["exchange_recorder"]}
    parameters = {"sync": "realtime", "tick_period": TICK, "admit_other_machines": True, **SITE}
    soil = start(HERE, "soil_sim", **parameters, **required)
    first = start(HERE, "machine_sim", "/excavator", **required)
    soil.wait_for_output(r"/excavator \(machine_id 1\) joined")
    machine = machine_file(tmp_path, ready_to_dig())
    late = start(THERE, "machine_sim", "/late", machine=machine, machine_id=2, y=6.0, **required)
    soil.wait_for_output(JOINED)
    controller = ros_process(hosts.command(HERE, [sys.executable, "-c", CONTROLLER, TESTS]))
    controller.wait_for_output("the bucket is curled", timeout=60.0)
    controller.stop(expect=None)
    late.stop()
    soil.wait_for_output(LEFT)
    for process in (first, soil, recorder):
        process.stop()

    assert audit_bag(bag).passed
    ledgers = [
        from_multi_array(message) for _, _, message in BagReader(bag).messages(["/soil/ledger"])
    ]
    assert {ledger.imbalance for ledger in ledgers} == {0}
    assert ledgers[-1].absent > 10**8, "the soil in the bucket of the machine that has left"
