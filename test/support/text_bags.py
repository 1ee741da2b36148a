"""Bags of numbered texts, to be cut off or damaged, and recovered."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

from msg_bridge.bag.mcap_index import FileSegment, index_file
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter
from msg_bridge.bag_recovery import RecoveredBag, recover_bag

__all__ = [
    "ATTACHMENT",
    "CHUNK_SIZE",
    "LATE",
    "NUMBER",
    "TOPIC",
    "numbers_in",
    "recover",
    "segments_of",
    "text",
    "write_bag",
]

TOPIC, LATE = "/texts", "/late"
NUMBER = 400
CHUNK_SIZE = 10_000
ATTACHMENT = b"loam: {}"


def text(number: int) -> bytes:
    noise = random.Random(number).randbytes(200).hex()
    return bytes(serialize_message(String(data=f"{number} {noise}")))


def write_bag(
    folder: Path,
    compression: str = "zstd",
    *,
    num_files: int = 1,
    encode: Callable[[bytes], bytes] = bytes,
) -> Path:
    """Write messages whose log times are their numbers [s]; return the first file."""
    writer = BagWriter(folder, compression=compression, chunk_size=CHUNK_SIZE)
    file = writer.file
    writer.attach("a/soils.yaml", "application/yaml", ATTACHMENT, 7)
    writer.add_topic(TOPIC, "std_msgs/msg/String", [OfferedQos(durability="transient_local")])
    for number in range(NUMBER):
        writer.write(TOPIC, encode(text(number)), number * 10**9, number * 10**9 + 5, number)
        if (number + 1) % (NUMBER // num_files) == 0 and number + 1 < NUMBER:
            writer.split()
    writer.close({"format_version": "2"})
    return file


def numbers_in(folder: Path) -> list[int]:
    """Return the numbers of the messages of a bag as read by rosbags; each is as it was written."""
    with Reader(folder) as reader:
        numbers = [time // 10**9 for _, time, _ in reader.messages()]
        assert all(data == text(time // 10**9) for _, time, data in reader.messages())
        assert reader.message_count == len(numbers)
    return numbers


def segments_of(file: Path) -> list[FileSegment]:
    """Return the chunks of an undamaged file."""
    return index_file(0, file).segments


def recover(path: Path) -> RecoveredBag:
    """Recover a bag, or a file of one, into a folder beside the bag."""
    return recover_bag(path, path.parent.parent / "recovered")
