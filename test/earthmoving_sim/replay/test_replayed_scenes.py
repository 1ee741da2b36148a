"""Runs over topics are recorded, and replayed from their bags: equal to the last bit."""

from __future__ import annotations

import itertools
import json
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Int64MultiArray, String
from support.node_scenes import TICK, Scene, dig, machine_file, ready_to_dig

from earthmoving_sim.cli import main
from earthmoving_sim.replay.recorded.run_survey import survey_runs
from earthmoving_sim.replay.replay_result import ReplayResult
from earthmoving_sim.replay.run_replay import RunReplay
from machine_sim.node.machine_node import MachineNode
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.config_files import find_config
from msg_bridge.contract.ledger import Ledger
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode

COMMAND_TIMEOUT = 60.0
COMMANDS = "/excavator/applied_commands"


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


def record_dig(ros: Ros, folder: Path, **parameters: object) -> Path:
    """Return the bag of a short dig in lockstep; `parameters` are those of the machine node."""
    scene = RecordedScene(ros, folder)
    machine = scene.digger(**parameters)
    dig(scene, machine, lambda ledger: ledger.particles > 10**8)
    scene.leave(machine)
    return scene.finish()


def copy_with_change(
    bag: Path, copy: Path, changed_topic: str, number: int, change: Callable[[Any], None] | None
) -> None:
    """Copy a bag with a change of one message of a topic, counted from 0; None: without it and all
    later ones."""
    reader, writer = BagReader(bag), BagWriter(copy)
    for topic, info in reader.topics.items():
        writer.add_topic(topic, info.type)
    for name in reader.attachment_names:
        writer.attach(name, "application/yaml", reader.read_attachment(name), 0)
    numbers = itertools.count()
    for topic, log_time, data in reader.raw_messages():
        k = next(numbers) if topic == changed_topic else -1
        if change is None and k >= number:
            continue
        if k == number and change is not None:
            message = reader.decode(topic, data)
            change(message)
            data = serialize_message(message)
        writer.write(topic, data, log_time, log_time)
    writer.close()


def first_ledger_after(bag: Path, tick: int) -> int:
    """Return the number of the first ledger after a tick; one may be recorded more than once."""
    messages = BagReader(bag).messages(["/soil/ledger"])
    ledgers = [from_multi_array(message) for _, _, message in messages]
    return next(
        k for k, each in enumerate(ledgers) if isinstance(each, Ledger) and each.tick > tick
    )


def push_boom(message: JointState) -> None:
    message.velocity[message.name.index("boom")] += 0.5


def change_hash(message: String) -> None:
    state = json.loads(message.data)
    message.data = json.dumps({**state, "sha256": 64 * "0"})


