"""Format metadata.yaml of a bag as rosbag2 of ROS 2 Jazzy does (version 9), and offered QoS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from msg_bridge.yaml_text import load_yaml

__all__ = [
    "INFINITE",
    "BagMetadata",
    "FileMetadata",
    "OfferedQos",
    "TopicMetadata",
    "from_qos_yaml",
    "to_metadata_yaml",
    "to_qos_yaml",
]

INFINITE = 2**63 - 1
"""An infinite duration [ns]; also the starting time of a bag without messages."""

_NANO = 10**9

_DURATIONS = {
    "deadline": "deadline",
    "lifespan": "lifespan",
    "lease": "liveliness_lease_duration",
}
"""Keys of the durations in YAML, by attribute."""


@dataclass(frozen=True)
class OfferedQos:
    """QoS that one publisher offers, in the terms of rosbag2.

    Attributes:
        reliability: `reliable` or `best_effort`.
        durability: `volatile` or `transient_local`.
        history, depth: `unknown` and 0 if the middleware does not provide them.
        liveliness: `automatic` or `manual_by_topic`.
        deadline, lifespan, lease: durations [ns].
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "unknown"
    depth: int = 0
    liveliness: str = "automatic"
    deadline: int = INFINITE
    lifespan: int = INFINITE
    lease: int = INFINITE

    def to_dict(self) -> dict[str, Any]:
        """Return the entry in metadata.yaml."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _duration_entry(self.deadline),
            "lifespan": _duration_entry(self.lifespan),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _duration_entry(self.lease),
            "avoid_ros_namespace_conventions": False,
        }


@dataclass(frozen=True)
class TopicMetadata:
    """A topic of a bag.

    Attributes:
        name: its name.
        type_name: its message type, as `std_msgs/msg/String`.
        type_hash: hash of the type, `RIHS01_...`.
        offered: different QoS offered by its publishers.
        count: number of its messages.
    """

    name: str
    type_name: str
    type_hash: str
    offered: tuple[OfferedQos, ...]
    count: int


@dataclass(frozen=True)
class FileMetadata:
    """A file of a bag.

    Attributes:
        name: its name in the bag's folder.
        first, last: log times of its first and last message [ns]; None without messages.
        count: number of its messages.
    """

    name: str
    first: int | None
    last: int | None
    count: int

    @property
    def times(self) -> dict[str, Any]:
        """Starting time and duration, as in metadata.yaml."""
        start, length = INFINITE, 0
        if self.first is not None and self.last is not None:
            start, length = self.first, self.last - self.first
        return {
            "starting_time": {"nanoseconds_since_epoch": start},
            "duration": {"nanoseconds": length},
        }


@dataclass(frozen=True)
class BagMetadata:
    """A bag.

    Attributes:
        files: its files, in the order they were written.
        topics: its topics.
        custom: custom data, by name.
    """

    files: tuple[FileMetadata, ...]
    topics: tuple[TopicMetadata, ...]
    custom: Mapping[str, str]

    @property
    def whole(self) -> FileMetadata:
        """Times and number of messages of all files."""
        first = [each.first for each in self.files if each.first is not None]
        last = [each.last for each in self.files if each.last is not None]
        count = sum(each.count for each in self.files)
        return FileMetadata("", min(first, default=None), max(last, default=None), count)


def to_qos_yaml(offered: Sequence[OfferedQos]) -> str:
    """Return the value of `offered_qos_profiles` of an MCAP channel: a YAML list."""
    return _dump([each.to_dict() for each in offered])


def from_qos_yaml(text: str) -> tuple[OfferedQos, ...]:
    """Return the QoS in the value of `offered_qos_profiles` of an MCAP channel.

    What an entry lacks, or has as numbers (ROS 2 Humble and before), has its default. A text that
    is no such list gives none.
    """
    try:
        entries = load_yaml(text) or []
    except yaml.YAMLError:
        return ()
    return tuple(_parse_qos(each) for each in entries if isinstance(each, dict))


def to_metadata_yaml(metadata: BagMetadata) -> str:
    """Return the content of metadata.yaml."""
    whole = metadata.whole
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        **whole.times,
        "message_count": whole.count,
        "topics_with_message_count": [_topic_entry(topic) for topic in metadata.topics],
        # Compression of files or messages; MCAP chunks have their own.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [each.name for each in metadata.files],
        "files": [
            {"path": each.name, **each.times, "message_count": each.count}
            for each in metadata.files
        ],
        "custom_data": dict(metadata.custom) or None,
        "ros_distro": "jazzy",
    }
    return _dump({"rosbag2_bagfile_information": information})


def _topic_entry(topic: TopicMetadata) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": [each.to_dict() for each in topic.offered],
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.count,
    }


def _parse_qos(entry: Mapping[str, Any]) -> OfferedQos:
    texts = {
        key: entry[key]
        for key in ("reliability", "durability", "history", "liveliness")
        if isinstance(entry.get(key), str)
    }
    depth = entry.get("depth")
    durations = {
        name: duration["sec"] * _NANO + duration["nsec"]
        for name, key in _DURATIONS.items()
        if isinstance(duration := entry.get(key), dict)
        and all(isinstance(duration.get(part), int) for part in ("sec", "nsec"))
    }
    return OfferedQos(**texts, depth=depth if isinstance(depth, int) else 0, **durations)


def _duration_entry(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, _NANO)
    return {"sec": seconds, "nsec": rest}


class _NoAliasDumper(yaml.SafeDumper):
    """Writes a repeated value again rather than as an alias, as rosbag2 does."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _dump(content: Any) -> str:
    return yaml.dump(content, Dumper=_NoAliasDumper, sort_keys=False, allow_unicode=True)
