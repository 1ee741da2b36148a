"""Runs over topics are recorded, and replayed from their bags: equal to the last bit."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Int64MultiArray, String
from support.node_scenes import dig
from support.replay_scenes import (
    RecordedScene,
    check_identical,
    replay,
)

from earthmoving_sim.cli import main
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.config_files import find_config
from msg_bridge.contract.ledger import Ledger
from msg_bridge.testing.ros_context import Ros

COMMANDS = "/excavator/applied_commands"


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


def test_bag_of_an_older_version_is_rejected_with_the_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["replay", "bags/format_2"]) == 2
    assert "older version" in capsys.readouterr().err
