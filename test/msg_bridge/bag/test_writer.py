"""A bag is valid for rosbags and mcap, and readable however its recorder ends."""

import contextlib
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from std_msgs.msg import Int64MultiArray, MultiArrayLayout, String

from msg_bridge.bag.message_schemas import SchemaError, type_hash
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import COMPRESSIONS, BagError, BagWriter

TEXTS, NUMBERS = "/texts", "/numbers"
TRANSIENT_LOCAL = OfferedQos(durability="transient_local")

# Writes until it is killed or a write fails; argv: folder, size of a message, maximum file size.
ENDLESS = """\
import itertools, resource, sys
from pathlib import Path
from msg_bridge.bag.writer import BagError, BagWriter
if int(sys.argv[3]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
writer = BagWriter(Path(sys.argv[1]), compression="none", chunk_size=4096)
writer.add_topic("/texts", "std_msgs/msg/String")
try:
    for number in itertools.count():
        writer.write("/texts", b"x" * int(sys.argv[2]), number, number, number)
        print(number, writer.size, flush=True)
except BagError as error:
    print(error)
writer.close()
"""


def write_bag(folder: Path, **kwargs) -> dict[str, list[tuple[bytes, int]]]:
    """Write a bag and return its messages by topic as (CDR bytes, log time [ns])."""
    writer = BagWriter(folder, **kwargs)
    writer.add_topic(TEXTS, "std_msgs/msg/String", [TRANSIENT_LOCAL, TRANSIENT_LOCAL])
    writer.add_topic(NUMBERS, "std_msgs/msg/Int64MultiArray", [OfferedQos(), TRANSIENT_LOCAL])
    content = {TEXTS: [], NUMBERS: []}
    for i in range(200):
        text = serialize_message(String(data=f"text {i}"))
        numbers = serialize_message(Int64MultiArray(layout=MultiArrayLayout(), data=[i, -i]))
        for topic, data in ((TEXTS, text), (NUMBERS, numbers)):
            time = 10**18 + 10 * i + (topic == NUMBERS)
            writer.write(topic, data, time, time - 5, i + 2**32)
            content[topic].append((data, time))
    writer.close()
    return content


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_rosbags_reads_the_written_messages(tmp_path, compression):
    content = write_bag(tmp_path / "dig", compression=compression, chunk_size=2000)
    for path in (tmp_path / "dig", tmp_path / "dig/dig_0.mcap"):
        with Reader(path) as reader:
            read = {topic: [] for topic in content}
            for connection, time, data in reader.messages():
                read[connection.topic].append((data, time))
        assert read == content


def test_file_contains_the_message_types_to_decode_it(tmp_path):
    write_bag(tmp_path / "dig")
    with AnyReader([tmp_path / "dig"], default_typestore=None) as reader:
        decoded = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    assert [each.data for each in decoded[::2]] == [f"text {i}" for i in range(200)]
    assert [each.data.tolist() for each in decoded[1::2]] == [[i, -i] for i in range(200)]
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        texts = [each.data for *_, each in reader.iter_decoded_messages(topics=TEXTS)]
    assert texts == [f"text {i}" for i in range(200)]


def test_times_and_sequence_numbers_are_preserved(tmp_path):
    content = write_bag(tmp_path / "dig")
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        reader = make_reader(file)
        messages = [each for _, _, each in reader.iter_messages(topics=TEXTS)]
        assert reader.get_header().profile == "ros2"
    assert [each.log_time for each in messages] == [time for _, time in content[TEXTS]]
    assert all(each.publish_time == each.log_time - 5 for each in messages)
    assert [each.sequence for each in messages] == list(range(200))


def test_offered_qos_and_type_hashes_are_in_file_and_metadata(tmp_path):
    write_bag(tmp_path / "dig")
    for path in (tmp_path / "dig", tmp_path / "dig/dig_0.mcap"):
        with Reader(path) as reader:
            offered = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        assert [each.durability for each in offered[TEXTS]] == [QosDurability.TRANSIENT_LOCAL]
        assert len(offered[NUMBERS]) == 2
        assert {each.reliability for each in offered[NUMBERS]} == {QosReliability.RELIABLE}
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    hashes = {each.topic: each.metadata["topic_type_hash"] for each in channels}
    assert hashes[TEXTS] == type_hash("std_msgs/msg/String")
    with Reader(tmp_path / "dig") as reader:
        assert {each.topic: each.digest for each in reader.connections} == hashes


