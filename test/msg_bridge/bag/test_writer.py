"""A bag is what ros2 bag, rosbags and mcap expect, and survives whatever ends the recorder."""

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

WORDS, NUMBERS = "/words", "/numbers"
LATCHED = OfferedQos(durability="transient_local")

# Writes until it is killed or something is wrong; argv: folder, bytes of a message, size limit.
ENDLESS = """\
import itertools, resource, sys
from pathlib import Path
from msg_bridge.bag.writer import BagError, BagWriter
if int(sys.argv[3]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
writer = BagWriter(Path(sys.argv[1]), compression="none", chunk_size=4096)
writer.add_topic("/words", "std_msgs/msg/String")
try:
    for number in itertools.count():
        writer.write("/words", b"x" * int(sys.argv[2]), number, number, number)
        print(number, writer.size, flush=True)
except BagError as error:
    print(error)
writer.close()
"""


def written(folder: Path, **kwargs) -> dict[str, list[tuple[bytes, int]]]:
    """Make a bag; what is in it, by topic, as (message, log time)."""
    writer = BagWriter(folder, **kwargs)
    writer.add_topic(WORDS, "std_msgs/msg/String", [LATCHED, LATCHED])
    writer.add_topic(NUMBERS, "std_msgs/msg/Int64MultiArray", [OfferedQos(), LATCHED])
    content = {WORDS: [], NUMBERS: []}
    for i in range(200):
        word = serialize_message(String(data=f"word {i}"))
        numbers = serialize_message(Int64MultiArray(layout=MultiArrayLayout(), data=[i, -i]))
        for topic, data in ((WORDS, word), (NUMBERS, numbers)):
            time = 10**18 + 10 * i + (topic == NUMBERS)
            writer.write(topic, data, time, time - 5, i + 2**32)
            content[topic].append((data, time))
    writer.close()
    return content


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_rosbags_reads_what_was_written(tmp_path, compression):
    content = written(tmp_path / "dig", compression=compression, chunk_size=2000)
    for path in (tmp_path / "dig", tmp_path / "dig/dig_0.mcap"):
        with Reader(path) as reader:
            found = {topic: [] for topic in content}
            for connection, time, data in reader.messages():
                found[connection.topic].append((data, time))
        assert found == content


def test_file_holds_the_types_to_decode_it(tmp_path):
    written(tmp_path / "dig")
    with AnyReader([tmp_path / "dig"], default_typestore=None) as reader:
        decoded = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    assert [each.data for each in decoded[::2]] == [f"word {i}" for i in range(200)]
    assert [each.data.tolist() for each in decoded[1::2]] == [[i, -i] for i in range(200)]
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        words = [each.data for *_, each in reader.iter_decoded_messages(topics=WORDS)]
    assert words == [f"word {i}" for i in range(200)]


def test_times_and_publishers_numbers_are_kept(tmp_path):
    content = written(tmp_path / "dig")
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        reader = make_reader(file)
        messages = [each for _, _, each in reader.iter_messages(topics=WORDS)]
        assert reader.get_header().profile == "ros2"
    assert [each.log_time for each in messages] == [time for _, time in content[WORDS]]
    assert all(each.publish_time == each.log_time - 5 for each in messages)
    assert [each.sequence for each in messages] == list(range(200))


