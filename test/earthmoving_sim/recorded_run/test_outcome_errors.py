"""Missing or invalid messages in a bag are errors that name the topic."""

import pytest
from std_msgs.msg import String
from support.recorded_dig import CYCLES, PHASE, TICK

from earthmoving_sim.recorded_run.topic_decoders import RecordedRunError
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.loose_soil import LooseSoil


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
def test_missing_topic_is_named(dig, outcome, topic) -> None:
    named = topic.removeprefix("/excavator") if topic == PHASE else topic
    with pytest.raises(RecordedRunError, match=named):
        outcome(dig.recording.without(topic))


def test_missing_map_updates_are_an_error(dig, outcome) -> None:
    recording = dig.recording.copy()
    changes = [i for i, (t, _, _) in enumerate(recording.messages) if t == "/terrain/map_updates"]
    del recording.messages[changes[len(changes) // 2]]
    with pytest.raises(
        RecordedRunError, match=r"row \d+ of \d+ is missing on /terrain/map_updates"
    ):
        outcome(recording)


@pytest.mark.parametrize("topic", ["/soil/ledger", "/soil/tick"])
def test_missing_tick_is_an_error(dig, outcome, topic) -> None:
    recording = dig.recording.copy()
    own = [i for i, (t, _, _) in enumerate(recording.messages) if t == topic]
    del recording.messages[own[100]]
    with pytest.raises(RecordedRunError, match=f"tick 100 of .* on {topic}"):
        outcome(recording)


def test_bag_that_begins_in_the_middle_is_an_error(dig, outcome) -> None:
    recording = dig.recording.copy()
    maps = [i for i, (t, _, _) in enumerate(recording.messages) if t == "/terrain/map"]
    for index in reversed(maps[:-1]):
        del recording.messages[index]
    with pytest.raises(RecordedRunError, match="first map on /terrain/map"):
        outcome(recording)


def test_missing_machine_file_is_named(dig, outcome) -> None:
    recording = dig.recording.copy()
    config = {"machine_sim": {"machine": "machines/grader.yaml"}}
    text = to_config_yaml(RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),)), config)
    recording.add("/excavator/config", String(data=text))
    with pytest.raises(RecordedRunError, match=r"machines/grader\.yaml"):
        outcome(recording)


@pytest.mark.parametrize(
    ("topic", "text"),
    [(PHASE, "digging"), (PHASE, '{"time": 1.0}'), (CYCLES, "[]"), ("/soil/state_hash", "abc")],
)
def test_invalid_message_is_an_error_with_its_topic(dig, outcome, topic, text) -> None:
    recording = dig.recording.copy()
    recording.add(topic, String(data=text))
    with pytest.raises(RecordedRunError, match=f"a message on {topic}"):
        outcome(recording)


def test_topic_of_another_type_is_an_error(dig, outcome) -> None:
    recording = dig.recording.without("/soil/ledger")
    recording.add("/soil/ledger", String(data="0"))
    with pytest.raises(RecordedRunError, match="/soil/ledger is std_msgs/msg/String"):
        outcome(recording)


def test_bag_of_two_operators_is_an_error(dig, outcome) -> None:
    recording = dig.recording.copy()
    recording.add("/excavator_2/operator/phase", String(data="{}"))
    with pytest.raises(EarthmovingError, match="one operator"):
        outcome(recording)
