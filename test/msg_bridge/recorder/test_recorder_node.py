"""All messages that nodes publish are in the bag, unchanged, however the recorder ends."""

import array
import contextlib
import importlib
import io
import json
import resource
import signal
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, String

from msg_bridge.bag.writer import BagError
from msg_bridge.codec import qos
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import SWEEP, empty_rows
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.recorder_node import RecorderNode

RECORDER = [sys.executable, "-m", "msg_bridge.recorder.recorder_node"]
LARGE = QoSProfile(depth=5000)  # the publisher loses nothing

# The recorder as a process that may write files of argv[1] bytes.
LIMITED = """\
import resource, sys
from msg_bridge.recorder.recorder_node import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
sys.exit(main())
"""


@pytest.fixture
def recorder(ros, tmp_path):
    """Create recorders of the topics below /t/ into the folder `dig`."""

    def make(**parameters) -> RecorderNode:
        given = {"path": str(tmp_path / "dig"), "include": "^/t/", "progress": False}
        given["scan_period"] = 0.02  # publishers are checked every 0.2 s then
        return ros.add(RecorderNode, parameters={**given, **parameters})

    return make


def texts(first: int, last: int) -> list[String]:
    return [String(data=f"text {i}") for i in range(first, last + 1)]


def publish(publisher, messages) -> None:
    for message in messages:
        publisher.publish(message)


def num_recorded(recorder: RecorderNode) -> int:
    return recorder.recording.messages


def spin_until_recorded(ros, recorder: RecorderNode, count: int) -> None:
    ros.spin_until(lambda: num_recorded(recorder) >= count, what=f"{count} messages to be recorded")


def read_bag(folder: Path) -> dict[str, list[Any]]:
    """Return the messages of a finished bag by topic."""
    messages: dict[str, list[Any]] = {}
    with Reader(folder) as reader:
        for connection, _, data in reader.messages():
            package, name = connection.msgtype.split("/msg/")
            of = getattr(importlib.import_module(f"{package}.msg"), name)
            messages.setdefault(connection.topic, []).append(deserialize_message(data, of))
    return messages


def decoded_texts(messages: list[Message]) -> list[String]:
    return [deserialize_message(each.data, String) for each in messages]


def records_of(folder: Path, topic: str) -> list[Message]:
    """Return the MCAP messages of a bag that may be truncated."""
    (file,) = folder.glob("*.mcap")
    channels, messages = {}, []
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message) and channels[record.channel_id] == topic:
                    messages.append(record)
        except EndOfFile:
            pass
    return messages


def test_bag_contains_every_published_message(ros, recorder, tmp_path):
    sent = {
        "/t/texts": (LARGE, texts(0, 99)),
        "/t/numbers": (
            qos.COMMANDS,
            [Float64MultiArray(data=array.array("d", [i, 0.5])) for i in range(5)],
        ),
        "/t/transient_local": (qos.TRANSIENT_LOCAL, [String(data="only")]),
        "/t/points": (LARGE, [PointStamped(), PointStamped()]),
    }
    made = recorder(repeat_transient_local_period=0.0)
    for topic, (profile, messages) in sent.items():
        publish(ros.publisher(topic, type(messages[0]), profile, subscriptions=1), messages)
    spin_until_recorded(ros, made, sum(len(messages) for _, messages in sent.values()))
    made.stop()

    assert read_bag(tmp_path / "dig") == {topic: each for topic, (_, each) in sent.items()}
    assert [each.sequence for each in records_of(tmp_path / "dig", "/t/texts")] == [*range(1, 101)]
    with AnyReader([tmp_path / "dig"]) as reader:
        of_texts = [each for each in reader.connections if each.topic == "/t/texts"]
        read = [reader.deserialize(d, c.msgtype).data for c, _, d in reader.messages(of_texts)]
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        decoding = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [each.data for *_, each in decoding.iter_decoded_messages("/t/texts")]
    assert read == decoded == [f"text {i}" for i in range(100)]


def test_bytes_are_not_changed(ros, recorder, tmp_path):
    made = recorder()
    raw: list[bytes] = []
    ros.helper.create_subscription(String, "/t/texts", raw.append, LARGE, raw=True)
    publish(ros.publisher("/t/texts", String, LARGE, subscriptions=2), texts(1, 50))
    ros.spin_until(lambda: len(raw) == 50)
    spin_until_recorded(ros, made, 50)
    made.stop()
    assert [each.data for each in records_of(tmp_path / "dig", "/t/texts")] == raw


