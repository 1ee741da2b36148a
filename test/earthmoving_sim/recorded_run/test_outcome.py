"""What a bag tells of a run is what the run tells of itself."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.recorded_dig import CYCLES, PHASE, TICK, RecordedDig, small_site, write
from support.recorded_exchange import terrain_cloud
from support.recorded_messages import Recording

from dig_operator import CycleReport
from dig_operator.node import DigOperatorNode
from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.recorded_run.outcome import outcome_from_bag
from earthmoving_sim.recorded_run.topic_decoders import RecordedRunError
from earthmoving_sim.report import print_summary
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import (
    COMMAND_DELAY_TICKS,
    COMMAND_INTERVAL_TICKS,
    SingleProcessDig,
)
from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.recorder.recorder_node import RecorderNode
from soil_sim.node.soil_node import SoilNode
from soil_sim.terrain import save_terrain

REPORTS = [CycleReport(1, 2, 1.15, 0.98, 0.9, 0.01, 18.5, 0.8), CycleReport(2, 1, *[0.5] * 6)]


@pytest.fixture(scope="module")
def dig() -> Iterator[RecordedDig]:
    """A run that is given up in its first drag."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        made = RecordedDig(monkeypatch, small_site(), approach=0.0, start_x=-2.0, timeout=6.0)
    yield made
    made.run.close()


@pytest.fixture(scope="module")
def told(dig, tmp_path_factory) -> DigOutcome:
    return outcome_from_bag(write(tmp_path_factory.mktemp("bags") / "dig", dig.recording))


@pytest.fixture
def outcome(tmp_path) -> Callable[..., DigOutcome]:
    """What the bag of a recording tells."""
    return lambda recording, **how: outcome_from_bag(write(tmp_path / "bag", recording, **how))


def assert_same(told: DigOutcome, own: DigOutcome) -> None:
    """All that a bag tells exactly, or to float32."""
    assert told.grid == own.grid
    for name in ("after", "loose_depth"):
        np.testing.assert_allclose(getattr(told, name), getattr(own, name), rtol=1e-6, atol=1e-7)
    # A column is a whole number of mm3; its height is the site's to that precision.
    np.testing.assert_allclose(told.site.heights, own.site.heights, rtol=1e-6, atol=1e-6)
    for name in ("cycles", "ledger", "max_imbalance", "moved_volume", "tunnelled", "abort_reason"):
        assert getattr(told, name) == getattr(own, name), name
    assert told.simulated_time == pytest.approx(own.simulated_time, rel=1e-12)
    np.testing.assert_allclose(told.lip_path, own.lip_path, atol=1e-5)
    assert told.lip_cycle.tolist() == own.lip_cycle.tolist()
    assert told.lip_phase.tolist() == own.lip_phase.tolist()
    assert told.machine_position == pytest.approx(own.machine_position, abs=1e-9)
    for name in ("machine_faces", "machine_outline"):
        assert [n for n, _ in getattr(told, name)] == [n for n, _ in getattr(own, name)]
        for (_, found), (_, wanted) in zip(getattr(told, name), getattr(own, name), strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-5)


# A whole bag


def test_bag_tells_what_the_run_itself_does(dig, told) -> None:
    assert_same(told, dig.outcome)
    assert (told.loose_depth > 0.0).any()
    assert set(told.lip_phase) >= {"brace", "reach", "dig", "settle"}


def test_particles_are_the_most_that_were_published(dig, told) -> None:
    assert 0 < told.max_particles == dig.max_published_particles <= dig.outcome.max_particles


def test_state_is_that_of_the_newest_hash_and_says_of_which_tick(dig, told) -> None:
    ticks = round(dig.outcome.simulated_time / TICK)
    assert told.state_tick == ticks // 100 * 100
    said = [m.data for t, _, m in dig.recording.messages if t == "/soil/state_hash"]
    assert said[-1] == f"{told.state_tick} {told.state_hash}"


def test_wall_time_is_the_log_time_from_first_to_last_tick(dig, told) -> None:
    times = [time for topic, time, _ in dig.recording.messages if topic == "/soil/tick"]
    assert told.wall_time == pytest.approx((times[-1] - times[0]) / 1e9)


def test_summary_says_what_ran_and_of_which_tick_the_state_is(dig, told, capsys) -> None:
    print_summary(told)
    said = capsys.readouterr().out
    assert "x real time, nodes machine_sim" in said
    assert f"{told.state_hash} after tick {told.state_tick}" in said
    print_summary(dig.outcome)
    assert "x real time, one process" in capsys.readouterr().out


def test_progress_is_told(dig, tmp_path, capsys) -> None:
    bag = write(tmp_path / "bag", dig.recording)
    outcome_from_bag(bag, progress=True)
    assert str(bag) in capsys.readouterr().out


def test_cycles_are_those_the_operator_told(dig, outcome) -> None:
    recording = dig.recording.copy()
    for report in REPORTS:
        recording.add(CYCLES, String(data=json.dumps(asdict(report))))
    found = outcome(recording)
    assert found.cycles == REPORTS
    assert found.moved_volume == pytest.approx(1.3)


