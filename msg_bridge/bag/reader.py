"""Reading ROS 2 bags in MCAP files, whole or broken off.

A file that was never finished (its recorder was killed) reads as well as one with a summary, up to
its last whole chunk. Only chunks that are due are in memory, and only messages of the topics asked
for are decoded, into the message classes of the ROS that is installed.
"""

from __future__ import annotations

import heapq
import importlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel, Message

from msg_bridge.bag.mcap_index import BagReadError, McapFile, index_file, records

__all__ = ["BagReadError", "BagReader", "TopicInfo"]


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag.

    Attributes:
        type: name of its message type, as `std_msgs/msg/String`.
        count: number of its messages.
    """

    type: str
    count: int


class BagReader:
    """One recording: a folder with metadata.yaml, a folder of .mcap files, or one such file.

    Attributes:
        path: as given.
        files: its MCAP files.
        topics: by name; only those in CDR of ROS 2 types.
        truncated: names of files that break off; what came after their last whole chunk is lost.
    """

    def __init__(self, path: str | Path) -> None:
        """
        Raises:
            BagReadError: no such file, not MCAP, nothing in it, or not of ROS 2.
        """
        self.path = Path(path)
        self.files = _files(self.path)
        self._files = [index_file(number, file) for number, file in enumerate(self.files)]
        self.truncated = tuple(file.path.name for file in self._files if not file.is_complete)
        self.topics = _topics(self._files)
        if not any(file.counts.total() for file in self._files):
            raise BagReadError(f"{self.path} holds no messages; was anything published meanwhile?")
        if not self.topics:
            found = {c.message_encoding for file in self._files for c in file.channels.values()}
            raise BagReadError(
                f"{self.path} is no ROS 2 bag: its messages are {', '.join(sorted(found))}, not cdr"
            )

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) in order of log time.

        Args:
            topics: names of those wanted; all if not given.

        Raises:
            BagReadError: a topic or its message type is not there, or the file is damaged.
        """
        classes = {
            name: _message_class(self.topics[name].type) for name in self._validate_topics(topics)
        }
        return self._decode(classes)

    def raw_messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time [ns], CDR bytes) in order of log time; arguments as `messages`."""
        return self._merge_by_time(self._validate_topics(topics))

    def __iter__(self) -> Iterator[tuple[str, int, Any]]:
        return self.messages()

    def _validate_topics(self, topics: Iterable[str] | None) -> frozenset[str]:
        wanted = frozenset(self.topics if topics is None else topics)
        unknown = sorted(wanted - set(self.topics))
        if unknown:
            raise BagReadError(
                f"{self.path} has no topic {', '.join(unknown)}; it has {', '.join(self.topics)}"
            )
        return wanted

    def _decode(self, classes: dict[str, Any]) -> Iterator[tuple[str, int, Any]]:
        from rclpy.serialization import deserialize_message

        for topic, time, data in self._merge_by_time(frozenset(classes)):
            try:
                message = deserialize_message(data, classes[topic])
            except Exception as error:  # RCLError and others, by kind of damage
                what = f"a message on {topic} at {time} ns"
                raise BagReadError(f"{what} is no {self.topics[topic].type}: {error}") from error
            yield topic, time, message

    def _merge_by_time(self, wanted: frozenset[str]) -> Iterator[tuple[str, int, bytes]]:
        segments = sorted(part for file in self._files for part in file.segments)
        waiting: list[tuple[int, int, str, bytes]] = []  # a heap; second is the order of reading
        read = 0
        streams = [file.path.open("rb") for file in self._files]
        try:
            for part in segments:
                while waiting and waiting[0][0] < part.start_ns:
                    time, _, topic, data = heapq.heappop(waiting)
                    yield topic, time, data
                file = self._files[part.file]
                for record in records(file, streams[part.file], part):
                    if isinstance(record, Message):
                        channel = file.channels[record.channel_id]
                        if channel.topic in wanted and _is_ros2_message(file, channel):
                            read += 1
                            entry = (record.log_time, read, channel.topic, record.data)
                            heapq.heappush(waiting, entry)
            while waiting:
                time, _, topic, data = heapq.heappop(waiting)
                yield topic, time, data
        finally:
            for stream in streams:
                stream.close()


def _files(path: Path) -> list[Path]:
    """The MCAP files of a bag, in the order they were written."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagReadError(f"there is no bag {path}; give an .mcap file or a folder that holds one")
    metadata = path / "metadata.yaml"
    if not metadata.is_file():  # a recorder that was killed has not written it
        files = sorted(path.glob("*.mcap"), key=_natural_sort_key)
        if not files:
            raise BagReadError(f"{path} holds neither metadata.yaml nor an .mcap file")
        return files
    try:
        told = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
        storage, names = told["storage_identifier"], list(told["relative_file_paths"])
    except (yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise BagReadError(f"{metadata} is not a bag's: {error!r}; name the .mcap file") from error
    if storage != "mcap":
        raise BagReadError(f"{path} is stored as {storage}; convert it to mcap (ros2 bag convert)")
    files = [path / str(name) for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing or not files:
        gone = ", ".join(missing) or "any file"
        raise BagReadError(f"{path} lacks {gone}, which its metadata.yaml names")
    return files


def _natural_sort_key(path: Path) -> list[tuple[int, str]]:
    """Sorts bag_10 after bag_9."""
    return [
        (int(part or 0), "") if part.isdigit() else (0, part)
        for part in re.split(r"(\d+)", path.name)
    ]


def _is_ros2_message(file: McapFile, channel: Channel) -> bool:
    return channel.message_encoding == "cdr" and channel.schema_id in file.schemas


def _topics(files: list[McapFile]) -> dict[str, TopicInfo]:
    topics: dict[str, TopicInfo] = {}
    for file in files:
        for channel in file.channels.values():
            if not _is_ros2_message(file, channel):
                continue
            name, kind = channel.topic, file.schemas[channel.schema_id].name
            known = topics.get(name, TopicInfo(kind, 0))
            if known.type != kind:
                raise BagReadError(f"{name} is both {known.type} and {kind}; split the bag first")
            topics[name] = TopicInfo(kind, known.count + file.counts[channel.id])
    return dict(sorted(topics.items()))


def _message_class(name: str) -> Any:
    """The installed class of a message type."""
    package, _, rest = name.partition("/")
    kind = rest.rpartition("/")[2]
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagReadError(
            f"the message type {name} is not installed; install the package {package}, or do"
            " without topics of that type"
        ) from error