def test_advertised_type_hash_replaces_the_installed_one(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic(TEXTS, "std_msgs/msg/String", [], "RIHS01_" + 64 * "0")
    writer.close()
    with Reader(tmp_path / "dig") as reader:
        assert reader.connections[0].digest == "RIHS01_" + 64 * "0"


def test_bag_without_messages_is_valid(tmp_path):
    writer = BagWriter(tmp_path / "parent/dig")
    writer.add_topic(TEXTS, "std_msgs/msg/String")
    writer.close()
    writer.close()
    with Reader(tmp_path / "parent/dig") as reader:
        assert (reader.message_count, list(reader.topics)) == (0, [TEXTS])


def test_folder_that_is_not_empty_is_an_error_and_not_changed(tmp_path):
    write_bag(tmp_path / "dig")
    before = {each: each.read_bytes() for each in (tmp_path / "dig").iterdir()}
    with pytest.raises(BagError, match="not empty"):
        BagWriter(tmp_path / "dig")
    assert {each: each.read_bytes() for each in (tmp_path / "dig").iterdir()} == before


def test_empty_folder_is_accepted(tmp_path):
    (tmp_path / "dig").mkdir()
    write_bag(tmp_path / "dig")


def test_folder_that_cannot_be_created_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="file/dig"):
        BagWriter(tmp_path / "file/dig")


def test_unknown_compression_is_an_error_before_the_folder_is_created(tmp_path):
    with pytest.raises(BagError, match="gzip"):
        BagWriter(tmp_path / "dig", compression="gzip")
    assert not (tmp_path / "dig").exists()


def test_failed_add_topic_leaves_no_trace(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    with pytest.raises(SchemaError, match="nowhere_msgs"):
        writer.add_topic("/unknown", "nowhere_msgs/msg/Thing")
    writer.add_topic(TEXTS, "std_msgs/msg/String")
    with pytest.raises(BagError, match=TEXTS):
        writer.add_topic(TEXTS, "std_msgs/msg/Bool")
    writer.close()
    with Reader(tmp_path / "dig") as reader:
        assert [(c.topic, c.msgtype) for c in reader.connections] == [
            (TEXTS, "std_msgs/msg/String")
        ]


def test_flush_writes_all_messages_to_the_file(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic(TEXTS, "std_msgs/msg/String")
    data = serialize_message(String(data="one"))
    writer.write(TEXTS, data, 1, 1)
    assert messages_in(writer.file) == []
    writer.flush()
    assert [each.data for each in messages_in(writer.file)] == [data]
    writer.write(TEXTS, data, 2, 2)
    writer.close()
    assert [each.log_time for each in messages_in(writer.file)] == [1, 2]


def messages_in(file: Path) -> list[Message]:
    """Return the messages of a file that may be truncated, by mcap's stream reader."""
    messages: list[Message] = []
    with file.open("rb") as stream, contextlib.suppress(EndOfFile):
        records = StreamReader(stream, validate_crcs=True).records
        messages.extend(each for each in records if isinstance(each, Message))
    return messages


def start_writer(folder: Path, size: int, limit: int = 0) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", textwrap.dedent(ENDLESS), folder, str(size), str(limit)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_killed_writer_leaves_every_complete_chunk(tmp_path):
    process = start_writer(tmp_path / "dig", 1000)
    in_file = -1  # number of the last message when a chunk had just been written
    size = 0
    for line in process.stdout:
        number, now = map(int, line.split())
        if now != size:
            in_file, size = number, now
        if number == 50:
            break
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert not (tmp_path / "dig/metadata.yaml").exists()
    messages = messages_in(tmp_path / "dig/dig_0.mcap")
    assert len(messages) > in_file >= 40
    assert [each.sequence for each in messages] == list(range(len(messages)))
    assert all(each.data == b"x" * 1000 for each in messages)


def test_full_disk_is_an_error_and_leaves_every_complete_chunk(tmp_path):
    process = start_writer(tmp_path / "dig", 1000, limit=30_000)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    lines = output.splitlines()
    assert "no disk space" in lines[-1]
    size = int(lines[-2].split()[1])  # after the last chunk
    assert (tmp_path / "dig/dig_0.mcap").stat().st_size >= size > 20_000
    messages = messages_in(tmp_path / "dig/dig_0.mcap")
    assert [each.sequence for each in messages] == list(range(len(messages)))
    assert len(messages) >= 20
    assert ends_with_a_complete_record(tmp_path / "dig/dig_0.mcap")
    assert [path.name for path in (tmp_path / "dig").iterdir()] == ["dig_0.mcap"]


def ends_with_a_complete_record(path: Path) -> bool:
    data, offset = path.read_bytes(), 8
    while offset < len(data):
        offset += 9 + int.from_bytes(data[offset + 1 : offset + 9], "little")
    return offset == len(data)


def test_custom_data_are_in_metadata(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.close({"lost": '{"/a": 3}'})
    content = yaml.safe_load((tmp_path / "dig/metadata.yaml").read_text())
    assert content["rosbag2_bagfile_information"]["custom_data"] == {"lost": '{"/a": 3}'}