def test_offers_and_type_hashes_stand_in_file_and_metadata(tmp_path):
    written(tmp_path / "dig")
    for path in (tmp_path / "dig", tmp_path / "dig/dig_0.mcap"):
        with Reader(path) as reader:
            offered = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        assert [each.durability for each in offered[WORDS]] == [QosDurability.TRANSIENT_LOCAL]
        assert len(offered[NUMBERS]) == 2
        assert {each.reliability for each in offered[NUMBERS]} == {QosReliability.RELIABLE}
    with (tmp_path / "dig/dig_0.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    hashes = {each.topic: each.metadata["topic_type_hash"] for each in channels}
    assert hashes[WORDS] == type_hash("std_msgs/msg/String")
    with Reader(tmp_path / "dig") as reader:
        assert {each.topic: each.digest for each in reader.connections} == hashes


def test_publishers_hash_stands_above_the_installed_one(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic(WORDS, "std_msgs/msg/String", [], "RIHS01_" + 64 * "0")
    writer.close()
    with Reader(tmp_path / "dig") as reader:
        assert reader.connections[0].digest == "RIHS01_" + 64 * "0"


def test_bag_without_messages_is_one(tmp_path):
    writer = BagWriter(tmp_path / "above/dig")
    writer.add_topic(WORDS, "std_msgs/msg/String")
    writer.close()
    writer.close()
    with Reader(tmp_path / "above/dig") as reader:
        assert (reader.message_count, list(reader.topics)) == (0, [WORDS])


def test_folder_with_something_in_it_is_refused_and_left_alone(tmp_path):
    written(tmp_path / "dig")
    before = {each: each.read_bytes() for each in (tmp_path / "dig").iterdir()}
    with pytest.raises(BagError, match=r"dig is not empty \(.*another path"):
        BagWriter(tmp_path / "dig")
    assert {each: each.read_bytes() for each in (tmp_path / "dig").iterdir()} == before


def test_empty_folder_is_taken(tmp_path):
    (tmp_path / "dig").mkdir()
    written(tmp_path / "dig")


def test_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"file/dig cannot be written \(Not a directory\)"):
        BagWriter(tmp_path / "file/dig")


def test_unknown_compression_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(BagError, match="give one of zstd, lz4, none"):
        BagWriter(tmp_path / "dig", compression="gzip")
    assert not (tmp_path / "dig").exists()


def test_topic_that_cannot_be_described_leaves_no_trace(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    with pytest.raises(SchemaError, match="nowhere_msgs"):
        writer.add_topic("/strange", "nowhere_msgs/msg/Thing")
    writer.add_topic(WORDS, "std_msgs/msg/String")
    with pytest.raises(BagError, match="already"):
        writer.add_topic(WORDS, "std_msgs/msg/Bool")
    writer.close()
    with Reader(tmp_path / "dig") as reader:
        assert [(c.topic, c.msgtype) for c in reader.connections] == [
            (WORDS, "std_msgs/msg/String")
        ]


def test_flush_gives_all_messages_to_the_file(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.add_topic(WORDS, "std_msgs/msg/String")
    data = serialize_message(String(data="one"))
    writer.write(WORDS, data, 1, 1)
    assert messages_in(writer.file) == []
    writer.flush()
    assert [each.data for each in messages_in(writer.file)] == [data]
    writer.write(WORDS, data, 2, 2)
    writer.close()
    assert [each.log_time for each in messages_in(writer.file)] == [1, 2]


def messages_in(file: Path) -> list[Message]:
    """Messages of a file that may break off, by the stream reader."""
    messages: list[Message] = []
    with file.open("rb") as stream, contextlib.suppress(EndOfFile):
        records = StreamReader(stream, validate_crcs=True).records
        messages.extend(each for each in records if isinstance(each, Message))
    return messages


def endless(folder: Path, size: int, limit: int = 0) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", textwrap.dedent(ENDLESS), folder, str(size), str(limit)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_killed_recorder_leaves_every_whole_chunk(tmp_path):
    process = endless(tmp_path / "dig", 1000)
    in_file = -1  # number of the last message when a chunk had just gone to the file
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


def test_full_disk_is_told_and_leaves_every_whole_chunk(tmp_path):
    process = endless(tmp_path / "dig", 1000, limit=30_000)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    lines = output.splitlines()
    assert "there is no room for" in lines[-1]
    assert "can be read" in lines[-1]
    size = int(lines[-2].split()[1])  # after the last chunk that went to the file
    assert (tmp_path / "dig/dig_0.mcap").stat().st_size >= size > 20_000
    messages = messages_in(tmp_path / "dig/dig_0.mcap")
    assert [each.sequence for each in messages] == list(range(len(messages)))
    assert len(messages) >= 20
    assert ends_with_a_whole_record(tmp_path / "dig/dig_0.mcap")
    assert [path.name for path in (tmp_path / "dig").iterdir()] == ["dig_0.mcap"]


def ends_with_a_whole_record(path: Path) -> bool:
    data, at = path.read_bytes(), 8
    while at < len(data):
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return at == len(data)


def test_custom_values_stand_in_metadata(tmp_path):
    writer = BagWriter(tmp_path / "dig")
    writer.close({"lost": '{"/a": 3}'})
    content = yaml.safe_load((tmp_path / "dig/metadata.yaml").read_text())
    assert content["rosbag2_bagfile_information"]["custom_data"] == {"lost": '{"/a": 3}'}
