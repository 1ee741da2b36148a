"""A relay that loses, doubles and reorders messages over DDS changes no state of a run."""

from __future__ import annotations

from pathlib import Path

import pytest
from chaos.lossy_relay import LossyRelay
from std_msgs.msg import String
from support.node_scenes import Scene, machine_file, ready_to_dig
from support.scripted_digger import ScriptedDigger

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.testing.ros_context import Ros

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

NUM_TICKS = 250
TIMEOUT = 300.0  # s of wall time
TOPICS = ("/soil/state_hash", "/excavator/state_hash")


def run_dig(ros: Ros, folder: Path, *remappings: str) -> dict[str, dict[int, str]]:
    """Return state hashes by topic and tick of a dig whose commands depend on the tick only."""
    messages = {topic: ros.collect(topic, String) for topic in TOPICS}
    scene = Scene(ros, hash_rate=10.0)
    rules = [word for rule in remappings for word in ("-r", rule)]
    machine = ros.add(
        MachineNode,
        namespace="/excavator",
        cli_args=["--ros-args", *rules] if rules else None,
        parameters={
            "machine": machine_file(folder, ready_to_dig()),
            "command_wait_period": 1,
            "state_rate": 100.0,
            "hash_rate": 10.0,
        },
    )
    ScriptedDigger(ros)
    ros.spin_until(lambda: scene.tick >= NUM_TICKS, TIMEOUT, f"tick {NUM_TICKS}")
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.ledgers[-1].particles > 0
    ros.remove(machine)
    ros.remove(scene.soil)
    hashes = {topic: map(from_state_hash_string, each) for topic, each in messages.items()}
    return {topic: {s.tick: s.sha256 for s in each} for topic, each in hashes.items()}


def test_lossy_relay_changes_no_state(ros: Ros, tmp_path: Path) -> None:
    direct = run_dig(ros, tmp_path)
    ros.remove(ros.helper)  # with its subscriptions
    relay = ros.add(LossyRelay, seed=0, drop=0.1, double=0.1, delay=0.1)
    relayed = run_dig(ros, tmp_path, *LossyRelay.remappings)
    assert relay.fates["dropped"] > 100
    assert relay.fates["doubled"] > 100
    for topic in TOPICS:
        ticks = direct[topic].keys() & relayed[topic].keys()
        assert len(ticks) > NUM_TICKS / 20
        assert [t for t in sorted(ticks) if direct[topic][t] != relayed[topic][t]] == []