def test_offered_qos_is_recorded(ros, recorder, tmp_path):
    made = recorder()
    for topic, profile in (
        ("/t/transient_local", qos.TRANSIENT_LOCAL),
        ("/t/best_effort", qos.COMMANDS),
    ):
        ros.publisher(topic, String, profile, subscriptions=1)
    made.stop()
    with Reader(tmp_path / "dig") as reader:
        offered = {each.topic: each.ext.offered_qos_profiles for each in reader.connections}
    ((transient_local,), (best_effort,)) = offered["/t/transient_local"], offered["/t/best_effort"]
    assert transient_local.durability is QosDurability.TRANSIENT_LOCAL
    assert transient_local.reliability is QosReliability.RELIABLE
    assert best_effort.durability is QosDurability.VOLATILE
    assert best_effort.reliability is QosReliability.BEST_EFFORT


def test_all_topics_are_recorded_by_default(ros, recorder, tmp_path):
    made = recorder(include="")
    node = ros.node("talker")
    ros.spin_until(lambda: "/rosout" in made.recording.topics)
    ros.spin_until(lambda: "/parameter_events" in made.recording.topics)
    node.declare_parameter("new", 1)
    node.get_logger().info("hello")
    ros.spin_until(lambda: num_recorded(made) >= 2)
    ros.spin_until(lambda: "/recorder/status" in made.recording.topics)
    ros.spin_until(lambda: "/diagnostics" in made.recording.topics)
    made.stop()
    found = read_bag(tmp_path / "dig")
    assert "/talker" in [each.node for each in found["/parameter_events"]]
    assert "hello" in [each.msg for each in found["/rosout"]]


def test_only_selected_topics_are_recorded(ros, recorder, tmp_path):
    made = recorder(include="^/t/|/map$", exclude="image")
    for topic in ("/t/camera/image", "/t/a", "/terrain/map", "/other"):
        ros.publisher(topic, String)
    ros.spin_until(lambda: len(made.recording.topics) == 2)
    ros.spin_for(0.3)
    assert sorted(made.recording.topics) == ["/t/a", "/terrain/map"]
    made.stop()


def test_transient_local_message_from_before_the_recorder_is_in_the_bag(ros, recorder, tmp_path):
    publish(ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL), texts(1, 2))
    made = recorder()
    spin_until_recorded(ros, made, 1)
    made.stop()
    assert read_bag(tmp_path / "dig") == {"/t/transient_local": texts(2, 2)}


def test_transient_local_messages_are_written_again(ros, recorder, tmp_path):
    publish(ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL), texts(1, 1))
    publish(ros.publisher("/t/volatile", String, qos.ROWS), texts(1, 1))
    made = recorder(repeat_transient_local_period=0.1)
    spin_until_recorded(ros, made, 1)
    ros.spin_for(0.55)
    made.stop()
    repeated = records_of(tmp_path / "dig", "/t/transient_local")
    assert 4 <= len(repeated) <= 7
    steps = np.diff([each.log_time for each in repeated])
    assert (steps >= 1e8).all()
    identities = {(each.data, each.publish_time, each.sequence) for each in repeated}
    assert len(identities) == 1  # distinguishes repetitions from new messages
    assert records_of(tmp_path / "dig", "/t/volatile") == []
    assert num_recorded(made) == 1


def test_only_the_newest_transient_local_message_is_written_again(ros, recorder, tmp_path):
    publisher = ros.publisher("/t/transient_local", String, qos.TRANSIENT_LOCAL)
    made = recorder(repeat_transient_local_period=0.1)
    ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    publish(publisher, texts(1, 3))
    spin_until_recorded(ros, made, 3)
    ros.spin_for(0.15)
    made.stop()
    found = [each.sequence for each in records_of(tmp_path / "dig", "/t/transient_local")]
    assert found[:3] == [1, 2, 3]
    assert set(found[3:]) == {3}


def test_publisher_with_weaker_qos_than_the_others_is_recorded(ros, recorder, tmp_path):
    made = recorder(repeat_transient_local_period=0.0)
    transient_local = ros.publisher("/t/mixed", String, qos.TRANSIENT_LOCAL, subscriptions=1)
    best_effort = ros.publisher("/t/mixed", String, qos.COMMANDS, subscriptions=1)
    ros.spin_until(lambda: transient_local.get_subscription_count() == 1)
    publish(transient_local, texts(1, 1))
    publish(best_effort, texts(2, 2))
    spin_until_recorded(ros, made, 2)
    made.stop()
    found = read_bag(tmp_path / "dig")["/t/mixed"]
    assert sorted(each.data for each in found) == ["text 1", "text 2"]


def test_messages_that_overrun_the_recorder_are_counted(ros, recorder, tmp_path):
    made = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, made, 1)
    publish(publisher, texts(2, 1500))  # without spinning in between
    spin_until_recorded(ros, made, 1001)
    ros.spin_until(lambda: made.recording.loss_counter.total > 0)
    assert made.recording.loss_counter.lost == {"/t/texts": 499}
    made.stop()
    metadata = yaml.safe_load((tmp_path / "dig/metadata.yaml").read_text())
    custom = metadata["rosbag2_bagfile_information"]["custom_data"]
    assert json.loads(custom["lost"]) == {"/t/texts": 499}


