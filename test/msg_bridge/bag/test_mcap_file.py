"""Summary and data section of a finished MCAP file agree, as validators of MCAP require."""

from __future__ import annotations

import re
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Footer, McapRecord, Schema, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from msg_bridge.bag.writer import BagWriter

MAGIC_SIZE = 8
ATTACHMENTS = {"a/soils.yaml": b"loam: {}", "b/soils.yaml": b""}


@pytest.fixture(
    params=["without topics", "without messages", "topic after the last message", "attachments"]
)
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A finished MCAP file."""
    writer = BagWriter(tmp_path / "dig", chunk_size=1000)
    if request.param != "without topics":
        writer.add_topic("/early", "std_msgs/msg/String")
    if request.param == "topic after the last message":
        for i in range(50):
            writer.write("/early", bytes(100), 1000 - i, 0)
        writer.flush()
        writer.add_topic("/late", "std_msgs/msg/Bool")
    if request.param == "attachments":
        for name, data in ATTACHMENTS.items():
            writer.attach(name, "application/yaml", data, 7)
    writer.close()
    return writer.file


def test_independent_validator_has_no_complaint(tmp_path: Path) -> None:
    """`pymcap-cli doctor` ends with 1 if it finds errors, and names warnings."""
    writer = BagWriter(tmp_path / "dig", chunk_size=1000)
    writer.attach("a/soils.yaml", "application/yaml", b"loam: {}", 7)
    writer.add_topic("/early", "std_msgs/msg/String")
    for i in range(100):
        if i == 50:
            writer.split()
            writer.add_topic("/late", "std_msgs/msg/String")
        data = serialize_message(String(data=f"text {i}"))
        writer.write("/late" if i >= 60 else "/early", data, 1000 + i, 1000 + i, i)
    writer.close()
    doctor = Path(sys.executable).with_name("pymcap-cli")
    for file in sorted((tmp_path / "dig").glob("*.mcap")):
        done = subprocess.run([doctor, "doctor", file], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout
        assert "passed MCAP doctor checks" in done.stdout
        assert not re.search("(?i)warning|error", done.stdout), done.stdout


def sections(file: Path) -> tuple[list[McapRecord], list[McapRecord], Footer]:
    """Return the records of the data section, those of the summary, and the footer."""
    with file.open("rb") as stream:
        records = list(StreamReader(stream, validate_crcs=True).records)
    end = next(k for k, each in enumerate(records) if isinstance(each, DataEnd))
    assert isinstance(records[-1], Footer)
    return records[:end], records[end + 1 : -1], records[-1]


def record_opcodes(data: bytes) -> list[int]:
    opcodes, offset = [], 0
    while offset < len(data):
        opcodes.append(data[offset])
        offset += 9 + int.from_bytes(data[offset + 1 : offset + 9], "little")
    assert offset == len(data)
    return opcodes


def test_each_summary_offset_is_that_of_one_group_that_is_not_empty(file: Path) -> None:
    _, summary, footer = sections(file)
    data = file.read_bytes()
    position = footer.summary_start
    for offset in (each for each in summary if isinstance(each, SummaryOffset)):
        assert offset.group_start == position
        position += offset.group_length
        assert set(record_opcodes(data[offset.group_start : position])) == {offset.group_opcode}
    assert position == footer.summary_offset_start


def test_every_schema_and_channel_of_the_summary_is_in_the_data_section(file: Path) -> None:
    data, summary, _ = sections(file)
    for kind in (Schema, Channel):
        assert [each for each in data if isinstance(each, kind)] == [
            each for each in summary if isinstance(each, kind)
        ]


def test_statistics_count_the_records_of_the_data_section(file: Path) -> None:
    data, summary, _ = sections(file)
    (statistics,) = (each for each in summary if isinstance(each, Statistics))
    counts = Counter(type(each).__name__ for each in data)
    assert statistics.message_count == counts["Message"]
    assert statistics.schema_count == counts["Schema"]
    assert statistics.channel_count == counts["Channel"]
    assert statistics.attachment_count == counts["Attachment"]
    if counts["Message"]:
        assert (statistics.message_start_time, statistics.message_end_time) == (951, 1000)


def test_checksum_of_the_summary_is_correct(file: Path) -> None:
    *_, footer = sections(file)
    data = file.read_bytes()
    end = len(data) - MAGIC_SIZE - 4  # the checksum is the last value of the footer
    assert footer.summary_crc == zlib.crc32(data[footer.summary_start : end])


@pytest.mark.parametrize("file", ["attachments"], indirect=True)
def test_attachments_are_found_by_the_mcap_library(file: Path) -> None:
    with file.open("rb") as stream:
        found = {each.name: each.data for each in make_reader(stream).iter_attachments()}
    assert found == ATTACHMENTS
