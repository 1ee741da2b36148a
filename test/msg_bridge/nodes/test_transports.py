"""The exchange over topics: several machines, late ones, silent ones, messages lost or broken."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Int64MultiArray, String
from support.node_scenes import Scene, dig, machine_file, ready_to_dig

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.tick_headers import to_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.testing.ros_context import Ros


def digger(scene: Scene, folder: Path, namespace: str = "/excavator", **params: Any) -> MachineNode:
    """A machine that is ready to dig, once told."""
    path = machine_file(folder, ready_to_dig())
    options = {"commands.command_timeout": 60.0, "machine": path, **params}
    return scene.machine(namespace, **options)


def held(machine: MachineNode) -> int:
    """What a machine holds [mm^3]."""
    assert machine.run is not None
    sim = machine.run.sim
    return sim.pending_mm3 + sim.particles.total_volume_mm3


def balanced(scene: Scene) -> bool:
    return {ledger.imbalance for ledger in scene.ledgers} == {0}


# Several machines.


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_two_machines_take_part_at_once(ros: Ros, sync: str) -> None:
    applied = [
        ros.collect(f"/{name}/applied_commands", JointState) for name in ("excavator", "digger")
    ]
    scene = Scene(ros, sync=sync, expected_machines=[1, 7], machine_timeout=20.0)
    first = scene.machine(y=4.0)
    second = scene.machine("/digger", machine_id=7, y=-4.0)
    scene.until_tick(20)
    assert scene.joined == (1, 7)
    ros.spin_until(lambda: all(len(each) > 5 for each in applied))
    assert first.run is not None
    assert second.run is not None
    assert min(first.run.tick, second.run.tick) > 10
    scene.until_shown(scene.soil, "machines", "1, 7")


def test_each_of_two_machines_is_credited_with_what_it_digs(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, expected_machines=[1, 2])
    first = digger(scene, tmp_path, y=5.0)
    second = digger(scene, tmp_path, "/excavator_2", machine_id=2, y=-5.0)
    scene.until_tick(1)
    dig(scene, second, lambda ledger: ledger.particles > 2 * 10**7)
    assert held(first) == 0
    assert held(second) > 10**7
    scene.leave(first)
    dug = scene.tick
    scene.until_tick(dug + 5)
    assert scene.joined == (2,)
    assert balanced(scene)


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_a_machine_may_come_late(ros: Ros, tmp_path: Path, sync: str) -> None:
    scene = Scene(ros, sync=sync, machine_timeout=20.0)
    first = digger(scene, tmp_path)
    dig(scene, first, lambda ledger: ledger.particles > 10**7)
    late = scene.machine("/excavator_2", machine_id=2, y=-6.0)
    ros.spin_until(lambda: scene.joined == (1, 2))
    ros.spin_until(lambda: late.run is not None and late.run.endpoint.exchange.joined)
    scene.more_ticks(10)
    scene.pause()
    soil = scene.soil.run.endpoint.soil
    assert late.run is not None
    ros.spin_until(lambda: late.run.endpoint.exchange.join_state.value != "joining")
    assert late.run.sim.ground.elevation.min() < -0.01
    known = np.abs(late.run.sim.ground.elevation - soil.columns.height)
    assert np.count_nonzero(known > 0.02) < 30  # but for the last tick or two it is the same
    assert balanced(scene)


def test_a_second_machine_with_the_same_source_is_refused_and_the_first_goes_on(
    ros: Ros,
) -> None:
    scene = Scene(ros)
    first = scene.machine()
    second = scene.machine("/excavator_2")
    scene.until_tick(5)
    joined = [m for m in (first, second) if m.run and m.run.endpoint.exchange.joined]
    assert len(joined) == 1
    owner = joined[0]
    other = second if owner is first else first
    scene.until_shown(other, "level", 2)
    message = scene.shown(other)["message"]
    assert f"machine_id 1 belongs to {owner.get_namespace()}" in message
    assert f"give {other.get_namespace()} another `machine_id`" in message
    scene.soil.diagnostics.publish()
    topic = f"{other.get_namespace()}/soil_tick"
    ros.spin_until(lambda: int(scene.shown(scene.soil).get(f"rejected {topic}", 0)) >= 1)
    stood = scene.tick
    scene.until_tick(stood + 20)
    assert scene.joined == (1,)
    assert balanced(scene)


# Silent machines.


def test_in_real_time_a_machine_that_stands_still_is_absent_until_it_is_back(
    ros: Ros, tmp_path: Path
) -> None:
    scene = Scene(ros, sync="realtime", machine_timeout=0.4)
    machine = digger(scene, tmp_path)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    ros.executor.remove_node(machine)  # as if its process were stopped
    ros.spin_until(lambda: scene.joined == ())
    dropped = scene.tick
    scene.until_tick(dropped + 2)
    gone = scene.ledgers[-1]
    assert (gone.pending, gone.particles) == (0, 0)
    assert gone.absent > 10**7
    scene.until_shown(scene.soil, "machines_dropped", 1)
    stood = scene.tick
    scene.until_tick(stood + 10)  # and the soil goes on
    ros.executor.add_node(machine)
    ros.spin_until(lambda: scene.joined == (1,))
    scene.more_ticks(10)
    assert scene.ledgers[-1].absent == 0
    assert scene.ledgers[-1].particles > 0
    scene.until_shown(machine, "times_dropped", 1)
    assert balanced(scene)


def test_in_lockstep_a_silent_machine_is_reported_and_waited_for(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, machine_timeout=0.2)
    machine = scene.machine()
    scene.until_tick(3)
    ros.executor.remove_node(machine)
    told = ""

    def reported() -> bool:
        nonlocal told
        told += capfd.readouterr().err
        return "silent for" in told

    ros.spin_until(reported)
    assert "/excavator (machine_id 1) silent for" in told
    assert "the run waits" in told
    stood = scene.tick
    ros.spin_for(0.3)
    assert scene.tick == stood
    assert scene.joined == (1,)
    ros.executor.add_node(machine)
    scene.until_tick(stood + 10)
    assert balanced(scene)


# Messages that are lost, or broken.


class Leak:
    """Loses every so manieth message on its way into a node."""

    def __init__(self, carrier: Any, every: int, most: int) -> None:
        self._receive: Callable[[Message], None] = carrier._receive
        self.every, self.most = every, most
        self.count = 0
        self.lost: list[Message] = []
        carrier._receive = self

    def __call__(self, message: Message) -> None:
        self.count += 1
        if self.count % self.every == 0 and len(self.lost) < self.most:
            self.lost.append(message)
        else:
            self._receive(message)


def test_what_is_lost_on_the_way_is_asked_for_again(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros)
    machine = digger(scene, tmp_path)
    scene.until_tick(1)
    leaks = [Leak(scene.soil._transport, 7, 2), Leak(machine._transport, 11, 3)]
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    ros.spin_until(lambda: all(len(leak.lost) == leak.most for leak in leaks))
    scene.more_ticks(20)
    scene.pause()
    assert machine.run is not None
    assert balanced(scene)
    assert scene.trigger("/soil/verify").success
    assert len({type(message) for leak in leaks for message in leak.lost}) > 1
    refused = [key for key in scene.soil.diagnostics.report().values if key.startswith("refused")]
    assert refused == []


BROKEN_FOR_SOIL = [
    ("/soil/tool_sweeps", PointCloud2()),
    ("/soil/deposit_requests", PointCloud2(height=1, width=9)),
    ("/excavator/soil_tick", Int64MultiArray()),
    ("/excavator/soil_tick", Int64MultiArray(data=[1, 2, 3])),
    ("/excavator/soil_tick", to_multi_array(Ledger(1, 1, 0, 0, 0, 0, 0, 0, 0))),
]
BROKEN_FOR_MACHINE = [
    ("/soil/tick", Int64MultiArray(data=[7])),
    ("/soil/tick", to_multi_array(Ledger(1, 1, 0, 0, 0, 0, 0, 0, 0))),
    ("/soil/conversions", PointCloud2()),
    ("/terrain/map_updates", PointCloud2()),
    ("/soil/forces", PointCloud2()),
    ("/excavator/conversion_backlog", PointCloud2()),
    ("/soil/join_rejections", String(data="no")),
    ("/terrain/map", PointCloud2()),
    ("/sim/config", String(data="run: 3")),
]


@pytest.mark.parametrize("whom", ["soil", "machine"])
def test_broken_messages_are_counted_and_change_nothing(ros: Ros, whom: str) -> None:
    scene = Scene(ros)
    machine = scene.machine()
    scene.until_tick(3)
    node = scene.soil if whom == "soil" else machine
    counts: dict[str, int] = {}
    for topic, message in BROKEN_FOR_SOIL if whom == "soil" else BROKEN_FOR_MACHINE:
        latched = topic in ("/terrain/map", "/sim/config")
        profile = qos.TRANSIENT_LOCAL if latched else qos.ROWS
        publisher = ros.publisher(topic, type(message), profile, subscriptions=1)
        publisher.publish(message)
        counts[topic] = counts.get(topic, 0) + 1
        # A node counts topics in its own namespace by their relative names.
        is_own = topic.startswith("/excavator/") == (node is machine)
        prefix = "/excavator/" if node is machine else "/"
        key = f"rejected {topic.removeprefix(prefix) if is_own else topic}"
        scene.until_shown(node, key, counts[topic])
        assert scene.shown(node)[f"last {key}"]
        ros.helper.destroy_publisher(publisher)
    scene.more_ticks(10)
    assert scene.joined == (1,)
    assert balanced(scene)
