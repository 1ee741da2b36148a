"""Recorded messages that can be written as a bag and modified."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from msg_bridge.bag.message_schemas import schema_text
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.row_chunks import from_chunk_cloud, to_chunk_cloud
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import Rows

TOPICS = {
    Stream.SWEEP: "/soil/tool_sweeps",
    Stream.DEPOSIT_REQUEST: "/soil/deposit_requests",
    Stream.CONVERSION: "/soil/conversions",
    Stream.MAP_UPDATE: "/terrain/map_updates",
    Stream.FORCE: "/soil/forces",
}
PERIOD = 0.01


def machine_topic(machine_id: int, name: str) -> str:
    """Return the name of a topic in a machine's namespace."""
    return f"/excavator{f'_{machine_id}' if machine_id > 1 else ''}/{name}"


@dataclass
class Recording:
    """Messages as (topic, log time [ns], ROS message), in the order of their reception."""

    messages: list[tuple[str, int, Any]] = field(default_factory=list)

    def add(self, topic: str, message: Any) -> None:
        """Append a message 1 us after the last one."""
        self.messages.append((topic, 1000 * len(self.messages), message))

    def write(self, path: Path, **options: Any) -> Path:
        """Write an MCAP file."""
        return write_mcap(path, self.messages, **options)

    def write_folder(self, folder: Path, *, finish: bool = True) -> Path:
        """Write a bag as the recorder does; without `finish`, its last chunk is lost."""
        writer = BagWriter(folder, chunk_size=64 * 1024)
        for topic, time, message in self.messages:
            if topic not in writer.topics:
                kind = type(message)
                writer.add_topic(topic, f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}")
            writer.write(topic, serialize_message(message), time, time)
        if finish:
            writer.close()
        return folder

    def copy(self) -> Recording:
        """Return a copy with the same messages."""
        return Recording(list(self.messages))

    def count(self, topic: str) -> int:
        """Return the number of messages on a topic."""
        return sum(each[0] == topic for each in self.messages)

    def without(self, topic: str) -> Recording:
        """Return a copy without a topic."""
        return Recording([each for each in self.messages if each[0] != topic])

    def modify_rows(
        self, stream: Stream, change: Callable[[Rows], Rows], *, number: int
    ) -> Recording:
        """Return a copy in which `change` was applied to the rows of the message with a row."""
        modified = self.copy()
        for index, (topic, time, message) in enumerate(modified.messages):
            if topic == TOPICS[stream]:
                chunk = from_chunk_cloud(message, stream)
                if number in chunk.rows["seq"]:
                    rows = change(chunk.rows.copy())
                    changed = RowChunk(
                        chunk.run_id, stream, chunk.machine_id, chunk.session_id, rows
                    )
                    cloud = to_chunk_cloud(changed, "map", message.header.stamp)
                    modified.messages[index] = (topic, time, cloud)
                    return modified
        raise AssertionError(f"there is no {stream.name} row {number}")

    def rows(self, stream: Stream) -> Rows:
        """Return all rows of a stream, in recorded order."""
        messages = [message for topic, _, message in self.messages if topic == TOPICS[stream]]
        return np.concatenate([from_chunk_cloud(message, stream).rows for message in messages])

    def find(self, topic: str, condition: Callable[[Any], bool]) -> int:
        """Return the index of the first header or ledger on a topic that meets a condition."""
        for index, (each, _, message) in enumerate(self.messages):
            if each == topic and condition(from_multi_array(message)):
                return index
        raise AssertionError(f"no such message on {topic}")


def write_mcap(
    path: Path,
    messages: Iterable[tuple[str, int, Any]],
    *,
    chunk_size: int = 64 * 1024,
    finish: bool = True,
    compression: CompressionType = CompressionType.ZSTD,
) -> Path:
    """Write messages as a ROS 2 bag; without `finish`, as a killed recorder leaves it."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for topic, time, message in messages:
            if topic not in channels:
                kind = type(message)
                package = kind.__module__.split(".")[0]
                name = f"{package}/msg/{kind.__name__}"
                schema = writer.register_schema(name, "ros2msg", schema_text(name).encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], time, serialize_message(message), time)
        if finish:
            writer.finish()
    return path
