"""Messages to record, and readers of the recorded bags."""

import importlib
from pathlib import Path
from typing import Any

from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

from msg_bridge.recorder.recorder_node import RecorderNode

LARGE = QoSProfile(depth=5000)  # the publisher loses nothing


def texts(first: int, last: int) -> list[String]:
    """Return messages with the numbers `first` to `last`, inclusive."""
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