def test_messages_that_came_twice_change_nothing(dig, told, outcome) -> None:
    again = dig.recording.copy()
    again.messages = [each for each in again.messages for _ in range(2)]
    assert_same(outcome(again), told)


def test_messages_out_of_order_between_topics_change_nothing(dig, told, outcome) -> None:
    delays = np.random.default_rng(0).integers(0, 20, len(dig.recording.messages))
    late = [
        (topic, time + 1000 * int(delay), message)
        for (topic, time, message), delay in zip(dig.recording.messages, delays, strict=True)
    ]
    own = [i for i, (topic, _, _) in enumerate(late) if topic == PHASE]  # of one publisher
    for one in own:
        late[one] = dig.recording.messages[one]
    assert_same(outcome(Recording(late)), told)


def test_rows_that_were_asked_for_again_fill_the_gap(dig, told, outcome) -> None:
    recording = dig.recording.copy()
    number = next(
        i for i, (topic, _, _) in enumerate(recording.messages) if topic == "/terrain/map_updates"
    )
    topic, _, rows = recording.messages.pop(number)
    recording.add(topic, rows)
    assert_same(outcome(recording), told)


def test_without_markers_only_the_shoes_are_missing(dig, told, outcome) -> None:
    found = outcome(dig.recording.without("/excavator/markers"))
    shoes = len(told.machine_faces) - len(found.machine_faces)
    assert shoes == 2 * dig.run.config.machine.tracks.shoe_count * 6
    assert {colour for colour, _ in found.machine_faces} < {c for c, _ in told.machine_faces}


# Where a run begins and ends


def test_ticks_after_the_operator_has_left_do_not_count_but_must_balance(
    dig, told, outcome
) -> None:
    recording = dig.recording.copy()
    header = next(
        from_multi_array(m) for t, _, m in reversed(recording.messages) if t == "/soil/tick"
    )
    for tick in (header.tick + 1, header.tick + 2):
        recording.add("/soil/tick", to_multi_array(replace(header, tick=tick)))
        ledger = replace(told.ledger, tick=tick, terrain=told.ledger.terrain - 7)
        recording.add("/soil/ledger", to_multi_array(ledger))
    found = outcome(recording)
    assert found.max_imbalance == -7
    assert_same(replace(found, max_imbalance=0), told)


def test_operator_that_was_not_heard_to_the_end_did_not_finish(dig, outcome) -> None:
    recording = dig.recording.copy()
    end = max(i for i, (topic, _, _) in enumerate(recording.messages) if topic == PHASE)
    before = max(i for i, (t, _, _) in enumerate(recording.messages[:end]) if t == PHASE)
    del recording.messages[end]
    del recording.messages[before]  # which told that it gave up
    found = outcome(recording)
    assert found.abort_reason == "the operator did not finish"
    assert not found.is_balanced
    assert found.simulated_time == dig.outcome.simulated_time


def test_recording_that_breaks_off_tells_the_run_up_to_there(dig, told, outcome) -> None:
    recording = dig.recording.copy()
    recording.messages.insert(5, recording.messages[-1])  # diagnostics come all the time
    half = next(i for i, (t, _, m) in enumerate(recording.messages) if _is_ledger(t, m, 500))
    found = outcome(Recording(recording.messages[:half]), finish=False)
    assert found.abort_reason == "the operator did not finish"
    assert 100 <= found.ledger.tick < 500
    assert len(found.lip_path) == found.ledger.tick // 10
    np.testing.assert_array_equal(found.lip_path, told.lip_path[: len(found.lip_path)])


def test_last_run_of_a_bag_counts(dig, told, outcome) -> None:
    recording = dig.recording.copy()
    config, map_of = (
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
        ledger = replace(told.ledger, tick=tick, terrain=0)
        older.add("/soil/ledger", to_multi_array(ledger))
        older.add("/excavator/odom", map_of)
        for name in ("phase", "cycles"):
            said = {"time": 0.0, "cycle": 9, "phase": "done", "abort_reason": "tired"}
            text = json.dumps(said if name == "phase" else asdict(REPORTS[0]))
            older.add(f"/excavator/operator/{name}", String(data=text))
    assert config.data != old
    later = [(topic, time + 10**6, message) for topic, time, message in recording.messages]
    assert_same(outcome(Recording(older.messages + later)), told)


def test_another_machine_in_the_bag_changes_nothing(dig, told, outcome) -> None:
    recording = dig.recording.copy()
    facts = RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),))
    config = {"machine_sim": {"machine": "machines/dumper.yaml"}}
    recording.add("/truck/config", String(data=to_config_yaml(facts, config)))
    recording.add("/truck/joint_states", JointState(name=["bed"], position=[0.0]))
    recording.add("/truck/applied_commands", JointState(name=["bed"], velocity=[0.0]))
    values = [KeyValue(key="tunnelled", value="77")]
    status = DiagnosticStatus(name="truck/machine_sim: machine_sim", values=values)
    recording.add("/diagnostics", DiagnosticArray(status=[status]))
    assert_same(outcome(recording), told)