def test_dig_in_lockstep_is_identical(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = record_dig(ros, tmp_path)
    check_identical(replay(bag), ["/soil/state_hash", "/excavator/state_hash"])
    (tmp_path / "ready.yaml").unlink()
    assert main(["replay", str(bag)]) == 0, "the machine file is in the bag"
    assert "identical over" in capsys.readouterr().out


def change_map_digest(message: Int64MultiArray) -> None:
    message.data[message.layout.dim[0].label.split(",").index("map_updates.digest")] += 1


def move_between_accounts(message: Int64MultiArray) -> None:
    labels = message.layout.dim[0].label.split(",")
    message.data[labels.index("terrain")] += 5
    message.data[labels.index("in_flight")] -= 5


def lose_volume(message: Int64MultiArray) -> None:
    message.data[message.layout.dim[0].label.split(",").index("terrain")] += 5


def test_first_difference_names_tick_and_what_differs(ros: Ros, tmp_path: Path) -> None:
    bag = record_dig(ros, tmp_path)
    copy_with_change(bag, tmp_path / "command", COMMANDS, 20, push_boom)
    difference = replay(tmp_path / "command")[0].difference
    assert difference is not None
    assert difference.where == "/excavator"
    assert difference.tick > 20
    assert "rows of sweeps" in difference.text
    assert "row 1, tool 0" in difference.text
    copy_with_change(bag, tmp_path / "hash", "/excavator/state_hash", 3, change_hash)
    difference = replay(tmp_path / "hash")[0].difference
    assert difference is not None
    assert difference.where == "/excavator"
    assert "the state hash is 000000000000 recorded" in difference.text
    copy_with_change(bag, tmp_path / "header", "/soil/tick", 20, change_map_digest)
    assert "map_updates" in str(replay(tmp_path / "header")[0].difference)
    copy_with_change(bag, tmp_path / "ledger", "/soil/ledger", 20, move_between_accounts)
    assert "account terrain" in str(replay(tmp_path / "ledger")[0].difference)
    copy_with_change(bag, tmp_path / "damaged", "/soil/ledger", 20, lose_volume)
    (result,) = replay(tmp_path / "damaged")
    assert result.num_missing_ledgers == 1, "it contradicts itself"
    assert not result.is_identical


def test_recorder_that_was_stopped_within_a_tick(ros: Ros, tmp_path: Path) -> None:
    bag = record_dig(ros, tmp_path)
    (complete,) = replay(bag)
    last = complete.last_tick
    copy_with_change(bag, tmp_path / "cut", "/soil/ledger", first_ledger_after(bag, last - 2), None)
    (result,) = replay(tmp_path / "cut")
    assert result.is_identical, str(result.difference) + result.ended_early
    assert result.last_tick == complete.last_tick - 2
    lost = first_ledger_after(bag, last - 30)
    copy_with_change(bag, tmp_path / "lost", "/soil/ledger", lost, None)
    (result,) = replay(tmp_path / "lost")
    assert result.num_missing_ledgers == 30


def test_state_that_cannot_be_restored_exactly_is_not_saved(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = record_dig(ros, tmp_path, **{"stepping.track_model": "dynamic"})
    check_identical(replay(bag), ["/soil/state_hash", "/excavator/state_hash"])
    save = ["--until", "45", "--save", str(tmp_path / "state")]
    assert main(["replay", str(bag), *save]) == 2
    assert "dynamic tracks" in capsys.readouterr().err
    assert not (tmp_path / "state").exists()


def test_saved_state_continues_to_the_last_bit(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, state = record_dig(ros, tmp_path), tmp_path / "state"
    assert main(["replay", str(bag), "--until", "45", "--save", str(state)]) == 0
    assert main(["replay", str(bag), "--from", str(state)]) == 0
    assert "from tick 45 on" in capsys.readouterr().out
    damaged = bytearray(state.read_bytes())
    damaged[-5] ^= 1
    state.write_bytes(damaged)
    assert main(["replay", str(bag), "--from", str(state)]) == 2
    assert "truncated or damaged" in capsys.readouterr().err


def test_branch_with_other_parameters_from_a_saved_state(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, state, branch = record_dig(ros, tmp_path), tmp_path / "state", tmp_path / "branch"
    (complete,) = replay(bag)
    assert main(["replay", str(bag), "--until", "45", "--save", str(state)]) == 0
    from_state = ["replay", str(bag), "--from", str(state)]
    heavy = (
        find_config("machines/excavator.yaml").read_text().replace("mass: 9900.0", "mass: 15000.0")
    )
    (tmp_path / "heavy.yaml").write_text(heavy)
    changes = ['soil.soil:="wet clay"', f"machine:={tmp_path / 'heavy.yaml'}"]
    changes = [word for change in changes for word in ("--what-if", change)]
    assert main([*from_state, *changes, "--record", str(branch)]) == 0
    assert re.search(r"excavated \[m3\] +0\.\d+ +0\.\d+ +[-+]", capsys.readouterr().out)
    assert not audit_bag(branch).runs[0].findings
    ledgers = [
        from_multi_array(message) for _, _, message in BagReader(branch).messages(["/soil/ledger"])
    ]
    assert all(isinstance(ledger, Ledger) and ledger.imbalance == 0 for ledger in ledgers)
    assert len(ledgers) == complete.last_tick + 1 - 46
    for change, reason in (
        ("site.seed:=3", "begin of a run"),
        ("soil.additional_soils:=[gravel]", "not their number"),
        ("stepping.track_model:=dynamic", "track model"),
    ):
        assert main([*from_state, "--what-if", change]) == 2
        assert reason in capsys.readouterr().err


def test_other_soil_with_the_same_commands(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, other = record_dig(ros, tmp_path), tmp_path / "other"
    change = ["--what-if", 'soil.soil:="wet clay"', "--record", str(other)]
    assert main(["replay", str(bag), *change]) == 0
    assert re.search(r"excavated \[m3\] +0\.\d+ +0\.\d+ +[-+]", capsys.readouterr().out)
    assert audit_bag(other).passed
    check_identical(replay(other), ["/soil/state_hash", "/excavator/state_hash"])
    assert main(["replay", str(bag), "--what-if", "soil.sol:=loam"]) == 2
    assert "did you mean 'soil.soil'" in capsys.readouterr().err
    assert main(["replay", str(bag), "--what-if", "soil.swell:=9"]) == 2
    assert "soil.swell is 9;" in capsys.readouterr().err


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
    bag = scene.finish()
    check_identical(replay(bag), ["/soil/state_hash", "/excavator/state_hash", "/late/state_hash"])
    change = ["--what-if", "soil.swell:=3e-1", "--record", str(tmp_path / "other")]
    assert main(["replay", str(bag), *change]) == 0
    assert audit_bag(tmp_path / "other").passed
    check_identical(replay(tmp_path / "other"), ["/soil/state_hash", "/late/state_hash"])


def test_restarted_machine_that_missed_headers_of_a_soil_that_does_not_wait(
    ros: Ros, tmp_path: Path
) -> None:
    """One header answers both ticks in flight, as those between them are not sent again."""
    waits = {"sync": "realtime", "overload": "skip_ticks", "machine_timeout": 60.0}
    scene = RecordedScene(ros, tmp_path, **waits)
    parameters = {"recovery.path": str(tmp_path / "state")}
    machine = scene.digger(**parameters)
    swing(scene, machine)
    scene.more_ticks(20)
    ros.remove(machine)  # as if it had been killed
    scene.more_ticks(20)
    machine = scene.digger(**parameters)
    scene.more_ticks(200)
    check_identical(replay(scene.finish()), ["/soil/state_hash", "/excavator/state_hash"])


def test_replay_ends_where_a_machine_continued_from_a_checkpoint(
    ros: Ros, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bodies of dynamic tracks touch, and their state, which is not exact, is not in the bag."""
    scene = RecordedScene(ros, tmp_path, machine_timeout=0.5)
    parameters = {
        "stepping.track_model": "dynamic",
        "recovery.path": str(tmp_path / "state"),
        "recovery.checkpoint_period": 0.2,
    }
    machine = scene.digger(**parameters)
    swing(scene, machine)
    scene.more_ticks(100)
    killed_at = machine.run.tick
    ros.remove(machine)
    machine = scene.digger(**parameters)
    answered = machine.run.endpoint.exchange.tick
    assert machine.run.tick < killed_at, "the ticks after the last state are skipped"
    ros.spin_until(lambda: 1 not in scene.joined, what="the earlier session to end")
    ros.spin_until(lambda: 1 in scene.joined, what="the machine to rejoin")
    scene.more_ticks(20)
    bag = scene.finish()
    assert audit_bag(bag).passed
    (result,) = replay(bag)
    assert result.difference is None, str(result.difference)
    assert "/excavator was restarted" in result.ended_early
    assert f"answers up to tick {answered} instead of" in result.ended_early
    assert not result.is_identical
    assert result.last_tick >= killed_at - 1
    assert main(["replay", str(bag)]) == 1
    output = capsys.readouterr().out
    assert f"replayed up to tick {result.last_tick} without a difference" in output
    assert "identical" not in output


def test_reset_begins_another_run(ros: Ros, tmp_path: Path) -> None:
    scene = RecordedScene(ros, tmp_path)
    machine = scene.digger()
    swing(scene, machine)
    scene.until_tick(40)
    assert scene.trigger("/sim/reset").success
    scene.ros.spin_until(lambda: 1 in scene.joined, what="the machine to join again")
    scene.until_tick(40)
    second = scene.soil.run.endpoint.exchange.run_id
    bag, state = scene.finish(), str(tmp_path / "state")
    results = replay(bag)
    assert len(results) == 2
    check_identical(results, ["/soil/state_hash", "/excavator/state_hash"])
    of_second = ["replay", str(bag), "--run", str(second)]
    assert main([*of_second, "--until", "20", "--save", state]) == 0
    assert main([*of_second, "--from", state]) == 0


def test_restarted_soil_begins_another_run_with_another_tick_period(
    ros: Ros, tmp_path: Path
) -> None:
    scene = RecordedScene(ros, tmp_path)
    machine = scene.digger()
    swing(scene, machine)
    scene.until_tick(40)
    first = scene.soil.run.endpoint.exchange.run_id
    ros.remove(scene.soil)
    ros.spin_until(lambda: time.time() >= first + 1, what="another run id, which is the time")
    scene.soil = ros.add(SoilNode, parameters={**scene.given, "tick_period": 2 * TICK})
    run = scene.soil.run.endpoint.exchange
    ros.spin_until(lambda: run.tick >= 40, what="the ticks of the other run")
    check_identical(replay(scene.finish()), ["/soil/state_hash", "/excavator/state_hash"])


def test_bag_of_an_older_version_is_rejected_with_the_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["replay", "bags/format_2"]) == 2
    assert "older version" in capsys.readouterr().err
