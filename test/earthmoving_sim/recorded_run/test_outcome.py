"""The outcome of a bag equals the outcome of the run that it recorded."""

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.recorded_dig import CYCLES, PHASE, TICK, small_site, write
from support.recorded_exchange import terrain_cloud
from support.recorded_messages import Recording

from dig_operator import CycleReport
from dig_operator.node import DigOperatorNode
from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.recorded_run.outcome import outcome_from_bag
from earthmoving_sim.report import print_summary
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import (
    COMMAND_DELAY_TICKS,
    COMMAND_INTERVAL_TICKS,
    SingleProcessDig,
)
from machine_sim.node.machine_node import MachineNode
from msg_bridge.bag.reader import BagReadError
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.recorder.recorder_node import RecorderNode
from soil_sim.node.soil_node import SoilNode
from soil_sim.terrain import save_terrain

REPORTS = [CycleReport(1, 2, 1.15, 0.98, 0.9, 0.01, 18.5, 0.8), CycleReport(2, 1, *[0.5] * 6)]


def assert_same(recorded: DigOutcome, own: DigOutcome) -> None:
    """Compare all that a bag contains exactly, or to float32."""
    assert recorded.grid == own.grid
    for name in ("after", "loose_depth"):
        np.testing.assert_allclose(
            getattr(recorded, name), getattr(own, name), rtol=1e-6, atol=1e-7
        )
    # Columns have whole numbers of mm3; heights are those of the site to that precision.
    np.testing.assert_allclose(recorded.site.heights, own.site.heights, rtol=1e-6, atol=1e-6)
    assert replace(recorded.ledger, run_id=own.ledger.run_id) == own.ledger
    for name in ("cycles", "max_imbalance", "moved_volume", "tunnelled", "abort_reason"):
        assert getattr(recorded, name) == getattr(own, name), name
    assert recorded.simulated_time == pytest.approx(own.simulated_time, rel=1e-12)
    np.testing.assert_allclose(recorded.lip_path, own.lip_path, atol=1e-5)
    assert recorded.lip_cycle.tolist() == own.lip_cycle.tolist()
    assert recorded.lip_phase.tolist() == own.lip_phase.tolist()
    assert recorded.machine_position == pytest.approx(own.machine_position, abs=1e-9)
    np.testing.assert_allclose(recorded.machine_mesh.points, own.machine_mesh.points, atol=1e-5)
    assert [name for name, _ in recorded.machine_outline] == [n for n, _ in own.machine_outline]
    for (_, actual), (_, expected) in zip(
        recorded.machine_outline, own.machine_outline, strict=True
    ):
        np.testing.assert_allclose(actual, expected, atol=1e-5)


# A complete bag


def test_outcome_of_bag_equals_that_of_the_run(dig, recorded) -> None:
    assert_same(recorded, dig.outcome)
    assert (recorded.loose_depth > 0.0).any()
    assert set(recorded.lip_phase) >= {"brace", "reach", "dig", "settle"}


def test_max_particles_is_the_largest_published_number(dig, recorded) -> None:
    assert 0 < recorded.max_particles == dig.max_published_particles <= dig.outcome.max_particles


def test_state_hash_is_the_newest_with_its_tick(dig, recorded) -> None:
    ticks = round(dig.outcome.simulated_time / TICK)
    assert recorded.state_tick == ticks // 100 * 100
    hashes = [m for t, _, m in dig.recording.messages if t == "/soil/state_hash"]
    newest = from_state_hash_string(hashes[-1])
    assert (newest.tick, newest.sha256) == (recorded.state_tick, recorded.state_hash)


def test_wall_time_is_the_log_time_from_first_to_last_tick(dig, recorded) -> None:
    times = [time for topic, time, _ in dig.recording.messages if topic == "/soil/tick"]
    assert recorded.wall_time == pytest.approx((times[-1] - times[0]) / 1e9)