def test_machine_of_a_node_of_several_is_told_of_as_well(dig, told, outcome) -> None:
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
        told_now = config if here == "/site/config" else message
        recording.messages.append((here, time, told_now))
    cycles = "/site/excavator/operator/cycles"
    assert_same(outcome(recording, cycles=cycles), told)


# What is missing


@pytest.mark.parametrize(
    "topic",
    [
        "/sim/config",
        "/soil/tick",
        "/soil/ledger",
        "/soil/state_hash",
        "/terrain/map",
        "/terrain/map_updates",
        "/diagnostics",
        "/excavator/config",
        "/excavator/odom",
        "/excavator/joint_states",
        "/excavator/particles",
        "/excavator/operator/phase",
    ],
)
def test_topic_that_is_missing_is_named(dig, outcome, topic) -> None:
    named = topic.removeprefix("/excavator") if topic == PHASE else topic
    with pytest.raises(RecordedRunError, match=named):
        outcome(dig.recording.without(topic))


def test_changed_cells_that_are_missing_are_told(dig, outcome) -> None:
    recording = dig.recording.copy()
    changes = [i for i, (t, _, _) in enumerate(recording.messages) if t == "/terrain/map_updates"]
    del recording.messages[changes[len(changes) // 2]]
    with pytest.raises(
        RecordedRunError, match=r"row \d+ of \d+ is missing on /terrain/map_updates"
    ):
        outcome(recording)


@pytest.mark.parametrize("topic", ["/soil/ledger", "/soil/tick"])
def test_tick_that_is_missing_is_told(dig, outcome, topic) -> None:
    recording = dig.recording.copy()
    own = [i for i, (t, _, _) in enumerate(recording.messages) if t == topic]
    del recording.messages[own[100]]
    with pytest.raises(RecordedRunError, match=f"tick 100 of .* on {topic}"):
        outcome(recording)


def test_bag_that_begins_in_the_middle_is_refused(dig, outcome) -> None:
    recording = dig.recording.copy()
    maps = [i for i, (t, _, _) in enumerate(recording.messages) if t == "/terrain/map"]
    for index in reversed(maps[:-1]):
        del recording.messages[index]
    with pytest.raises(RecordedRunError, match="first map on /terrain/map shows revision"):
        outcome(recording)


def test_machine_file_that_is_not_there_is_named(dig, outcome) -> None:
    recording = dig.recording.copy()
    config = {"machine_sim": {"machine": "machines/grader.yaml"}}
    text = to_config_yaml(RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),)), config)
    recording.add("/excavator/config", String(data=text))
    with pytest.raises(RecordedRunError, match=r"described in 'machines/grader.yaml'"):
        outcome(recording)


@pytest.mark.parametrize(
    ("topic", "text"),
    [(PHASE, "digging"), (PHASE, '{"time": 1.0}'), (CYCLES, "[]"), ("/soil/state_hash", "abc")],
)
def test_message_that_cannot_be_read_is_told_with_its_topic(dig, outcome, topic, text) -> None:
    recording = dig.recording.copy()
    recording.add(topic, String(data=text))
    with pytest.raises(RecordedRunError, match=f"a message on {topic}"):
        outcome(recording)


def test_topic_of_another_type_is_told(dig, outcome) -> None:
    recording = dig.recording.without("/soil/ledger")
    recording.add("/soil/ledger", String(data="0"))
    with pytest.raises(RecordedRunError, match="/soil/ledger is std_msgs/msg/String"):
        outcome(recording)


def test_bag_of_two_operators_is_refused(dig, outcome) -> None:
    recording = dig.recording.copy()
    recording.add("/excavator_2/operator/phase", String(data="{}"))
    with pytest.raises(EarthmovingError, match="one operator"):
        outcome(recording)


# Nodes


def test_bag_that_a_recorder_made_of_nodes_tells_what_one_process_does(ros, tmp_path) -> None:
    site = small_site()
    save_terrain(tmp_path / "site.npz", site)
    config = load_run_config("demo.yaml", {"approach": 0.0, "start_x": 0.0})
    config = replace(config, task=replace(config.task, timeout=1.0))
    recorder = ros.add(RecorderNode, parameters={"path": str(tmp_path / "bag"), "progress": False})
    heard = ros.collect("/diagnostics", DiagnosticArray)
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
    # One is told twice once time stands still: the last commands have counted by then.
    ros.spin_until(lambda: len(hashes) > 1 and hashes[-1].data == hashes[-2].data)
    ros.spin_until(lambda: any("machine_sim" in s.name for m in heard for s in m.status))
    operator.stop()
    recorder.stop()
    told = outcome_from_bag(tmp_path / "bag")

    run = SingleProcessDig(config, site)
    try:
        own = run.run()
    finally:
        run.close()
    assert own.abort_reason
    assert_same(told, own)
    assert told.state_hash == own.state_hash  # of ground that nothing has touched
    assert 100 <= told.state_tick <= told.ledger.tick
    assert told.run_mode == "nodes dig_operator, exchange_recorder, machine_sim, soil_sim"


def _is_ledger(topic: str, message: Any, tick: int) -> bool:
    return topic == "/soil/ledger" and from_multi_array(message).tick == tick
