"""What a recorder got: written as a bag, and changed on purpose."""

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
from msg_bridge.contract.messages import (
    RowChunk,
    Stream,
)
from msg_bridge.contract.rows import (
    Rows,
)

TOPICS = {
    Stream.SWEEP: "/soil/tool_sweeps",
    Stream.DEPOSIT_REQUEST: "/soil/deposit_requests",
    Stream.CONVERSION: "/soil/conversions",
    Stream.MAP_UPDATE: "/terrain/map_updates",
    Stream.FORCE: "/soil/forces",
}
PERIOD = 0.01


def machine_topic(machine_id: int, name: str) -> str:
    """A topic below a machine's namespace."""
    return f"/excavator{f'_{machine_id}' if machine_id > 1 else ''}/{name}"


@dataclass
class Recording:
    """Messages as a recorder got them: (topic, log time [ns], ROS message)."""

    messages: list[tuple[str, int, Any]] = field(default_factory=list)

    def add(self, topic: str, message: Any) -> None:
        self.messages.append((topic, 1000 * len(self.messages), message))

    def write(self, path: Path, **options: Any) -> Path:
        """As an MCAP file."""
        return write_mcap(path, self.messages, **options)

    def write_folder(self, folder: Path, *, finish: bool = True) -> Path:
        """As the recorder writes it; one that is not finished lost its last chunk."""
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
        return Recording(list(self.messages))

    def count(self, topic: str) -> int:
        return sum(each[0] == topic for each in self.messages)

    def without(self, topic: str) -> Recording:
        """A bag that lacks a topic."""
        return Recording([each for each in self.messages if each[0] != topic])

    def modify_rows(
        self, stream: Stream, change: Callable[[Rows], Rows], *, number: int
    ) -> Recording:
        """Change the rows of the message that holds the row of some number."""
        spoilt = self.copy()
        for index, (topic, time, message) in enumerate(spoilt.messages):
            if topic == TOPICS[stream]:
                chunk = from_chunk_cloud(message, stream)
                if number in chunk.rows["seq"]:
                    rows = change(chunk.rows.copy())
                    changed = RowChunk(
                        chunk.run_id, stream, chunk.machine_id, chunk.session_id, rows
                    )
                    cloud = to_chunk_cloud(changed, "map", message.header.stamp)
                    spoilt.messages[index] = (topic, time, cloud)
                    return spoilt
        raise AssertionError(f"there is no {stream.name} row {number}")

    def rows(self, stream: Stream) -> Rows:
        """All rows of a stream, as they came."""
        own = [message for topic, _, message in self.messages if topic == TOPICS[stream]]
        return np.concatenate([from_chunk_cloud(message, stream).rows for message in own])

    def find(self, topic: str, holds: Callable[[Any], bool]) -> int:
        """Index of the first header or ledger on a topic for which something holds."""
        for index, (each, _, message) in enumerate(self.messages):
            if each == topic and holds(from_multi_array(message)):
                return index
        raise AssertionError(f"nothing like it on {topic}")


def write_mcap(
    path: Path,
    messages: Iterable[tuple[str, int, Any]],
    *,
    chunk_size: int = 64 * 1024,
    finish: bool = True,
    compression: CompressionType = CompressionType.ZSTD,
) -> Path:
    """Write messages as a ROS 2 bag; one that is not finished looks as its recorder were killed."""
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