def test_publishers_that_start_end_or_restart_cause_no_losses(ros, recorder, tmp_path):
    made = recorder()
    keeper = ros.publisher("/t/shared", String, LARGE, subscriptions=1)
    count = 0
    for turn in range(3):
        node = ros.node(f"restarted_{turn}")
        for topic in ("/t/shared", "/t/own"):
            publisher = node.create_publisher(String, topic, LARGE)
            publish(publisher, texts(1, 40))  # numbers 1 to 40; late subscribers receive the rest
            ros.spin_until(lambda p=publisher: p.get_subscription_count() == 1)
            publish(publisher, texts(41, 50))
            publish(keeper, texts(1, 5))
            count += 15
        spin_until_recorded(ros, made, count)
        ros.remove(node)
    ros.spin_for(0.5)  # two checks of the graph
    publish(keeper, texts(1, 5))
    ros.spin_for(0.3)
    made.stop()
    assert made.recording.loss_counter.lost == {}


def test_missing_rows_are_counted_until_they_are_sent_again(ros, recorder):
    made = recorder()
    first, second = (
        ros.publisher("/t/sweeps", PointCloud2, qos.ROWS, subscriptions=1) for _ in range(2)
    )

    def send(publisher, seq: range, machine_id: int) -> None:
        rows = empty_rows(SWEEP, len(seq))
        rows["seq"], rows["machine_id"] = seq, machine_id
        chunk = RowChunk(7, Stream.SWEEP, machine_id, 1, rows)
        publisher.publish(to_chunk_cloud(chunk, "map", Time()))

    for start in (1, 11, 31):
        send(first, range(start, start + 10), machine_id=1)
        send(second, range(5 * start, 5 * start + 50), machine_id=2)
    spin_until_recorded(ros, made, 6)
    assert made.recording.loss_counter.lost == {"/t/sweeps": 10 + 50}
    send(first, range(21, 31), machine_id=1)
    spin_until_recorded(ros, made, 7)
    assert made.recording.loss_counter.lost == {"/t/sweeps": 50}
    made.stop()


def test_topic_of_a_type_that_is_not_installed_is_skipped_with_one_warning(
    ros, recorder, tmp_path, monkeypatch, capfd
):
    ros.publisher("/t/unknown", PointStamped)
    monkeypatch.setitem(sys.modules, "geometry_msgs.msg", None)  # imports of it fail
    made = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, made, 1)
    ros.spin_for(0.5)
    made.stop()
    assert list(read_bag(tmp_path / "dig")) == ["/t/texts"]
    output = capfd.readouterr()
    assert (output.out + output.err).count("/t/unknown is not recorded") == 1


@pytest.mark.parametrize("include", ["^/t/", "^/t/|^/clock"])
def test_log_time_is_the_last_clock_with_simulation_time(ros, recorder, tmp_path, include):
    made = recorder(use_sim_time=True, include=include)
    clock = ros.publisher("/clock", Clock, qos.STATE, subscriptions=2)  # one is the node's own
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 2))
    ros.spin_for(0.1)
    for second in (50, 51, 52):
        publish(clock, [Clock(clock=Time(sec=second, nanosec=5))])
        publish(publisher, texts(second, second))
    spin_until_recorded(ros, made, 5 + 3 * ("clock" in include))
    made.stop()
    found = records_of(tmp_path / "dig", "/t/texts")
    seconds = [divmod(each.log_time, 10**9) for each in found]
    assert seconds == [
        (50, 5),
        (50, 5),
        (50, 5),
        (51, 5),
        (52, 5),
    ]  # two before /clock
    assert len(records_of(tmp_path / "dig", "/clock")) == 3 * ("clock" in include)


def test_messages_are_written_in_the_order_of_reception(ros, recorder, tmp_path):
    made = recorder()
    publishers = [
        ros.publisher(f"/t/{name}", String, LARGE, subscriptions=1) for name in ("b", "a", "c")
    ]
    for i in range(100):
        publish(publishers[i % 3], [String(data=str(i))])
    spin_until_recorded(ros, made, 100)
    made.stop()
    with AnyReader([tmp_path / "dig"]) as reader:
        read = [int(reader.deserialize(d, c.msgtype).data) for c, _, d in reader.messages()]
    assert read == list(range(100))


def test_stop_writes_queued_messages(ros, recorder, tmp_path):
    made = recorder()
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 300))
    publisher.wait_for_all_acked()
    made.stop()
    made.stop()
    assert len(read_bag(tmp_path / "dig")["/t/texts"]) == 300