def test_summary_has_run_mode_and_tick_of_the_state(dig, recorded, capsys) -> None:
    print_summary(recorded, "loam")
    summary = capsys.readouterr().out
    assert "x real time, nodes machine_sim" in summary
    assert f"{recorded.state_hash} after tick {recorded.state_tick}" in summary
    print_summary(dig.outcome, "loam")
    assert "x real time, one process" in capsys.readouterr().out


def test_progress_is_printed(dig, tmp_path, capsys) -> None:
    bag = write(tmp_path / "bag", dig.recording)
    outcome_from_bag(bag, progress=True)
    assert str(bag) in capsys.readouterr().out


def test_cycles_are_those_the_operator_published(dig, outcome) -> None:
    recording = dig.recording.copy()
    for report in REPORTS:
        recording.add(CYCLES, String(data=json.dumps(asdict(report))))
    result = outcome(recording)
    assert result.cycles == REPORTS
    assert result.moved_volume == pytest.approx(1.3)


def test_duplicate_messages_change_nothing(dig, recorded, outcome) -> None:
    repeated = dig.recording.copy()
    repeated.messages = [each for each in repeated.messages for _ in range(2)]
    assert_same(outcome(repeated), recorded)


def test_order_of_messages_between_topics_changes_nothing(dig, recorded, outcome) -> None:
    delays = np.random.default_rng(0).integers(0, 20, len(dig.recording.messages))
    delayed = [
        (topic, time + 1000 * int(delay), message)
        for (topic, time, message), delay in zip(dig.recording.messages, delays, strict=True)
    ]
    own = [i for i, (topic, _, _) in enumerate(delayed) if topic == PHASE]  # of one publisher
    for index in own:
        delayed[index] = dig.recording.messages[index]
    assert_same(outcome(Recording(delayed)), recorded)


def test_retransmitted_rows_fill_a_gap(dig, recorded, outcome) -> None:
    recording = dig.recording.copy()
    number = next(
        i for i, (topic, _, _) in enumerate(recording.messages) if topic == "/terrain/map_updates"
    )
    topic, _, rows = recording.messages.pop(number)
    recording.add(topic, rows)
    assert_same(outcome(recording), recorded)


def test_without_markers_only_the_shoes_are_missing(dig, recorded, outcome) -> None:
    result = outcome(dig.recording.without("/excavator/markers"))
    shoes = recorded.machine_mesh.parts.max() - result.machine_mesh.parts.max()
    assert shoes == 2 * dig.run.config.machine.tracks.shoe_count
    np.testing.assert_array_equal(
        result.machine_mesh.points, recorded.machine_mesh.points[: len(result.machine_mesh.points)]
    )


# Where a run begins and ends


def test_ticks_after_the_operator_finished_only_count_for_the_imbalance(
    dig, recorded, outcome
) -> None:
    recording = dig.recording.copy()
    header = next(
        from_multi_array(m) for t, _, m in reversed(recording.messages) if t == "/soil/tick"
    )
    for tick in (header.tick + 1, header.tick + 2):
        recording.add("/soil/tick", to_multi_array(replace(header, tick=tick)))
        ledger = replace(recorded.ledger, tick=tick, terrain=recorded.ledger.terrain - 7)
        recording.add("/soil/ledger", to_multi_array(ledger))
    result = outcome(recording)
    assert result.max_imbalance == -7
    assert_same(replace(result, max_imbalance=0), recorded)


def test_operator_without_a_recorded_end_did_not_finish(dig, outcome) -> None:
    recording = dig.recording.copy()
    end = max(i for i, (topic, _, _) in enumerate(recording.messages) if topic == PHASE)
    before = max(i for i, (t, _, _) in enumerate(recording.messages[:end]) if t == PHASE)
    del recording.messages[end]
    del recording.messages[before]  # the one with the abort reason
    result = outcome(recording)
    assert result.abort_reason == "the operator did not finish"
    assert not result.is_successful
    assert result.simulated_time == dig.outcome.simulated_time


