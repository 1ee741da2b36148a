"""Replay of runs in which nodes come, go, are restarted or reset: equal to the last bit."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support.node_scenes import TICK, dig
from support.replay_scenes import RecordedScene, check_identical, replay, swing

from earthmoving_sim.cli import main
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode


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
