"""`kill -9` of the soil node, a machine node or both, at random moments, and their restart.

The run continues: in each tick, soil and machines are in the same state as in a run in which no
process was killed, the ledger balances, and the bag of the recorder passes audit and replay.

KILL_ROUNDS is the number of kills, see `make test-kill`.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from std_msgs.msg import Int64MultiArray, String
from support.node_scenes import SITE, TICK, machine_file, ready_to_dig
from support.scripted_digger import ScriptedDigger

from earthmoving_sim.cli import main
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_process import RosProcess

ROUNDS = int(os.environ.get("KILL_ROUNDS", "20"))
ROUNDS_PER_RUN = 10

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

MAX_TICKS_BETWEEN_KILLS = 250
TIMEOUT = 60.0  # s of wall time for a number of ticks

PROGRAMS = Path(sys.executable).parent
NODES = ("soil_sim", "machine_sim")


class Run:
    """The nodes of a run as processes, and what they publish.

    Attributes:
        hashes: state hash by topic and tick.
        ledgers: received ledgers.
    """

    def __init__(
        self, ros: Ros, start: StartProcess, folder: Path, *, delay: int, record: bool
    ) -> None:
        folder.mkdir()
        self._delay = delay  # ticks from a state until its command takes effect
        self._ros, self._start, self._folder = ros, start, folder
        self._processes: dict[str, RosProcess] = {}
        self._last_tick = -1
        self.hashes: dict[str, dict[int, str]] = {}
        self.ledgers: list[Ledger] = []
        self.bag = folder / "bag"
        for topic in ("/soil/state_hash", "/excavator/state_hash"):
            self._collect_hashes(topic)
        ros.helper.create_subscription(Int64MultiArray, "/soil/ledger", self._on_ledger, 100)
        self._required = ["exchange_recorder"] if record else []
        if record:
            self._recorder = start(
                [PROGRAMS / "exchange_recorder"],
                parameters={"path": str(self.bag), "progress": False},
            )
        for name in NODES:
            self.start(name)

    def _collect_hashes(self, topic: str) -> None:
        hashes = self.hashes.setdefault(topic, {})

        def take(message: String) -> None:
            state = from_state_hash_string(message)
            before = hashes.setdefault(state.tick, state.sha256)
            assert state.sha256 == before, f"{topic} has two states of tick {state.tick}"

        self._ros.helper.create_subscription(String, topic, take, 100)

    def _on_ledger(self, message: Int64MultiArray) -> None:
        ledger = from_multi_array(message)
        assert isinstance(ledger, Ledger)
        assert ledger.imbalance == 0
        self._last_tick = ledger.tick
        self.ledgers.append(ledger)

    def start(self, name: str) -> None:
        """Start a node with the parameters of the run."""
        parameters: dict[str, Any] = {
            "recovery.path": str(self._folder / "state"),
            "recovery.checkpoint_period": 0.3,
            "required_subscribers": self._required,
            "hash_rate": 10.0,
        }
        if name == "soil_sim":
            parameters |= {"sync": "lockstep", "tick_period": TICK, **SITE}
        else:
            machine = machine_file(self._folder, ready_to_dig())
            parameters |= {"machine": machine, "state_rate": 100.0}
            parameters |= {"command_wait_period": 1, "command_delay": self._delay}
        namespace = "" if name == "soil_sim" else "/excavator"
        self._processes[name] = self._start(
            [PROGRAMS / name], parameters=parameters, namespace=namespace
        )

    def kill_and_restart(self, names: Sequence[str]) -> None:
        """End nodes with `kill -9`, and start them again."""
        for name in names:
            self._processes[name].kill()
        for name in names:
            self.start(name)
        for name in names:
            self._processes[name].wait_for_output("is continued after a crash")

    def until_tick(self, tick: int) -> None:
        self._ros.spin_until(lambda: self._last_tick >= tick, TIMEOUT, f"tick {tick}")

    def stop(self) -> None:
        for process in self._processes.values():
            process.stop(expect=None)
        if self._required:
            self._recorder.stop()

    @property
    def tick(self) -> int:
        return self._last_tick


@pytest.mark.parametrize("seed", range(-(-ROUNDS // ROUNDS_PER_RUN)))
def test_killed_nodes_continue_their_run(
    ros: Ros, ros_process: StartProcess, tmp_path: Path, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    delay = (0, 2)[seed % 2]
    run = Run(ros, ros_process, tmp_path / "killed", delay=delay, record=True)
    ScriptedDigger(ros)
    run.until_tick(1)
    for _ in range(min(ROUNDS_PER_RUN, ROUNDS)):
        run.until_tick(run.tick + int(rng.integers(1, MAX_TICKS_BETWEEN_KILLS)))
        ros.spin_for(rng.uniform(0.0, 0.01))
        run.kill_and_restart([NODES[:1], NODES[1:], NODES][rng.choice(3, p=[0.4, 0.4, 0.2])])
    run.until_tick(run.tick + 50)
    num_ticks = run.tick
    run.stop()
    assert {ledger.run_id for ledger in run.ledgers} == {run.ledgers[0].run_id}
    assert {ledger.start for ledger in run.ledgers} == {run.ledgers[0].start}
    assert {ledger.absent for ledger in run.ledgers} == {0}
    assert main(["audit", str(run.bag)]) == 0
    assert main(["replay", str(run.bag)]) == 0
    shutil.rmtree(run.bag)

    other = Run(ros, ros_process, tmp_path / "unkilled", delay=delay, record=False)
    other.until_tick(num_ticks)
    other.stop()
    for topic, hashes in run.hashes.items():
        ticks = hashes.keys() & other.hashes[topic].keys()
        assert len(ticks) > 0.05 * num_ticks
        assert [t for t in sorted(ticks) if hashes[t] != other.hashes[topic][t]] == []