def test_truncated_recording_has_the_outcome_up_to_its_end(dig, recorded, outcome) -> None:
    recording = dig.recording.copy()
    recording.messages.insert(5, recording.messages[-1])  # nodes publish diagnostics throughout
    half = next(i for i, (t, _, m) in enumerate(recording.messages) if _is_ledger(t, m, 500))
    result = outcome(Recording(recording.messages[:half]), finish=False)
    assert result.abort_reason == "the operator did not finish"
    assert 100 <= result.ledger.tick < 500
    assert len(result.lip_path) == result.ledger.tick // 10
    np.testing.assert_array_equal(result.lip_path, recorded.lip_path[: len(result.lip_path)])


def test_outcome_is_that_of_the_last_run(dig, recorded, outcome) -> None:
    recording = dig.recording.copy()
    config, odometry = (
        next(m for t, _, m in recording.messages if t == topic)
        for topic in ("/sim/config", "/excavator/odom")
    )
    older = Recording()
    old = to_config_yaml(RunFacts(0, TICK, False, 0.2, (LooseSoil(0.15),)), {})
    older.add("/sim/config", String(data=old))
    older.add("/terrain/map", terrain_cloud(dig.run.world.soil, 0, 0))
    for tick in range(3):
        header = from_multi_array(next(m for t, _, m in recording.messages if t == "/soil/tick"))
        older.add("/soil/tick", to_multi_array(replace(header, run_id=0, tick=tick)))
        ledger = replace(recorded.ledger, run_id=0, tick=tick, terrain=0)
        older.add("/soil/ledger", to_multi_array(ledger))
        older.add("/excavator/odom", odometry)
        for name in ("phase", "cycles"):
            phase = {"time": 0.0, "cycle": 9, "phase": "done", "abort_reason": "aborted"}
            text = json.dumps(phase if name == "phase" else asdict(REPORTS[0]))
            older.add(f"/excavator/operator/{name}", String(data=text))
    assert config.data != old
    later = [(topic, time + 10**6, message) for topic, time, message in recording.messages]
    assert_same(outcome(Recording(older.messages + later)), recorded)


def test_another_machine_in_the_bag_changes_nothing(dig, recorded, outcome) -> None:
    recording = dig.recording.copy()
    facts = RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),))
    config = {"machine_sim": {"machine": "machines/dumper.yaml"}}
    recording.add("/truck/config", String(data=to_config_yaml(facts, config)))
    recording.add("/truck/joint_states", JointState(name=["bed"], position=[0.0]))
    recording.add("/truck/applied_commands", JointState(name=["bed"], velocity=[0.0]))
    values = [KeyValue(key="tunnelled", value="77")]
    status = DiagnosticStatus(name="truck/machine_sim: machine_sim", values=values)
    recording.add("/diagnostics", DiagnosticArray(status=[status]))
    assert_same(outcome(recording), recorded)


def test_machine_of_a_node_with_several_has_the_same_outcome(dig, recorded, outcome) -> None:
    recording = Recording()
    facts = RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),))
    digger = {"machine": "machines/excavator.yaml", "command_delay": COMMAND_DELAY_TICKS}
    machines = {"truck": {"machine": "machines/dumper.yaml"}, "excavator": digger}
    config = String(data=to_config_yaml(facts, {"machine_sim": {}, "machines": machines}))
    for topic, time, message in dig.recording.messages:
        of_node = topic in ("/excavator/config", "/excavator/particles")
        here = f"/site{topic}" if topic.startswith("/excavator/") else topic
        here = topic.replace("/excavator", "/site") if of_node else here
        if here == "/diagnostics":
            status = DiagnosticStatus(name="site/machine_sim", values=message.status[0].values)
            message = DiagnosticArray(status=[status])
        here_message = config if here == "/site/config" else message
        recording.messages.append((here, time, here_message))
    cycles = "/site/excavator/operator/cycles"
    assert_same(outcome(recording, cycles=cycles), recorded)


