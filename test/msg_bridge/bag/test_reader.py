"""Bags are read whether finished, truncated or split; anything else is a BagReadError."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from mcap.writer import CompressionType, Writer
from std_msgs.msg import Int64MultiArray, String
from support.recorded_messages import write_mcap

from msg_bridge.bag.reader import BagReader, BagReadError, TopicInfo
from msg_bridge.bag.writer import BagWriter


def messages(count: int, *, first: int = 0) -> list[tuple[str, int, object]]:
    """Return strings on /a at even log times and times on /b at odd ones."""
    return [
        ("/a", n, String(data=f"text {n}")) if n % 2 == 0 else ("/b", n, Time(sec=n))
        for n in range(first, first + count)
    ]


def times(reader: BagReader, **options: object) -> list[int]:
    return [time for _, time, _ in reader.messages(**options)]


def test_messages_are_decoded_into_the_classes_of_ros(tmp_path: Path) -> None:
    reader = BagReader(write_mcap(tmp_path / "a.mcap", messages(4)))
    assert list(reader) == messages(4)
    assert reader.truncated == ()


def test_topics_have_type_and_count(tmp_path: Path) -> None:
    reader = BagReader(write_mcap(tmp_path / "a.mcap", messages(7)))
    assert reader.topics == {
        "/a": TopicInfo("std_msgs/msg/String", 4),
        "/b": TopicInfo("builtin_interfaces/msg/Time", 3),
    }


def test_only_requested_topics_are_read(tmp_path: Path) -> None:
    reader = BagReader(write_mcap(tmp_path / "a.mcap", messages(6)))
    assert times(reader, topics=["/b"]) == [1, 3, 5]
    with pytest.raises(BagReadError, match="no topic /c; it has /a, /b"):
        reader.messages(["/c"])


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("finish", [True, False])
def test_messages_are_ordered_by_log_time_across_chunks(
    tmp_path: Path, compression: CompressionType, finish: bool
) -> None:
    order = np.random.default_rng(3).permutation(500)
    shuffled = [messages(500)[n] for n in order]
    path = write_mcap(
        tmp_path / "a.mcap", shuffled, chunk_size=300, compression=compression, finish=finish
    )
    found = times(BagReader(path))
    assert found == sorted(found)
    assert len(found) > 490


def test_messages_of_equal_log_time_keep_their_order(tmp_path: Path) -> None:
    equal = [("/a", 5, String(data=str(n))) for n in range(100)]
    reader = BagReader(write_mcap(tmp_path / "a.mcap", equal, chunk_size=200))
    assert [message.data for _, _, message in reader] == [str(n) for n in range(100)]


def test_file_without_chunks_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/a", "cdr", schema)
        for time in (3, 1, 2):
            writer.add_message(channel, time, b"\0\1\0\0\2\0\0\0x\0\0\0", time)
        writer.finish()
    reader = BagReader(path)
    assert times(reader) == [1, 2, 3]
    assert reader.topics["/a"].count == 3


def test_file_of_a_killed_recorder_is_read_and_reported_as_truncated(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", messages(500), chunk_size=500, finish=False)
    reader = BagReader(path)
    assert reader.truncated == ("a.mcap",)
    found = times(reader)
    assert found == list(range(len(found)))
    assert 480 < len(found) < 500
    assert sum(topic.count for topic in reader.topics.values()) == len(found)


@pytest.mark.parametrize("tail", [b"", b"\0" * 4096])
def test_file_cut_anywhere_is_read_up_to_its_last_complete_chunk(
    tmp_path: Path, tail: bytes
) -> None:
    complete = write_mcap(tmp_path / "complete.mcap", messages(300), chunk_size=500).read_bytes()
    path = tmp_path / "cut.mcap"
    counts = []
    for part in np.linspace(0.4, 0.99, 25):
        path.write_bytes(complete[: int(part * len(complete))] + tail)
        reader = BagReader(path)
        assert reader.truncated == ("cut.mcap",)
        found = times(reader)
        assert found == list(range(len(found)))
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[0] > 0


def test_damaged_chunk_is_an_error_with_its_position(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "a.mcap", messages(300), chunk_size=500, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    where = data.index(b"text 100")
    data[where : where + 4] = b"best"
    path.write_bytes(data)
    with pytest.raises(BagReadError, match=r"a\.mcap is damaged at byte \d+"):
        times(BagReader(path))


@pytest.mark.parametrize("namespace", ["/excavator", "excavator", "excavator/"])
def test_topics_of_a_namespace_are_relative_to_it(namespace: str) -> None:
    bag = Path(__file__).parents[3] / "bags/format_2"
    reader = BagReader(bag, namespace=namespace)
    assert reader.namespace == "/excavator"
    assert {"/odom", "/joint_states"} <= set(reader.topics)


def test_folder_of_files_is_one_bag(tmp_path: Path) -> None:
    for part in (0, 9, 10):
        write_mcap(tmp_path / f"bag_{part}.mcap", messages(10, first=10 * part))
    reader = BagReader(tmp_path)
    assert [file.name for file in reader.files] == ["bag_0.mcap", "bag_9.mcap", "bag_10.mcap"]
    assert times(reader) == [*range(10), *range(90, 110)]
    assert reader.topics["/a"].count == 15


def test_metadata_selects_the_files(tmp_path: Path) -> None:
    write_mcap(tmp_path / "b.mcap", messages(10))
    write_mcap(tmp_path / "other.mcap", messages(10))
    information = {"storage_identifier": "mcap", "relative_file_paths": ["b.mcap"]}
    metadata = tmp_path / "metadata.yaml"
    metadata.write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    assert times(BagReader(tmp_path)) == list(range(10))
    (tmp_path / "b.mcap").unlink()
    with pytest.raises(BagReadError, match=r"lacks b\.mcap"):
        BagReader(tmp_path)
    information["storage_identifier"] = "sqlite3"
    metadata.write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    with pytest.raises(BagReadError, match="sqlite3"):
        BagReader(tmp_path)
    metadata.write_text("nonsense")
    with pytest.raises(BagReadError, match=r"metadata\.yaml"):
        BagReader(tmp_path)


def test_anything_else_is_not_a_bag(tmp_path: Path) -> None:
    with pytest.raises(BagReadError):
        BagReader(tmp_path / "nowhere")
    with pytest.raises(BagReadError):
        BagReader(tmp_path)
    path = tmp_path / "a.mcap"
    path.write_bytes(b"")
    with pytest.raises(BagReadError):
        BagReader(path)
    path.write_bytes(b"SQLite format 3")
    with pytest.raises(BagReadError):
        BagReader(path)
    with pytest.raises(BagReadError):
        BagReader(write_mcap(path, []))


def test_messages_of_another_encoding_are_not_a_ros_2_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("text", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(BagReadError, match="json"):
        BagReader(path)


def test_missing_message_type_is_an_error_only_if_its_topic_is_requested(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        for topic, name in (("/a", "std_msgs/msg/Empty"), ("/b", "crane_msgs/msg/Hook")):
            schema = writer.register_schema(name, "ros2msg", b"# nothing")
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, 1, b"\0\1\0\0\0", 1)
        writer.finish()
    reader = BagReader(path)
    assert reader.topics["/b"].type == "crane_msgs/msg/Hook"
    assert len(list(reader.messages(["/a"]))) == 1
    assert len(list(reader.raw_messages())) == 2
    with pytest.raises(BagReadError, match="crane_msgs/msg/Hook"):
        reader.messages(["/b"])


def test_topics_and_messages_of_format_1_have_current_names(tmp_path: Path) -> None:
    text = String(data='{"time": 1.0, "cycle": 1, "phase": "dig", "given_up": ""}')
    recorded = [("/soil/refusals", 1, String(data="{}")), ("/m/operator/phase", 2, text)]
    reader = BagReader(write_mcap(tmp_path / "a.mcap", recorded))
    assert set(reader.topics) == {"/soil/join_rejections", "/m/operator/phase"}
    (_, (topic, _, phase)) = reader
    assert topic == "/m/operator/phase"
    assert "abort_reason" in phase.data


def test_raw_messages_are_the_recorded_bytes_and_can_be_decoded(tmp_path: Path) -> None:
    reader = BagReader(write_mcap(tmp_path / "a.mcap", [("/a", 1, Int64MultiArray(data=[7]))]))
    ((topic, time, data),) = reader.raw_messages()
    assert (topic, time) == ("/a", 1)
    assert data.endswith((7).to_bytes(8, "little"))
    assert reader.decode("/a", data).data.tolist() == [7]


@pytest.mark.parametrize("finish", [True, False])
def test_attachments_are_read_by_name(tmp_path: Path, finish: bool) -> None:
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic("/a", "std_msgs/msg/String")
    writer.write("/a", b"", 1, 1)
    writer.attach("x/soils.yaml", "application/yaml", b"first", 1)
    writer.attach("y/soils.yaml", "application/yaml", b"second", 1)
    writer.flush()
    if finish:
        writer.close()
    reader = BagReader(tmp_path / "dig")
    assert reader.attachment_names == {"x/soils.yaml", "y/soils.yaml"}
    assert reader.read_attachment("y/soils.yaml") == b"second"
    with pytest.raises(BagReadError, match="has no attachment z"):
        reader.read_attachment("z")


def test_damaged_attachment_is_rejected(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic("/a", "std_msgs/msg/String")
    writer.write("/a", b"", 1, 1)
    writer.attach("soils.yaml", "application/yaml", b"repose_angle: 30", 1)
    writer.close()
    writer.file.write_bytes(writer.file.read_bytes().replace(b"angle: 30", b"angle: 35"))
    with pytest.raises(BagReadError, match="damaged"):
        BagReader(writer.file).read_attachment("soils.yaml")
