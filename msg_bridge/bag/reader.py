"""Read ROS 2 bags in MCAP files, finished or not.

A file without a summary (its recorder was killed) is read up to its last complete chunk. Only the
chunks that are due are in memory, and only messages of the requested topics are decoded, into the
message classes of the installed ROS. Names of older formats are replaced by the current ones
(`legacy_names`, `legacy_messages`), both of topics and within decoded messages.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel

from msg_bridge.bag.bag_files import find_bag_files
from msg_bridge.bag.bundled_types import BUNDLED_TYPES
from msg_bridge.bag.legacy_messages import RecordedRun, upgrade_message
from msg_bridge.bag.legacy_names import current_topic
from msg_bridge.bag.mcap_index import (
    BagReadError,
    McapFile,
    index_file,
    read_attachment,
)
from msg_bridge.bag.merged_messages import merge_messages
from msg_bridge.bag.message_index import MessageIndex
from msg_bridge.bag.metadata import OfferedQos, from_qos_yaml
from msg_bridge.bag.terrain_deltas import has_deltas, map_topic_of_deltas
from msg_bridge.contract import topics
from msg_bridge.yaml_text import load_yaml

__all__ = ["BagReadError", "BagReader", "TopicInfo"]

_CONFIG_TOPIC = f"/{topics.SIM_CONFIG}"
_SOIL_TICK_TOPIC = f"/{topics.SOIL_TICK}"


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
        path: the path as given.
        namespace: namespace of the simulation that is read, empty for `/`.
        files: its MCAP files, in the order they were written.
        topics: type and number of messages of each topic, by its current name relative to the
            namespace, with a leading `/`; only topics of CDR messages of ROS 2 types. Terrain maps
            recorded as deltas are messages of the topic of the maps.
        truncated: names of files without an end; what came after their last complete chunk is lost.
    """

    def __init__(self, path: str | Path, *, namespace: str | None = "/") -> None:
        """Find the messages of a bag.

        Args:
            path: the folder or file.
            namespace: that of the simulation to read; topics outside of it are left out. None: that
                of the only simulation in the bag, `/` if there is none.

        Raises:
            BagReadError: no such file, not MCAP, no messages, or none of ROS 2; several simulations
                and no namespace.
        """
        self.path = Path(path)
        self.files = find_bag_files(self.path)
        self._files = [index_file(number, file) for number, file in enumerate(self.files)]
        given = self._find_simulation() if namespace is None else namespace
        self.namespace = f"/{given.strip('/')}".rstrip("/")
        self.truncated = tuple(file.path.name for file in self._files if not file.is_complete)
        self.topics = self._list_topics()
        if not any(file.counts.total() for file in self._files):
            raise BagReadError(
                f"{self.path} has no messages; start the recorder before the nodes publish"
            )
        if not self.topics:
            self.check_simulation()
            found = {c.message_encoding for file in self._files for c in file.channels.values()}
            raise BagReadError(
                f"{self.path} has no ROS 2 messages in the namespace {self.namespace or '/'}; give"
                f" another bag or namespace. Its messages are encoded as {', '.join(sorted(found))}"
            )

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[str, int, Any]]:
        """Return an iterator over (topic, log time [ns], message), ordered by log time.

        Args:
            topics: names of the requested topics; all if not given, without those that the
                recorder made from others (`bundled_types`) if their types are not installed.

        Raises:
            BagReadError: a topic or its message type is missing, or the file is damaged.
        """
        wanted = self._validate_topics(topics)
        if topics is None:
            wanted = frozenset(topic for topic in wanted if not self._is_unreadable_copy(topic))
        for topic in wanted:
            _message_class(self.topics[topic].type)
        return self._decode_all(wanted)

    def raw_messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Return an iterator over (topic, log time [ns], CDR bytes as recorded).

        `decode` makes a message of the bytes. Order, arguments and errors are those of `messages`.
        """
        return merge_messages(self._files, self._topic_name, self._validate_topics(topics))

    def decode(self, topic: str, data: bytes, log_time: int = 0) -> Any:
        """Return the message of a topic that CDR bytes hold, with current names.

        Args:
            topic: its current name, as in `topics`.
            data: the bytes, as from `raw_messages`.
            log_time: its log time [ns]; needed for ledgers and state hashes of format 1 in bags
                of several runs.

        Raises:
            BagReadError: the bytes are not a message of the topic's type, or that is not installed.
        """
        from rclpy.serialization import deserialize_message

        type_name = self.topics[topic].type
        message_class = _message_class(type_name)
        try:
            message = deserialize_message(data, message_class)
        except Exception as error:  # RCLError and others, depending on the damage
            raise BagReadError(f"a message on {topic} is no {type_name}: {error}") from error
        return upgrade_message(topic, message, lambda: self._run_at(log_time))

    def index(self, topics: Iterable[str]) -> MessageIndex:
        """Return random access to the messages of some topics; close it at the end.

        Args:
            topics: their current names; those that the bag lacks are left out.

        Raises:
            BagReadError: the bag is damaged.
        """
        known = sorted(set(topics) & set(self.topics))
        return MessageIndex(self._files, self._topic_name, known)

    def offered_qos(self, topic: str) -> tuple[OfferedQos, ...]:
        """Return the QoS that the recorded publishers of a topic offered; empty if unknown."""
        found = (
            each.metadata.get("offered_qos_profiles", "")
            for file in self._files
            for each in file.channels.values()
            if self._topic_name(file, each) == topic and not has_deltas(file, each)
        )
        return tuple(dict.fromkeys(profile for text in found for profile in from_qos_yaml(text)))

    @property
    def type_definitions(self) -> dict[str, str]:
        """Definition of each ROS 2 message type in the bag, with those of its fields, by name."""
        return {
            schema.name: schema.data.decode(errors="replace")
            for file in self._files
            for schema in file.schemas.values()
            if schema.encoding == "ros2msg"
        }

    @property
    def attachment_names(self) -> frozenset[str]:
        """Names of the attachments of all files."""
        return frozenset(name for file in self._files for name in file.attachments)

    def read_attachment(self, name: str) -> bytes:
        """Return the data of an attachment, of the last one with that name.

        Raises:
            BagReadError: there is none, or it is damaged.
        """
        for file in reversed(self._files):
            if name in file.attachments:
                return read_attachment(file, name)
        raise BagReadError(
            f"{self.path} has no attachment {name}; it has"
            f" {', '.join(sorted(self.attachment_names)) or 'none'}"
        )

    def is_of_simulation(self, topic: str) -> bool:
        """Return whether a topic is not that of another simulation in a namespace below this."""
        return not any(topic.startswith(f"{each}/") for each in self._nested_simulations)

    def check_simulation(self) -> None:
        """Check that the simulation is in this namespace, if the bag has one at all.

        Raises:
            BagReadError: simulations are in other namespaces only.
        """
        found = self._simulations
        if found and (self.namespace or "/") not in found:
            raise BagReadError(
                f"{self.path} has no simulation in the namespace {self.namespace or '/'}; it has"
                f" {'one' if len(found) == 1 else 'some'} in {', '.join(found)}"
            )

    def __iter__(self) -> Iterator[tuple[str, int, Any]]:
        return self.messages()

    @cached_property
    def _simulations(self) -> list[str]:
        """Namespaces of all simulations in the bag: those in which tick headers are published."""
        names = {channel.topic for file in self._files for channel in file.channels.values()}
        return sorted(
            name.removesuffix(_SOIL_TICK_TOPIC) or "/"
            for name in names
            if name.endswith(_SOIL_TICK_TOPIC)
        )

    def _find_simulation(self) -> str:
        """Return the namespace of the only simulation."""
        found = self._simulations
        if len(found) > 1:
            raise BagReadError(
                f"{self.path} has simulations in the namespaces {', '.join(found)}; choose one by"
                " its namespace"
            )
        return found[0] if found else "/"

    def _list_topics(self) -> dict[str, TopicInfo]:
        topics: dict[str, TopicInfo] = {}
        for file in self._files:
            for channel in file.channels.values():
                name = self._topic_name(file, channel)
                if name is None:
                    continue
                kind = file.schemas[channel.schema_id].name
                known = topics.get(name, TopicInfo(kind, 0))
                if known.type != kind:
                    raise BagReadError(
                        f"{name} is both {known.type} and {kind}; split the bag first"
                    )
                topics[name] = TopicInfo(kind, known.count + file.counts[channel.id])
        return dict(sorted(topics.items()))

    def _topic_name(self, file: McapFile, channel: Channel) -> str | None:
        """Return the current name of a channel; None if it is not ROS 2 or of the namespace."""
        is_ros2 = channel.message_encoding == "cdr" and channel.schema_id in file.schemas
        if not is_ros2 or not channel.topic.startswith(f"{self.namespace}/"):
            return None
        name, kind = (
            channel.topic.removeprefix(self.namespace),
            file.schemas[channel.schema_id].name,
        )
        return map_topic_of_deltas(name, kind) or current_topic(name, kind)

    def _is_unreadable_copy(self, topic: str) -> bool:
        """Return whether a topic repeats others in a type that is not installed."""
        if self.topics[topic].type not in BUNDLED_TYPES:
            return False
        try:
            _message_class(self.topics[topic].type)
        except BagReadError:
            return True
        return False

    def _validate_topics(self, topics: Iterable[str] | None) -> frozenset[str]:
        wanted = frozenset(self.topics if topics is None else topics)
        unknown = sorted(wanted - set(self.topics))
        if unknown:
            raise BagReadError(
                f"{self.path} has no topic {', '.join(unknown)}; it has {', '.join(self.topics)}"
            )
        return wanted

    def _decode_all(self, wanted: frozenset[str]) -> Iterator[tuple[str, int, Any]]:
        for topic, time, data in merge_messages(self._files, self._topic_name, wanted):
            try:
                message = self.decode(topic, data, time)
            except BagReadError as error:
                raise BagReadError(f"{self.path}, log time {time} ns: {error}") from error
            yield topic, time, message

    def _run_at(self, log_time: int) -> RecordedRun | None:
        """Return the run that was recorded at a time; None if the bag has no configuration."""
        earlier = [run for time, run in self._runs if time <= log_time]
        return earlier[-1] if earlier else next((run for _, run in self._runs), None)

    @cached_property
    def _nested_simulations(self) -> list[str]:
        """Namespaces of the simulations below this one, relative to it."""
        names = (name.removesuffix(_SOIL_TICK_TOPIC) for name in self.topics)
        return [name for name in names if name and name + _SOIL_TICK_TOPIC in self.topics]

    @cached_property
    def _runs(self) -> list[tuple[int, RecordedRun]]:
        """Log time [ns] of each configuration of a run, and its run."""
        if _CONFIG_TOPIC not in self.topics:
            return []
        configs = [(time, _parse_run(msg.data)) for _, time, msg in self.messages([_CONFIG_TOPIC])]
        return [(time, run) for time, run in configs if run is not None]


def _parse_run(text: str) -> RecordedRun | None:
    """Return the run of a configuration; None if it cannot be read."""
    try:
        run = load_yaml(text)["run"]
        return RecordedRun(int(run["run_id"]), float(run["tick_period"]))
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        return None


@cache
def _message_class(name: str) -> Any:
    """Return the installed class of a message type."""
    package, _, rest = name.partition("/")
    kind = rest.rpartition("/")[2]
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagReadError(
            f"the message type {name} is not installed; install the package {package}, or read"
            " without topics of that type"
        ) from error
