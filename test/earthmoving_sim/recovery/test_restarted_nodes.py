"""Nodes that end without notice continue their run when they are started again."""

from __future__ import annotations

from pathlib import Path

from support.node_scenes import Scene, dig, machine_file, ready_to_dig

from machine_sim.node.machine_node import MachineNode
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode


class CrashScene(Scene):
    """Nodes with recovery, which are removed without notice, as `kill -9` ends a process."""

    def __init__(self, ros: Ros, folder: Path, **parameters: object) -> None:
        self.folder = folder
        self._recovery = {
            "recovery.path": str(folder / "state"),
            "recovery.checkpoint_period": 0.2,
        }
        super().__init__(ros, **self._recovery, **parameters)
        self.digger: MachineNode = self.start_digger()

    def start_digger(self) -> MachineNode:
        return self.machine(
            machine=machine_file(self.folder, ready_to_dig()),
            **{"commands.command_timeout": 60.0, **self._recovery},
        )

    def restart_soil(self) -> None:
        self.ros.remove(self.soil)
        self.soil = self.ros.add(SoilNode, parameters=self.given)

    def restart_digger(self) -> None:
        self.ros.remove(self.digger)
        self.digger = self.start_digger()


def test_soil_node_continues_its_run(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    run_id, tick = scene.soil.run.endpoint.exchange.run_id, scene.tick
    scene.restart_soil()
    assert scene.soil.run.endpoint.exchange.run_id == run_id
    assert scene.tick >= tick
    scene.more_ticks(100)
    assert scene.ledgers[-1].imbalance == 0
    assert scene.joined == (1,)


def test_machine_node_continues_its_run(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    session_id = scene.digger.run.endpoint.exchange.session_id
    state_hash, tick = scene.digger.run.sim.state_hash(), scene.digger.run.tick
    scene.restart_digger()
    assert scene.digger.run.tick == tick
    assert scene.digger.run.sim.state_hash() == state_hash
    assert scene.digger.run.endpoint.exchange.session_id == session_id
    scene.more_ticks(100)
    assert scene.ledgers[-1].imbalance == 0
    assert scene.ledgers[-1].absent == 0
