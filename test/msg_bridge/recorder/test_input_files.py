"""The recorder adds the files that the configurations of a run name, if they are unchanged."""

import os

import pytest
from std_msgs.msg import String
from support.recorder_scenes import publish, spin_until_recorded

from msg_bridge.bag.reader import BagReader
from msg_bridge.codec import qos
from msg_bridge.codec.run_config import RunFacts, parse_input_files, to_config_yaml
from msg_bridge.contract.input_files import InputFile, read_input_file
from msg_bridge.contract.loose_soil import LooseSoil

FACTS = RunFacts(1, 0.01, False, 0.2, (LooseSoil(),))


def config(*files: InputFile) -> String:
    return String(data=to_config_yaml(FACTS, {}, (), files))


@pytest.fixture
def record(ros, recorder, tmp_path):
    """Record messages by topic; return the bag and the last status of the recorder."""

    def run(messages: dict[str, String]):
        node = recorder()
        for topic, message in messages.items():
            publish(ros.publisher(topic, String, qos.TRANSIENT_LOCAL, subscriptions=1), [message])
        spin_until_recorded(ros, node, len(messages))
        node.stop()
        return BagReader(tmp_path / "dig"), node.recording.status()

    return run


def test_each_file_is_attached_once(record, tmp_path):
    soils, machine = tmp_path / "soils.yaml", tmp_path / "machine.yaml"
    soils.write_text("loam: {}")
    machine.write_text("name: excavator")
    files = [read_input_file("soil.soils", soils), read_input_file("machine", machine)]
    reader, status = record(
        {"/t/sim/config": config(files[0]), "/t/a/config": config(*files), "/t/b/config": config()}
    )
    contents = {each.parameter: reader.read_attachment(each.attachment_name) for each in files}
    assert contents == {"soil.soils": b"loam: {}", "machine": b"name: excavator"}
    assert len(reader.attachment_names) == status["input_files"] == 2
    assert status["missing_files"] == {}
    assert parse_input_files(config(*files).data) == tuple(files)


def test_changed_and_missing_files_are_reported_and_not_attached(record, tmp_path):
    changed, gone, pipe = (tmp_path / name for name in ("changed.yaml", "gone.yaml", "pipe"))
    for path in (changed, gone):
        path.write_text("loam: {}")
    files = [read_input_file("soil.soils", changed), read_input_file("machine", gone)]
    changed.write_text("clay: {}")
    gone.unlink()
    os.mkfifo(pipe)  # nothing is read from it: that would block
    files.append(InputFile("site.terrain", str(pipe), "0" * 64, 0))
    reader, status = record({"/t/sim/config": config(*files)})
    assert reader.attachment_names == frozenset()
    assert status["missing_files"] == {
        "soil.soils": str(changed), "machine": str(gone), "site.terrain": str(pipe)
    }  # fmt: skip


def test_configurations_of_other_programs_are_ignored(record):
    texts = ("", "[1, 2]", "{", "input_files: 3", "input_files: [{parameter: x}]")
    messages = {f"/t/n{k}/config": String(data=text) for k, text in enumerate(texts)}
    reader, status = record(messages)
    assert status["missing_files"] == {}
    assert reader.attachment_names == frozenset()
