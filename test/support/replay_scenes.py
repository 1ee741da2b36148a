"""Scenes of nodes that are recorded from their begin, and replayed from their bags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sensor_msgs.msg import JointState

from earthmoving_sim.replay.recorded.run_survey import survey_runs
from earthmoving_sim.replay.replay_result import ReplayResult
from earthmoving_sim.replay.run_replay import RunReplay
from machine_sim.node.machine_node import MachineNode
from msg_bridge.bag.reader import BagReader
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros
from support.node_scenes import Scene, machine_file, ready_to_dig

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
            **{
                "commands.command_timeout": COMMAND_TIMEOUT,
                "required_subscribers": ["exchange_recorder"],
            },
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
