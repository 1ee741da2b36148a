"""Runs over topics are recorded, and replayed from their bags: equal to the last bit."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from support.node_scenes import Scene, dig, machine_file, ready_to_dig

from earthmoving_sim.replay.run_replay import ReplayResult, RunReplay
from earthmoving_sim.replay.run_survey import survey_runs
from machine_sim.node.machine_node import MachineNode
from msg_bridge.bag.reader import BagReader
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros

COMMAND_TIMEOUT = 60.0


class RecordedScene(Scene):
    """A scene of nodes that is recorded from its begin."""

    def __init__(self, ros: Ros, folder: Path, **parameters: object) -> None:
        self.bag, self._folder = folder / "bag", folder
        self._recorder = ros.add(
            RecorderNode, parameters={"path": str(self.bag), "progress": False}
        )
        required = {"required_subscribers": ["exchange_recorder"]}
        super().__init__(ros, hash_rate=20.0, **required, **parameters)

    def digger(self, namespace: str = "/excavator", **parameters: object) -> MachineNode:
        """Start an excavator that is ready to dig, and let it join."""
        node = self.machine(
            namespace,
            machine=machine_file(self._folder, ready_to_dig()),
            hash_rate=20.0,
            **{"commands.command_timeout": COMMAND_TIMEOUT, "required_subscribers": ["exchange_recorder"]},
            **parameters,
        )
        machine_id = int(parameters.get("machine_id", 1))
        self.ros.spin_until(lambda: machine_id in self.joined, what=f"machine {machine_id} to join")
        return node

    def finish(self) -> Path:
        """End the recording and return the bag."""
        self.until_tick(self.tick)
        self._recorder.stop()
        return self.bag


def replay(bag: Path) -> list[ReplayResult]:
    """Return the result of the replay of each run of a bag."""
    reader = BagReader(bag)
    results = []
    for survey in survey_runs(reader):
        run = RunReplay(reader, survey)
        results.append(run.run())
        run.close()
    return results


def swing(scene: Scene, node: MachineNode) -> None:
    topic = f"{node.get_namespace()}/joint_commands"
    publisher = scene.ros.publisher(topic, JointState, subscriptions=1)
    publisher.publish(JointState(name=["swing"], velocity=[0.4]))


def check_identical(results: Sequence[ReplayResult], topics: Sequence[str]) -> None:
    for result in results:
        assert result.difference is None, str(result.difference)
        assert not result.ended_early
        for topic in topics:
            assert result.num_hashes[topic] > 5


def test_dig_in_lockstep_is_identical(ros: Ros, tmp_path: Path) -> None:
    scene = RecordedScene(ros, tmp_path)
    machine = scene.digger()
    dig(scene, machine, lambda ledger: ledger.particles > 10**8)
    scene.leave(machine)
    (result,) = replay(scene.finish())
    check_identical([result], ["/soil/state_hash", "/excavator/state_hash"])
    assert result.last_tick >= scene.ledgers[-1].tick - 1


def test_machines_that_come_and_go_in_real_time(ros: Ros, tmp_path: Path) -> None:
    scene = RecordedScene(
        ros,
        tmp_path,
        sync="realtime",
        overload="skip_ticks",
        machine_timeout=0.5,
        admit_other_machines=True,
    )
    first = scene.digger()
    dig(scene, first, lambda ledger: ledger.particles > 10**7)
    second = scene.digger("/late", machine_id=2, y=6.0)
    scene.more_ticks(20)
    swing(scene, second)
    scene.soil.run.endpoint.exchange.drop(1)  # as if it had been silent: it rejoins with its soil
    scene.ros.spin_until(lambda: 1 not in scene.joined, what="the drop")
    scene.ros.spin_until(lambda: 1 in scene.joined, what="the machine to rejoin")
    scene.more_ticks(20)
    scene.ros.remove(first)  # as if it had been killed
    scene.ros.spin_until(lambda: 1 not in scene.joined, what="the silent machine to be dropped")
    assert scene.trigger("/soil/release").success
    first = scene.digger()
    scene.more_ticks(20)
    scene.leave(second)
    scene.more_ticks(10)
    results = replay(scene.finish())
    check_identical(results, ["/soil/state_hash", "/excavator/state_hash", "/late/state_hash"])


def test_reset_begins_another_run(ros: Ros, tmp_path: Path) -> None:
    scene = RecordedScene(ros, tmp_path)
    machine = scene.digger()
    swing(scene, machine)
    scene.until_tick(40)
    assert scene.trigger("/sim/reset").success
    scene.ros.spin_until(lambda: 1 in scene.joined, what="the machine to join again")
    scene.until_tick(40)
    results = replay(scene.finish())
    assert len(results) == 2
    check_identical(results, ["/soil/state_hash", "/excavator/state_hash"])