def in_namespace(recording: Recording, namespace: str) -> Recording:
    """Return a recording of the same run in a namespace."""
    moved = Recording()
    for topic, time, message in recording.messages:
        if topic == "/diagnostics":
            status = [
                DiagnosticStatus(name=f"{namespace[1:]}/{each.name}", values=each.values)
                for each in message.status
            ]
            message = DiagnosticArray(status=status)
        moved.messages.append((f"{namespace}{topic}", time, message))
    return moved


def test_only_simulation_of_a_bag_may_be_in_any_namespace(dig, recorded, outcome) -> None:
    recording = in_namespace(dig.recording, "/site_a")
    cycles = "/site_a/excavator/operator/cycles"
    assert_same(outcome(recording, cycles=cycles), recorded)


@pytest.mark.parametrize("namespace", ["/", "/site_a"])
def test_one_of_several_simulations_is_read_by_its_namespace(
    dig, recorded, tmp_path, namespace
) -> None:
    both = Recording(dig.recording.messages + in_namespace(dig.recording, "/site_a").messages)
    bag = write(tmp_path / "bag", both, cycles=namespace.rstrip("/") + CYCLES)
    assert_same(outcome_from_bag(bag, namespace=namespace), recorded)
    with pytest.raises(BagReadError, match="namespaces /, /site_a;"):
        outcome_from_bag(bag)


# Nodes


def test_recording_of_nodes_has_the_outcome_of_one_process(ros, tmp_path) -> None:
    site = small_site()
    save_terrain(tmp_path / "site.npz", site)
    config = load_run_config("demo.yaml", {"approach_distance": 0.0, "start_x": 0.0})
    config = replace(config, task=replace(config.task, timeout=1.0))
    recorder = ros.add(RecorderNode, parameters={"path": str(tmp_path / "bag"), "progress": False})
    diagnostics = ros.collect("/diagnostics", DiagnosticArray)
    hashes = ros.collect("/soil/state_hash", String)
    soil = {f"soil.{name}": value for name, value in asdict(config.soil).items()}
    ros.add(
        SoilNode,
        parameters={
            "sync": "lockstep",
            "required_subscribers": ["exchange_recorder"],
            "site.terrain": str(tmp_path / "site.npz"),
            **soil,
        },
    )
    operator = ros.add(
        DigOperatorNode,
        parameters={
            **{f"behaviour.{name}": each for name, each in asdict(config.behaviour).items()},
            **{f"task.{name}": each for name, each in asdict(config.task).items()},
        },
    )
    ros.add(
        MachineNode,
        parameters={
            "command_wait_period": COMMAND_INTERVAL_TICKS,
            "command_delay": COMMAND_DELAY_TICKS,
            "required_subscribers": ["exchange_recorder"],
            **{f"particles.{name}": each for name, each in asdict(config.particles).items()},
        },
    )
    ros.spin_until(lambda: operator.finished)
    # A hash is published twice once time stands still; the last commands have taken effect then.
    ros.spin_until(lambda: len(hashes) > 1 and hashes[-1].data == hashes[-2].data)
    ros.spin_until(lambda: any("machine_sim" in s.name for m in diagnostics for s in m.status))
    operator.stop()
    recorder.stop()
    recorded = outcome_from_bag(tmp_path / "bag")

    run = SingleProcessDig(config, site)
    try:
        own = run.run()
    finally:
        run.close()
    assert own.abort_reason
    assert_same(recorded, own)
    assert recorded.state_hash == own.state_hash  # of ground that nothing has touched
    assert 100 <= recorded.state_tick <= recorded.ledger.tick
    assert recorded.run_mode == "nodes dig_operator, machine_sim, exchange_recorder, soil_sim"


def _is_ledger(topic: str, message: Any, tick: int) -> bool:
    return topic == "/soil/ledger" and from_multi_array(message).tick == tick
