"""The exchange over topics: several, late and silent machines; lost and malformed messages."""

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
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.testing.ros_context import Ros


def digger(scene: Scene, folder: Path, namespace: str = "/excavator", **params: Any) -> MachineNode:
    """Add a machine whose bucket is just above the ground, with a long command timeout."""
    path = machine_file(folder, ready_to_dig())
    options = {"commands.command_timeout": 60.0, "machine": path, **params}
    return scene.machine(namespace, **options)


def soil_of(machine: MachineNode) -> int:
    """Return the bank volume in a machine's particles and pending soil [mm^3]."""
    assert machine.run is not None
    sim = machine.run.sim
    return sim.pending_mm3 + sim.particles.total_volume_mm3


def is_balanced(scene: Scene) -> bool:
    return {ledger.imbalance for ledger in scene.ledgers} == {0}


# Several machines.


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_two_machines_run_at_the_same_time(ros: Ros, sync: str) -> None:
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


def test_soil_is_credited_to_the_machine_that_excavated_it(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, expected_machines=[1, 2])
    first = digger(scene, tmp_path, y=5.0)
    second = digger(scene, tmp_path, "/excavator_2", machine_id=2, y=-5.0)
    scene.until_tick(1)
    dig(scene, second, lambda ledger: ledger.particles > 2 * 10**7)
    assert soil_of(first) == 0
    assert soil_of(second) > 10**7
    scene.leave(first)
    dug = scene.tick
    scene.until_tick(dug + 5)
    assert scene.joined == (2,)
    assert is_balanced(scene)


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_machine_that_joins_late_receives_the_changed_terrain(
    ros: Ros, tmp_path: Path, sync: str
) -> None:
    scene = Scene(ros, sync=sync, machine_timeout=20.0, admit_other_machines=True)
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
    difference = np.abs(late.run.sim.ground.elevation - soil.columns.height)
    assert np.count_nonzero(difference > 0.02) < 30  # changes of the last tick or two
    assert is_balanced(scene)


def test_second_machine_with_the_same_machine_id_is_rejected_and_the_first_continues(
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
    assert owner.get_namespace() in message
    assert f"give {other.get_namespace()} another `machine_id`" in message
    scene.soil.diagnostics.publish()
    topic = f"{other.get_namespace()}/soil_tick"
    ros.spin_until(
        lambda: (
            scene.shown(scene.soil)
            .get(f"last rejected {topic}", "")
            .startswith(ErrorCode.MACHINE_ID_TAKEN)
        )
    )
    scene.more_ticks(20)
    assert scene.joined == (1,)
    assert is_balanced(scene)


# Silent machines.


def test_silent_machine_is_absent_in_real_time_until_it_rejoins(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, sync="realtime", machine_timeout=0.4)
    machine = digger(scene, tmp_path)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    ros.executor.remove_node(machine)  # its process is suspended
    ros.spin_until(lambda: scene.joined == ())
    scene.more_ticks(2)
    ledger = scene.ledgers[-1]
    assert (ledger.pending, ledger.particles) == (0, 0)
    assert ledger.absent > 10**7
    scene.until_shown(scene.soil, "machines_dropped", 1)
    scene.more_ticks(10)  # the soil continues without the machine
    ros.executor.add_node(machine)
    ros.spin_until(lambda: scene.joined == (1,))
    scene.more_ticks(10)
    assert scene.ledgers[-1].absent == 0
    assert scene.ledgers[-1].particles > 0
    scene.until_shown(machine, "times_dropped", 1)
    assert is_balanced(scene)


def test_silent_machine_is_reported_and_waited_for_in_lockstep(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros)
    machine = scene.machine()
    scene.until_tick(3)
    scene.until_shown(scene.soil, "waiting_for", "nothing")
    ros.executor.remove_node(machine)
    ros.spin_until(lambda: "tick of /excavator" in scene.shown(scene.soil)["waiting_for"])
    assert scene.shown(scene.soil)["level"] == "1"
    stood = scene.tick
    ros.spin_for(0.3)
    assert scene.tick == stood
    assert scene.joined == (1,)
    ros.executor.add_node(machine)
    scene.until_tick(stood + 10)
    scene.until_shown(scene.soil, "waiting_for", "nothing")
    assert scene.shown(scene.soil)["level"] == "0"
    lines = [line for line in capfd.readouterr().err.splitlines() if "for the tick of" in line]
    assert ["waiting for" in line for line in lines] == [True, False]  # it begins and ends
    assert is_balanced(scene)


# Lost and malformed messages.


class LossyReceiver:
    """Method `receive` that drops every `every`-th message, at most `max_lost`."""

    def __init__(self, receive: Callable[[Message], None], every: int, max_lost: int) -> None:
        self._receive = receive
        self.every, self.max_lost = every, max_lost
        self.count = 0
        self.lost: list[Message] = []

    def __call__(self, message: Message) -> None:
        self.count += 1
        if self.count % self.every == 0 and len(self.lost) < self.max_lost:
            self.lost.append(message)
        else:
            self._receive(message)


def test_lost_messages_are_requested_again(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene(ros)
    machine = digger(scene, tmp_path)
    scene.until_tick(1)
    assert machine.run is not None
    soil_end, machine_end = scene.soil.run.endpoint, machine.run.endpoint
    receivers = [
        LossyReceiver(soil_end.receive, 7, 2),
        LossyReceiver(machine_end.receive, 11, 3),
    ]
    monkeypatch.setattr(soil_end, "receive", receivers[0])
    monkeypatch.setattr(machine_end, "receive", receivers[1])
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    ros.spin_until(lambda: all(len(receiver.lost) == receiver.max_lost for receiver in receivers))
    scene.more_ticks(20)
    scene.pause()
    assert machine.run is not None
    assert is_balanced(scene)
    assert scene.trigger("/soil/verify").success
    assert len({type(message) for receiver in receivers for message in receiver.lost}) > 1
    counters = scene.soil.diagnostics.report().values
    assert not [key for key in counters if key.startswith("rejected")]


MALFORMED_FOR_SOIL = [
    ("/soil/tool_sweeps", PointCloud2()),
    ("/soil/deposit_requests", PointCloud2(height=1, width=9)),
    ("/excavator/soil_tick", Int64MultiArray()),
    ("/excavator/soil_tick", Int64MultiArray(data=[1, 2, 3])),
    ("/excavator/soil_tick", to_multi_array(Ledger(1, 1, 0, 0, 0, 0, 0, 0, 0))),
]
MALFORMED_FOR_MACHINE = [
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


@pytest.mark.parametrize("receiver", ["soil", "machine"])
def test_malformed_messages_are_counted_and_change_nothing(ros: Ros, receiver: str) -> None:
    scene = Scene(ros)
    machine = scene.machine()
    scene.until_tick(3)
    node = scene.soil if receiver == "soil" else machine
    counts: dict[str, int] = {}
    for topic, message in MALFORMED_FOR_SOIL if receiver == "soil" else MALFORMED_FOR_MACHINE:
        is_transient_local = topic in ("/terrain/map", "/sim/config")
        profile = qos.TRANSIENT_LOCAL if is_transient_local else qos.ROWS
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
    assert is_balanced(scene)
