"""metadata.yaml of a bag, as rosbag2 of ROS 2 Jazzy writes it (version 9), and offered QoS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

__all__ = [
    "INFINITE",
    "BagMetadata",
    "OfferedQos",
    "TopicMetadata",
    "to_metadata_yaml",
    "to_qos_yaml",
]

INFINITE = 2**63 - 1
"""A duration without end [ns]; also the starting time of a bag without messages."""

_NANO = 10**9


@dataclass(frozen=True)
class OfferedQos:
    """What one publisher offers, in rosbag2's words.

    Attributes:
        history, depth: not told by every middleware; `unknown` and 0 then.
        deadline, lifespan, lease: [ns].
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
        """As it stands in YAML."""
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
        offered: by its publishers, equal ones once.
    """

    name: str
    type_name: str
    type_hash: str
    offered: tuple[OfferedQos, ...]
    count: int


@dataclass(frozen=True)
class BagMetadata:
    """A bag of one file.

    Attributes:
        file: its name in the bag's folder.
        first, last: log times of its first and last message [ns]; None if it has none.
        custom: anything else, by name.
    """

    file: str
    topics: tuple[TopicMetadata, ...]
    first: int | None
    last: int | None
    custom: Mapping[str, str]


def to_qos_yaml(offered: Sequence[OfferedQos]) -> str:
    """What stands in an MCAP channel's `offered_qos_profiles`: a YAML list."""
    return _dump([each.to_dict() for each in offered])


def to_metadata_yaml(facts: BagMetadata) -> str:
    """The content of metadata.yaml."""
    count = sum(topic.count for topic in facts.topics)
    start, length = INFINITE, 0
    if facts.first is not None and facts.last is not None:
        start, length = facts.first, facts.last - facts.first
    times = {
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": length},
    }
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        **times,
        "message_count": count,
        "topics_with_message_count": [_topic_entry(topic) for topic in facts.topics],
        # Of whole files or messages; the chunks inside an MCAP file tell their own.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [facts.file],
        "files": [{"path": facts.file, **times, "message_count": count}],
        "custom_data": dict(facts.custom) or None,
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


def _duration_entry(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, _NANO)
    return {"sec": seconds, "nsec": rest}


class _NoAliasDumper(yaml.SafeDumper):
    """Writes what stands in two places twice, as rosbag2 does, not as an alias."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _dump(content: Any) -> str:
    return yaml.dump(content, Dumper=_NoAliasDumper, sort_keys=False, allow_unicode=True)