def test_status_and_diagnostics_report_losses(ros, recorder, tmp_path):
    made = recorder()
    diagnostics = ros.collect("/diagnostics", DiagnosticArray)
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 1))
    spin_until_recorded(ros, made, 1)
    publish(publisher, texts(2, 1101))
    ros.spin_until(lambda: made.recording.loss_counter.total > 0)
    ros.spin_until(lambda: diagnostics and diagnostics[-1].status[0].level == b"\x01")
    status = diagnostics[-1].status[0]
    assert status.message == "lost 100 on /t/texts"
    assert {each.key: each.value for each in status.values}["messages"] == "1001"
    statuses = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: statuses and json.loads(statuses[-1].data)["num_lost"] > 0)
    size = sum(len(serialize_message(each)) for each in [*texts(1, 1), *texts(102, 1101)])
    status = json.loads(statuses[-1].data)
    assert size <= status.pop("bytes") < size + 1001 * 4  # the middleware pads
    assert status == {
        "path": str(tmp_path / "dig"),
        "topics": 1,
        "messages": 1001,
        "num_lost": 100,
        "lost": {"/t/texts": 100},
        "uncounted": [],
    }
    made.stop()


def test_progress_on_a_terminal_is_one_updated_line(ros, recorder, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    made = recorder(progress=True)
    ros.spin_until(lambda: terminal.getvalue().count("\r") >= 2)
    made.stop()
    *lines, last, end = terminal.getvalue().split("\n")
    assert len(lines) == 1
    assert all(each.startswith("0 messages, 0.0 MB") for each in lines[0].split("\r")[1:])
    assert last.startswith(made.recording.path)
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
    made = ros.add(RecorderNode, parameters={"progress": False})
    made.stop()
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
    made = recorder(compression="none")
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    large = String(data=1_100_000 * "x")  # more than a chunk
    publish(publisher, [large])
    with max_file_size(500_000), pytest.raises(BagError, match="no disk space"):
        spin_until_recorded(ros, made, 3)
    publish(publisher, [large])
    publisher.wait_for_all_acked()
    made.stop()
    assert records_of(tmp_path / "dig", "/t/texts") == []
    assert [each.name for each in (tmp_path / "dig").iterdir()] == ["dig_0.mcap"]


def test_parameter_file_has_the_defaults():
    (content,) = yaml.safe_load(find_config("exchange_recorder.yaml").read_text()).values()
    assert RecorderParams.from_mapping(content["ros__parameters"]) == RecorderParams()


# As a process.


def has_recorded(status: list[String], count: int) -> bool:
    return bool(status) and json.loads(status[-1].data)["messages"] >= count


def test_terminated_process_leaves_a_complete_bag(ros, ros_process, tmp_path):
    process = ros_process(
        [*RECORDER, "--ros-args", "-p", f"path:={tmp_path}/dig", "-p", "include:=^/t/"]
    )
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 500))
    publisher.wait_for_all_acked()
    process.stop(signal.SIGTERM, expect=0)
    assert read_bag(tmp_path / "dig") == {"/t/texts": texts(1, 500)}
    last = process.output.splitlines()[-1]
    assert last.startswith(f"{tmp_path}/dig: 500 messages on 1 topics")
    assert last.endswith("nothing lost")


def test_killed_process_leaves_all_messages_of_its_last_status(ros, ros_process, tmp_path):
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "dig"), "include": "^/t/"})
    status = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 200))
    ros.spin_until(lambda: has_recorded(status, 200))
    process.kill()
    assert decoded_texts(records_of(tmp_path / "dig", "/t/texts")) == texts(1, 200)
    assert not (tmp_path / "dig/metadata.yaml").exists()


def test_full_disk_ends_the_process_with_an_error_message(ros, ros_process, tmp_path):
    script = tmp_path / "limited.py"
    script.write_text(textwrap.dedent(LIMITED))
    process = ros_process(
        [sys.executable, script, "20000"],
        parameters={"path": str(tmp_path / "dig"), "include": "^/t/", "compression": "none"},
    )
    publisher = ros.publisher("/t/texts", String, LARGE, subscriptions=1)
    publish(publisher, texts(1, 100))
    status = ros.collect("/recorder/status", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: has_recorded(status, 100))
    publish(publisher, [String(data=30_000 * "x")])
    process.wait(expect=2)
    last = process.output.splitlines()[-1]
    assert last.startswith("exchange_recorder: there is no disk space for")
    assert sum("no disk space" in line for line in process.output.splitlines()) == 1
    assert decoded_texts(records_of(tmp_path / "dig", "/t/texts")) == texts(1, 100)


def test_invalid_path_ends_the_process_with_an_error_message(ros_process, tmp_path):
    (tmp_path / "file").touch()
    process = ros_process(RECORDER, parameters={"path": str(tmp_path / "file/dig")})
    process.wait(expect=2)
    assert "file/dig cannot be written" in process.output
