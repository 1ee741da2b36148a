"""Recorder node: output folder, progress, stopping, errors."""

import contextlib
import io
import resource
import sys

import pytest
import yaml
from std_msgs.msg import String
from support.recorder_scenes import LARGE, publish, read_bag, records_of, spin_until_recorded, texts

from msg_bridge.bag.writer import BagError
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.recorder_node import RecorderNode


def test_stop_writes_queued_messages(ros, recorder, tmp_path):
    node = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 300))
    publisher.wait_for_all_acked()
    node.stop()
    node.stop()
    assert len(read_bag(tmp_path / "dig")["/t/texts"]) == 300


def test_progress_on_a_terminal_is_one_updated_line(ros, recorder, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    node = recorder(progress=True)
    ros.spin_until(lambda: terminal.getvalue().count("\r") >= 2)
    node.stop()
    *lines, last, end = terminal.getvalue().split("\n")
    assert len(lines) == 1
    assert all(each.startswith("0 messages, 0.0 MB") for each in lines[0].split("\r")[1:])
    assert last.startswith(node.recording.path)
    assert end == ""


def test_used_folder_and_invalid_expression_are_errors(ros, recorder, tmp_path):
    with pytest.raises(ParameterError, match="include"):
        recorder(include="/t/(")
    (tmp_path / "dig").mkdir()
    (tmp_path / "dig/notes.txt").touch()
    with pytest.raises(BagError, match="is not empty"):
        recorder()


def test_default_folder_is_named_by_the_time(ros, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    node = ros.add(RecorderNode, parameters={"progress": False})
    node.stop()
    (folder,) = (tmp_path / "bags").glob("20??-??-??T??-??-??Z")
    assert sorted(each.suffix for each in folder.iterdir()) == [".mcap", ".yaml"]


@contextlib.contextmanager
def max_file_size(size: int):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_full_disk_is_reported_once(ros, recorder, tmp_path):
    node = recorder(compression="none")
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    large = String(data=1_100_000 * "x")  # more than a chunk
    publish(publisher, [large])
    with max_file_size(500_000), pytest.raises(BagError, match="no disk space"):
        spin_until_recorded(ros, node, 3)
    publish(publisher, [large])
    publisher.wait_for_all_acked()
    node.stop()
    assert records_of(tmp_path / "dig", "/t/texts") == []
    assert [each.name for each in (tmp_path / "dig").iterdir()] == ["dig_0.mcap"]


def test_parameter_file_has_the_defaults():
    (content,) = yaml.safe_load(find_config("exchange_recorder.yaml").read_text()).values()
    assert RecorderParams.from_mapping(content["ros__parameters"]) == RecorderParams()
